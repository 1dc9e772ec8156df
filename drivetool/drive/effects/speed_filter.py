"""A logged motor speed that went through a low-pass before it was logged."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, _sensor):
    """dy/dt = wf (w - y), as a state of the chain, hence exact."""
    if assembly.filters_speed():
        bandwidth = assembly.of_sensor("bandwidth")
        state = assembly.states.index("motor_speed.filtered")
        assembly.torque(state, assembly.speed(0), bandwidth)
        assembly.torque(state, state, -bandwidth)


EFFECT = Effect(
    code="speed-filter",
    of="sensor",
    quantities={"bandwidth": Quantity("rad/s", "bandwidth of the filter on the logged motor speed",
                                      (1e-3, 1e9), 1.0, float("inf"))},
    stamp=stamp,
    law="dy/dt = wf (w - y)",
    needs="excitation above a third of the sampling rate, and a second sensor to tell it from an input lag",
    source="Franklin, Powell, Workman 1998, Digital Control of Dynamic Systems",
    present=("bandwidth",),
)
