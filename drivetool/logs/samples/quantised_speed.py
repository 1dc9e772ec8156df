"""Speeds that a drive computes as differences of encoder counts from sample to sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.finding import Finding
from drivetool.logs.samples.spikes import quantisation_step

# Samples without a gap. A choice: fewer give Welch densities of too few segments; more take longer for the same.
MIN_DENSITY_SAMPLES, MAX_DENSITY_SAMPLES = 1000, 100_000
WINDOW_SAMPLES = 256  # of the density: seven windows in the shortest stretch, and 15 frequencies in the upper band
# Bands [sampling rates] in which quantisation noise dominates the motion: differences rise as sin^2(pi f).
UPPER_BAND, MIDDLE_BAND = (0.42, 0.48), (0.2, 0.25)
# Least density in the upper band over that of rounded speeds, q^2/12, and range of upper over middle band.
# Differences of rounded counts give 3.9 and 1.7; noise of the angle itself raises both alike.
MIN_QUANTISATION_RATIO, BAND_RATIO_RANGE = 2.5, (1.7, 3.2)


def quantised_speed_findings(signals: Mapping[str, np.ndarray], segments: Sequence[tuple[int, int]], step: float,
                   ) -> list[Finding]:
    """A finding per speed whose noise is that of differences of counts.

    signals  role -> (n,); segments: (first, last + 1) without a gap; step [s]
    """
    first, last = max(segments, key=lambda s: s[1] - s[0])
    findings = []
    for role in (r for r in signals if r.endswith("_speed")):
        y = signals[role][first:min(last, first + MAX_DENSITY_SAMPLES)]
        if len(y) < MIN_DENSITY_SAMPLES or not np.isfinite(y).all():
            continue
        size = quantisation_step(y)
        if size and is_differentiated_counts(y, size):
            findings.append(Finding(
                "warning", "quantised-speed",
                f"{role} is quantised in steps of {size:.4g} and has the noise of a difference quotient: it "
                f"was computed from encoder counts of {size * step:.4g}, from one sample to the next.",
                {"role": role, "steps": size, "count": size * step},
                f"Log the counts, or integrate the speed: --condition 'integrate roles={role}'. The noise "
                "of such a speed can be mistaken for an unmodelled effect."))
    return findings


def is_differentiated_counts(y: np.ndarray, size: float) -> bool:
    """Whether the fast noise of values (n,) in steps of a size is that of a differentiated rounded angle."""
    frequency, density = _power_density(y)
    fast, middle = (float(np.median(density[(frequency >= a) & (frequency <= b)])) / 2.0
                    for a, b in (UPPER_BAND, MIDDLE_BAND))
    rounded = size**2 / 12.0
    return fast > MIN_QUANTISATION_RATIO * rounded and BAND_RATIO_RANGE[0] < fast / middle < BAND_RATIO_RANGE[1]


def _power_density(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(frequencies in cycles per sample, one-sided power density): Welch's mean over Hann windows of half overlap.

    SciPy's takes longer to load than a recording to be inspected. Each window has its straight line subtracted.
    """
    place = np.arange(WINDOW_SAMPLES)
    window = np.hanning(WINDOW_SAMPLES + 1)[:-1]
    line = np.vander(place, 2)
    frames = np.lib.stride_tricks.sliding_window_view(y, WINDOW_SAMPLES)[::WINDOW_SAMPLES // 2].T
    frames = frames - line @ np.linalg.lstsq(line, frames, rcond=None)[0]
    power = np.mean(np.abs(np.fft.rfft(window[:, None] * frames, axis=0)) ** 2, axis=1) / np.sum(window**2)
    power[1:-1] *= 2.0
    return np.fft.rfftfreq(WINDOW_SAMPLES), power
