"""Does the torque answer the sensor? Feedback makes the noise model matter.

In closed loop the noise of the drive comes back through the controller and is in the torque too. H1 and
an output-error fit then mistake it for a response; the more of the torque is such noise, the more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher

from drivetool.logs import Experiment

LAGS = 20
MOST = 20_000  # samples that decide it


@dataclass(frozen=True)
class Feedback:
    """Whether past sensor values help to foretell the torque.

    p      of the hypothesis that they do not
    share  of what is left unforetold by the past torque that they foretell, 0..1
    new    of the torque's power that its own past does not foretell, 0..1: without it nothing can be told
    """

    p: float
    share: float
    new: float = 0.0

    @property
    def there(self) -> bool:
        """Feedback that matters: certain, and more than a hundredth."""
        return self.p < 1e-6 and self.share > 0.01


def feedback_of(stretches: Sequence[np.ndarray], lags: int = LAGS) -> Feedback:
    """Granger's test from sensor to torque.

    stretches  (n_i, 2) torque and sensor, NaN-free
    lags       of both
    returns    Feedback; p = 1 where the stretches are too short to tell, or the past torque foretells
               all of it (a signal generator's multisine)
    source     Granger 1969; Caines and Chan 1975
    """
    now, own, both = [], [], []
    for x in stretches:
        x = x[:MOST]
        n = len(x) - lags
        if n < 5 * lags:
            continue
        past = np.lib.stride_tricks.sliding_window_view(x - x.mean(axis=0), lags, axis=0)[:n]
        now.append(x[lags:, 0] - x[:, 0].mean())
        own.append(past[:, 0])
        both.append(past.reshape(n, -1))
    if not now:
        return Feedback(1.0, 0.0)
    u, a, b = np.concatenate(now), np.concatenate(own), np.concatenate(both)
    less, more = _left(a, u), _left(b, u)
    # A quantiser's step is not feedback: what is left must be a real share of the torque.
    degrees = len(u) - b.shape[1] - 1
    if degrees < 10 or less <= 1e-10 * float(u @ u):
        return Feedback(1.0, 0.0)
    share = max(0.0, 1.0 - more / less)
    statistic = (less - more) / lags / max(more / degrees, 1e-300)
    return Feedback(float(fisher.sf(max(statistic, 0.0), lags, degrees)), share, less / float(u @ u))


def _left(past: np.ndarray, now: np.ndarray) -> float:
    """Sum of squares that a regression leaves."""
    size = np.sqrt(np.mean(past**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = np.column_stack([past / size, np.ones(len(past))])
    rest = now - scaled @ np.linalg.lstsq(scaled, now, rcond=1e-11)[0]
    return float(rest @ rest)


def feedback_in(experiments: Sequence[Experiment], sensor: str, answer: str = "motor_torque") -> Feedback:
    """The same of recordings, over the stretches that lack no value.

    sensor, answer  roles: of the sensor, and of what may answer it
    """
    stretches = []
    for e in experiments:
        both = np.column_stack([e.signals[answer], e.signals[sensor]])
        stretches += [both[a:b] for a, b in e.segments if np.isfinite(both[a:b]).all()]
    return feedback_of(stretches)
