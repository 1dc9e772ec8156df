"""Dead time between the logged torque command and the torque, not tied to whole samples."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, _path):
    """u(t - td): the held torque switches inside the sample."""
    assembly.dead_time = assembly.parameter("converter.dead_time")


EFFECT = Effect(
    code="dead-time",
    of="path",
    quantities={"dead_time": Quantity("s", "dead time", (0.0, 1.0), 1e-4, 0.0)},
    stamp=stamp,
    law="T(t) = u(t - td)",
    needs="excitation above a third of the sampling rate to distinguish it from a lag",
    source="Tallfors 2005, (2.3)",
    present=("dead_time",),
)
