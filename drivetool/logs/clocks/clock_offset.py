"""Do two clocks agree? Told from the motion that both of them carry; nothing is shifted here."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from drivetool.errors import Finding
from drivetool.logs import Signal, is_motion, median_step, quantity
from drivetool.logs.samples import SURE

# Longer records are looked at in their first part, coarser ones at this many points.
POINTS = 200_000
AVERAGED = 5
CORRELATION = 0.9


def clock_offsets(signals: Mapping[str, Signal], log: str) -> list[Finding]:
    """A finding for every two clocks whose motions agree better when one of them is shifted.

    signals  role -> Signal with finite, rising time stamps
    returns  findings clock-offset, with the seconds to add to the second role's stamps
    """
    findings = []
    # What is asked for comes before what happens, whatever the clock; a table is behind a ratio.
    motions = [role for role in signals
               if is_motion(role) and not role.startswith(("table_", "reference_"))]
    seen: list[tuple[np.ndarray, np.ndarray]] = []
    for first, second in sorted(combinations(motions, 2), key=lambda pair: _body(pair[0]) != _body(pair[1])):
        a, b = signals[first], signals[second]
        pair = (a.time, b.time)
        if np.array_equal(a.time, b.time) or any(_same(pair, other) for other in seen):
            continue
        found = estimate(a, b, quantity(first) == "angle", quantity(second) == "angle")
        if found is None:
            continue
        seen.append(pair)
        shift, correlation, step = found
        same = _body(first) == _body(second)
        where = "behind" if shift < 0 else "ahead of"
        findings.append(Finding(
            "warning" if same else "note", "clock-offset",
            f"In {log} {second} is {1e3 * abs(shift):.4g} ms {where} {first}, judged by their motion"
            f"{'' if same else ' (a gap between them looks the same)'}; nothing was shifted.",
            {"first": first, "second": second, "shift": shift, "correlation": correlation, "step": step},
            f"If their clocks differ, write `shift: {shift:.6g}` for {second} in the channel map."))
    return findings


def _body(role: str) -> str:
    return role.rpartition("_")[0]


def _same(pair: tuple, other: tuple) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(pair, other, strict=True))


def estimate(a: Signal, b: Signal, a_is_angle: bool,
             b_is_angle: bool) -> tuple[float, float, float] | None:
    """(seconds to add to the stamps of b, correlation then, step of the comparison); None if there is no
    sign of an offset, or if the two do not carry the same motion.

    The speeds of both are put on grids of one step and averaged over five; their correlation is
    taken at every lag that leaves half of the shorter one in common.
    """
    from scipy.signal import correlate

    step = max(median_step(a.time), median_step(b.time))
    step *= max(1.0, (min(np.ptp(a.time), np.ptp(b.time)) / step) / POINTS)
    x, y = _speed(a, a_is_angle, step), _speed(b, b_is_angle, step)
    if min(len(x), len(y)) < 50 or min(np.ptp(x), np.ptp(y)) == 0:
        return None
    x, y = x - x.mean(), y - y.mean()
    cross = correlate(x, y, mode="full", method="fft")
    ones = [correlate(p, q, mode="full", method="fft") for p, q in
            ((x * x, np.ones(len(y))), (np.ones(len(x)), y * y))]
    lags = np.arange(-(len(y) - 1), len(x))
    common = np.minimum(len(x), lags + len(y)) - np.maximum(0, lags)
    energy = np.sqrt(np.maximum(ones[0], 0) * np.maximum(ones[1], 0))
    valid = (common >= 0.5 * min(len(x), len(y))) & (energy > 1e-6 * energy.max())
    curve = np.where(valid, np.abs(cross) / np.where(valid, energy, 1.0), 0.0)
    # Where the stamps agree as they are; a periodic motion agrees again, so the nearest of equals.
    zero = (b.time[0] - a.time[0]) / step
    close = np.flatnonzero(curve > curve.max() - 1e-3)
    at = int(close[np.argmin(np.abs(lags[close] - zero))])
    while 0 < at < len(curve) - 1 and curve[at] < max(curve[at - 1], curve[at + 1]):
        at += 1 if curve[at + 1] > curve[at - 1] else -1
    if not 0 < at < len(curve) - 1 or curve[at] < CORRELATION:
        return None
    left, peak, right = curve[at - 1:at + 2]
    bend = left - 2 * peak + right
    lag = lags[at] + (0.5 * (left - right) / bend if bend < 0 else 0.0)
    shift = float((lag - zero) * step)
    as_is = float(np.interp(zero, lags, curve))
    count = common[at] / AVERAGED
    gain = 0.5 * count * np.log(max(1 - as_is**2, 1e-12) / max(1 - peak**2, 1e-12))
    if abs(shift) < 0.5 * step or gain < SURE:
        return None
    return shift, float(peak), float(step)


def _speed(signal: Signal, is_angle: bool, step: float) -> np.ndarray:
    """The speed on a grid of its own that begins at its first stamp, averaged a little."""
    known = np.isfinite(signal.values) & np.isfinite(signal.time)
    time, values = signal.time[known], signal.values[known]
    if len(time) < 50:
        return np.zeros(0)
    count = min(int((time[-1] - signal.time[0]) / step) + 1, 2 * POINTS)
    values = np.interp(signal.time[0] + np.arange(count) * step, time, values)
    if is_angle:
        values = np.gradient(values, step)
    return np.convolve(values, np.full(AVERAGED, 1 / AVERAGED), mode="same")
