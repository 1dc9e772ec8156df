"""Does the torque depend on the sensor? With feedback the noise model matters.

In closed loop the noise of the drive returns through the controller into the torque. H1 and an output-error fit
then take it for a response of the drive; the bias grows with the share of such noise in the torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.logs import Experiment

GRANGER_LAGS = 20  # of torque and sensor. A choice: a controller responds within them; more cost degrees of freedom
# Samples of a stretch. A choice: they detect a share of 0.01 with certainty, more only cost time.
MAX_FEEDBACK_SAMPLES = 20_000


@dataclass(frozen=True)
class Feedback:
    """Whether past sensor values help to predict the torque.

    p      of the hypothesis that they do not
    share  of the variance unpredicted by the past torque that they predict, 0..1
    new    share of the torque's power that its own past does not predict, 0..1: at zero the test has no power
    """

    p: float
    share: float
    innovation_share: float = 0.0

    @property
    def significant(self) -> bool:
        """Feedback that matters: certain, and more than a hundredth."""
        return self.p < 1e-6 and self.share > 0.01


def feedback_of(stretches: Sequence[np.ndarray], lags: int = GRANGER_LAGS) -> Feedback:
    """Granger's test from sensor to torque.

    stretches  (n_i, 2) torque and sensor, NaN-free
    lags       of both
    returns    Feedback; p = 1 where the stretches are too short for the test, or the past torque predicts
               all of it (a signal generator's multisine)
    source     Granger 1969; Caines and Chan 1975
    """
    parts = []
    for x in stretches:
        x = x[:MAX_FEEDBACK_SAMPLES]
        n = len(x) - lags
        if n < 5 * lags:
            continue
        past = np.lib.stride_tricks.sliding_window_view(x - x.mean(axis=0), lags, axis=0)[:n]
        parts.append((x[lags:, 0] - x[:, 0].mean(), past[:, 0], past.reshape(n, -1)))
    if not parts:
        return Feedback(1.0, 0.0)
    u, a, b = (np.concatenate(each) for each in zip(*parts, strict=True))
    without_sensor, with_sensor = _residual_sum(a, u), _residual_sum(b, u)
    # Rounding is not feedback: the residual must be a real share of the torque.
    degrees = len(u) - b.shape[1] - 1
    if degrees < 10 or without_sensor <= 1e-10 * float(u @ u):
        return Feedback(1.0, 0.0)
    share = max(0.0, 1.0 - with_sensor / without_sensor)
    statistic = (without_sensor - with_sensor) / lags / max(with_sensor / degrees, 1e-300)
    return Feedback(float(scipy.stats.f.sf(max(statistic, 0.0), lags, degrees)), share,
                    without_sensor / float(u @ u))


def _residual_sum(past: np.ndarray, now: np.ndarray) -> float:
    """Residual sum of squares of a regression."""
    size = np.sqrt(np.mean(past**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = np.column_stack([past / size, np.ones(len(past))])
    residual = now - scaled @ np.linalg.lstsq(scaled, now, rcond=1e-11)[0]
    return float(residual @ residual)


def feedback_in(experiments: Sequence[Experiment], sensor: str, response: str = "motor_torque") -> Feedback:
    """The same for recordings, over the stretches without missing values.

    sensor, answer  roles: of the sensor, and of the input that may depend on it
    """
    stretches = []
    for e in experiments:
        both = np.column_stack([e.signals[response], e.signals[sensor]])
        stretches += [both[a:b] for a, b in e.segments if np.isfinite(both[a:b]).all()]
    return feedback_of(stretches)
