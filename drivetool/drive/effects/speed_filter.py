"""A logged motor speed that went through a low-pass of first or second order before it was logged."""

from drivetool.drive.effects import lag
from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

ROLE = "motor_speed"  # that the filter acts on
STATES = (f"{ROLE}.filtered", f"{ROLE}.filtered.rate")


def states(assembly, _sensor):
    """As many as the order of the filter, where the speed is an output."""
    filters = ROLE in assembly.layout.outputs and "sensor.bandwidth" in assembly.acting
    return STATES[:lag.order_of(assembly, "sensor")] if filters else ()


def start(drive, _sensor, speeds, inputs):
    """Zero: what the filter remembers of the time before the record is estimated."""
    return 0.0, 0.0


def stamp(assembly, _sensor):
    """The filter as one or two states of the chain, hence exact."""
    if STATES[0] in assembly.states:
        assembly.sensed[ROLE] = assembly.states.index(STATES[0])
        lag.follow(assembly, assembly.sensed[ROLE], assembly.speed(0), "sensor")


EFFECT = Effect(
    code="speed-filter",
    of="sensor",
    quantities={
        "bandwidth": Quantity("rad/s", "bandwidth of the filter on the logged motor speed", (1e-3, 1e9), 1.0,
                              float("inf")),
        "damping": Quantity("", "damping ratio of that filter", (0.05, 20.0), 0.1, 0.69),
        "order": Quantity("", "order of that filter, 1 or 2", (1.0, 2.0), 1.0, 1.0, (1.0, 2.0)),
    },
    stamp=stamp,
    states=states,
    start=start,
    law="dy/dt = wf (w - y); of order 2: y'' + 2 zeta wf y' + wf^2 y = wf^2 w",
    needs="excitation above a third of the sampling rate, and a second sensor to distinguish it from an input lag",
    source="Franklin, Powell, Workman 1998, Digital Control of Dynamic Systems",
    present=("bandwidth",),
)
