"""Faults of the record itself, which are found without a fit."""

from drivetool.check.causes.cause import Cause

TWO_CHANNELS = "two channels of one motion: speed and angle, motor and load, or shaft and motor torque"
CAUSES = (
    Cause("outliers", "single wrong values", "A few samples lie far from their neighbours.",
          "Look for loose plugs and for disturbances on the sensor's line.", sizes=("count",),
          needs="no special excitation"),
    Cause("quantisation", "coarse steps in a sensor", "A sensor is logged in steps coarser than its noise.",
          "Log it with more digits, or log the angle instead of the speed.", sizes=("resolution",),
          needs="slow motion or standstill"),
    Cause("wrong-sign", "a channel with the wrong sign", "Two channels that should agree have opposite signs.",
          "Set 'sign: -1' for that role in the channel map.", sizes=("scale",), needs=TWO_CHANNELS),
    Cause("wrong-scale", "a channel with the wrong scale",
          "Two channels that should agree differ by a constant factor.",
          "Correct unit, rating or gear ratio of that channel in the channel map.", sizes=("scale",),
          needs=TWO_CHANNELS),
)
