"""Torque converter: the drive's torque follows the logged command with a lag of first or second order."""

from drivetool.drive.effects import lag
from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

STATES = ("converter", "converter.rate")  # the torque on its way, and its rate in a lag of second order


def states(assembly, _path):
    """As many as the order of the lag."""
    return STATES[:lag.order_of(assembly, "converter")] if "converter.bandwidth" in assembly.acting else ()


def start(drive, _path, speeds, inputs):
    """The torque that is logged first, at rest."""
    return inputs["motor_torque"], 0.0


def stamp(assembly, _path):
    """The lag as one or two states of the chain, hence exact."""
    assembly.motor_column = assembly.states.index(STATES[0])
    lag.follow(assembly, assembly.motor_column, assembly.nx, "converter")


EFFECT = Effect(
    code="converter-lag",
    of="path",
    quantities={
        "bandwidth": Quantity("rad/s", "converter bandwidth", (1e-3, 1e9), 1.0, float("inf")),
        "damping": Quantity("", "converter damping ratio", (0.05, 20.0), 0.1, 0.69),
        "order": Quantity("", "order of the converter's lag, 1 or 2", (1.0, 2.0), 1.0, 2.0, (1.0, 2.0)),
    },
    stamp=stamp,
    states=states,
    start=start,
    law="T'' + 2 zeta w0 T' + w0^2 T = w0^2 u; of order 1: T' = w0 (u - T)",
    needs="excitation above a third of the converter bandwidth",
    source="Tallfors 2005, (2.3); of order 1: Leonhard 2001, Control of Electrical Drives",
    present=("bandwidth",),
)
