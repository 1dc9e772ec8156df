"""The logged torque between its samples: held, or linearly interpolated.

The plant averages each sample with the next before it holds the mean.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, _path):
    """The share by which the plant averages."""
    assembly.interpolation = assembly.parameter("converter.interpolation").v


EFFECT = Effect(
    code="torque-hold",
    of="path",
    quantities={"interpolation": Quantity("", "share of a straight line between torque samples", (0.0, 1.0), 0.1,
                                          0.0)},
    stamp=stamp,
    law="mean of T over a sample = (1 - s/2) T[k] + (s/2) T[k+1]",
    needs="excitation above a tenth of the sampling rate; a current that was measured is rarely one that was held",
    source="Franklin, Powell and Workman 1998, Digital Control of Dynamic Systems, 6.3",
    present=("interpolation",),
)
