"""Speeds that a drive has made of an encoder's counts, by their differences from sample to sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.errors import Finding
from drivetool.logs.samples.spikes import quantum

LEAST, MOST = 1000, 100_000  # samples without a gap, and how many of them are looked at
FAST, MIDDLE = (0.42, 0.48), (0.2, 0.25)  # bands in which the rounding shows, in sampling rates
# What differences of rounded counts have there over what rounded speeds have, q^2/12: 3.9 and 1.7 without any
# noise of the angle itself, which would raise both alike.
LOUDER, STEEPER = 2.5, (1.7, 3.2)


def made_of_counts(signals: Mapping[str, np.ndarray], segments: Sequence[tuple[int, int]], step: float,
                   ) -> list[Finding]:
    """A finding per speed whose noise is that of differences of counts.

    signals  role -> (n,); segments: (first, last + 1) without a gap; step [s]
    """
    first, last = max(segments, key=lambda s: s[1] - s[0])
    findings = []
    for role in (r for r in signals if r.endswith("_speed")):
        y = signals[role][first:min(last, first + MOST)]
        if len(y) < LEAST or not np.isfinite(y).all():
            continue
        size = quantum(y)
        if size and differs_like_counts(y, size):
            findings.append(Finding(
                "warning", "made-of-counts",
                f"{role} comes in steps of {size:.4g} with the noise of differences: it was made of an encoder's "
                f"counts of {size * step:.4g}, from one sample to the next.",
                {"role": role, "steps": size, "count": size * step},
                f"Log the counts, or take their sum: --condition 'integrate roles={role}'. As a speed its noise "
                "passes for a law that is missing."))
    return findings


def differs_like_counts(y: np.ndarray, size: float) -> bool:
    """Whether the fast noise of values (n,) in steps of a size is that of a rounded angle, differentiated."""
    from scipy.signal import welch  # takes as long to load as many a fit; few records come here

    frequency, density = welch(y, nperseg=min(256, len(y)), detrend="linear")
    fast, middle = (float(np.median(density[(frequency >= a) & (frequency <= b)])) / 2.0 for a, b in (FAST, MIDDLE))
    rounded = size**2 / 12.0
    return fast > LOUDER * rounded and STEEPER[0] < fast / middle < STEEPER[1]
