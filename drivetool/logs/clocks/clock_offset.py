"""Estimates the offset of two clocks from the motion that both record; nothing is shifted here."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from drivetool.finding import Finding
from drivetool.logs import Signal, is_motion, median_step, quantity
from drivetool.logs.samples import MIN_LAG_LIKELIHOOD_GAIN, nearest_peak

# A choice: records with more points are compared on a coarser grid, which bounds the time of the correlation.
MAX_OFFSET_POINTS = 200_000
# A choice: averages over five steps suppress quantisation noise; longer ones blur the motion that fixes the lag.
AVERAGING_STEPS = 5
# A choice: below this correlation (81 % of the variance in common) the two may not carry the same motion.
MIN_OFFSET_CORRELATION = 0.9


def clock_offsets(signals: Mapping[str, Signal], log: str) -> list[Finding]:
    """A finding for every two clocks whose motions agree better when one of them is shifted.

    signals  role -> Signal with finite, rising time stamps
    returns  findings clock-offset, with the seconds to add to the second role's stamps
    """
    findings = []
    # A reference precedes the motion that follows it, whatever the clock; a table is behind a ratio.
    motions = [role for role in signals
               if is_motion(role) and not role.startswith(("table_", "reference_"))]
    compared_pairs: list[tuple[np.ndarray, np.ndarray]] = []
    for first, second in sorted(combinations(motions, 2),
                                key=lambda pair: _body_of_role(pair[0]) != _body_of_role(pair[1])):
        a, b = signals[first], signals[second]
        pair = (a.time, b.time)
        if np.array_equal(a.time, b.time) or any(
                all(map(np.array_equal, pair, other)) for other in compared_pairs):
            continue
        found = estimate_clock_offset(a, b, quantity(first) == "angle", quantity(second) == "angle")
        if found is None:
            continue
        compared_pairs.append(pair)
        shift, correlation, step = found
        same = _body_of_role(first) == _body_of_role(second)
        where = "behind" if shift < 0 else "ahead of"
        findings.append(Finding(
            "warning" if same else "note", "clock-offset",
            f"In {log} {second} is {1e3 * abs(shift):.4g} ms {where} {first}, estimated from the motion of both"
            f"{'' if same else ' (backlash between them has the same effect)'}; nothing was shifted.",
            {"first": first, "second": second, "shift": shift, "correlation": correlation, "step": step},
            f"If their clocks differ, write `shift: {shift:.6g}` for {second} in the channel map."))
    return findings


def _body_of_role(role: str) -> str:
    return role.rpartition("_")[0]


def estimate_clock_offset(a: Signal, b: Signal, a_is_angle: bool,
                          b_is_angle: bool) -> tuple[float, float, float] | None:
    """(seconds to add to the stamps of b, correlation then, step of the comparison); None if no
    offset is significant, or if the two do not carry the same motion.

    The speeds of both are put on grids of one step and averaged over five; their correlation is
    taken at every lag that leaves half of the shorter one in common.
    """
    from scipy.signal import correlate

    step = max(median_step(a.time), median_step(b.time))
    step *= max(1.0, (min(np.ptp(a.time), np.ptp(b.time)) / step) / MAX_OFFSET_POINTS)
    x, y = _resampled_speed(a, a_is_angle, step), _resampled_speed(b, b_is_angle, step)
    if min(len(x), len(y)) < 50 or min(np.ptp(x), np.ptp(y)) == 0:
        return None
    x, y = x - x.mean(), y - y.mean()
    cross = correlate(x, y, mode="full", method="fft")
    energies = [correlate(p, q, mode="full", method="fft") for p, q in
                ((x * x, np.ones(len(y))), (np.ones(len(x)), y * y))]
    lags = np.arange(-(len(y) - 1), len(x))
    common = np.minimum(len(x), lags + len(y)) - np.maximum(0, lags)
    energy = np.sqrt(np.maximum(energies[0], 0) * np.maximum(energies[1], 0))
    valid = (common >= 0.5 * min(len(x), len(y))) & (energy > 1e-6 * energy.max())
    curve = np.where(valid, np.abs(cross) / np.where(valid, energy, 1.0), 0.0)
    # Where the stamps agree as they are; a periodic motion agrees again, so the nearest of equals.
    zero = (b.time[0] - a.time[0]) / step
    at, beside, _ = nearest_peak(curve, curve.max() - 1e-3, np.abs(lags - zero))
    if not 0 < at < len(curve) - 1 or curve[at] < MIN_OFFSET_CORRELATION:
        return None
    shift, peak = float((lags[at] + beside - zero) * step), curve[at]
    unshifted = float(np.interp(zero, lags, curve))
    count = common[at] / AVERAGING_STEPS
    gain = 0.5 * count * np.log(max(1 - unshifted**2, 1e-12) / max(1 - peak**2, 1e-12))
    if abs(shift) < 0.5 * step or gain < MIN_LAG_LIKELIHOOD_GAIN:
        return None
    return shift, float(peak), float(step)


def _resampled_speed(signal: Signal, is_angle: bool, step: float) -> np.ndarray:
    """The speed on a grid of its own that begins at its first stamp, averaged a little."""
    known = np.isfinite(signal.values) & np.isfinite(signal.time)
    time, values = signal.time[known], signal.values[known]
    if len(time) < 50:
        return np.zeros(0)
    count = min(int((time[-1] - signal.time[0]) / step) + 1, 2 * MAX_OFFSET_POINTS)
    values = np.interp(signal.time[0] + np.arange(count) * step, time, values)
    if is_angle:
        values = np.gradient(values, step)
    return np.convolve(values, np.full(AVERAGING_STEPS, 1 / AVERAGING_STEPS), mode="same")
