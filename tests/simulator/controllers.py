"""Controllers as drives have them: discrete, saturated, working on what the sensor gives."""

from __future__ import annotations

import math

import numpy as np

from tests.simulator.simulate import quantise


class _Limited:
    """Saturation and resolution of a torque command."""

    def __init__(self, limit: float, resolution: float):
        self.limit, self.resolution = limit, resolution

    def limited(self, torque: float) -> float:
        torque = min(self.limit, max(-self.limit, torque))
        return float(quantise(torque, self.resolution)) if self.resolution else torque


class SpeedPI:
    """Speed controller; the integral waits while the torque is saturated.

    reference     (n,) [rad/s]
    gain, reset   [Nm s/rad] and integral gain [Nm/rad]
    feed_forward  (n,) [Nm] added before saturation, or None
    start         [Nm] the integral at the first sample
    limit, resolution  [Nm] of the command
    """

    def __init__(self, reference, gain, reset, step, feed_forward=None, start=0.0,
                 limit=math.inf, resolution=0.0):
        self.reference = np.asarray(reference, float).tolist()
        self.ahead = [0.0] * len(self.reference) if feed_forward is None else list(map(float, feed_forward))
        self.gain, self.reset, self.step = gain, reset, step
        self.integral, self.out = start, _Limited(limit, resolution)

    def torque(self, i: int, measured: float) -> float:
        """Command of sample i [Nm] from the measured speed [rad/s]."""
        error = self.reference[i] - measured
        wanted = self.gain * error + self.integral + self.ahead[i]
        if abs(wanted) <= self.out.limit or error * wanted < 0:
            self.integral += self.reset * error * self.step
        return self.out.limited(wanted)


class PositionPD:
    """Position controller; speed is the filtered difference of the measured position.

    reference     (n,) [rad or m]
    gain, rate    [Nm/rad] and [Nm s/rad]
    bandwidth     [rad/s] of the filter on the difference
    feed_forward  (n,) [Nm] added before saturation, or None
    limit, resolution  [Nm] of the command
    """

    def __init__(self, reference, gain, rate, step, bandwidth, feed_forward=None,
                 limit=math.inf, resolution=0.0):
        reference = np.asarray(reference, float)
        self.reference = reference.tolist()
        self.wanted_speed = np.gradient(reference, step).tolist()
        self.ahead = [0.0] * len(reference) if feed_forward is None else list(map(float, feed_forward))
        self.gain, self.rate, self.step = gain, rate, step
        self.share = 1.0 - math.exp(-bandwidth * step)
        self.speed, self.last, self.out = 0.0, None, _Limited(limit, resolution)

    def torque(self, i: int, measured: float) -> float:
        """Command of sample i [Nm] from the measured position."""
        if self.last is not None:
            self.speed += self.share * ((measured - self.last) / self.step - self.speed)
        self.last = measured
        return self.out.limited(self.gain * (self.reference[i] - measured)
                                + self.rate * (self.wanted_speed[i] - self.speed) + self.ahead[i])
