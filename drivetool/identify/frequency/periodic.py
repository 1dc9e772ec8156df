"""Frequency responses from a periodic excitation: noise and distortion separately, line by line.

Averaged over whole periods there is no leakage and no window. What changes from period to period is
noise; what repeats but changes with the phases of the excitation is nonlinear distortion; and with an
odd multisine what appears on empty even lines is even, on empty odd lines odd distortion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.errors import NotEnoughData
from drivetool.identify.frequency.frf import Response
from drivetool.identify.frequency.sections import DistortionSection

# Correlation with itself one period later from which a signal is periodic. A choice: 10 % of noise
MIN_PERIODIC_CORRELATION = 0.9
# Ratio of neighbouring amplitudes, sorted, that separates excited lines from residual ones. A choice: 10 dB.
MIN_AMPLITUDE_RATIO = 3.0
# Values of a variance, periods times neighbouring lines: it then scatters by 15 %, 1 / sqrt(45)
VARIANCE_VALUES = 45
MAX_NEIGHBOUR_LINES = 2  # lines to either side for that. A choice: a resonance must not be smoothed away
DRIFT_PASSES = 2  # of removing drift: the second removes what the ends of the first leave
# Power over that of the noise from which a level is significant: 3 standard deviations squared
LEVEL_SIGNIFICANCE = 9.0


@dataclass(frozen=True)
class Lines:
    """Spectra of whole periods of one run, (p, n) each, at the n lines from 1/period up.

    step, size  sample interval [s], samples per period
    excited     (n,) whether the excitation has the line
    """

    u: np.ndarray
    y: np.ndarray
    r: np.ndarray | None
    step: float
    size: int
    excited: np.ndarray

    @property
    def frequency(self) -> np.ndarray:
        """(n,) Hz."""
        return np.arange(1, self.u.shape[1] + 1) / (self.size * self.step)


def period_of(x: np.ndarray) -> int | None:
    """Samples after which a signal (n,) repeats itself, up to half of it; None if it does not."""
    x = x - x.mean()
    n, max_period = len(x), len(x) // 2
    power = float(x @ x)
    if power == 0.0 or max_period < 4:
        return None
    padded = np.fft.rfft(x, 2 * n)
    raw = np.fft.irfft(np.abs(padded) ** 2)[: max_period + 1]
    squares = np.concatenate(([0.0], np.cumsum(x**2)))
    lags = np.arange(max_period + 1)
    both = np.sqrt(np.maximum(squares[n - lags] * (squares[n] - squares[lags]), 1e-300))
    r = raw / both
    below = np.flatnonzero(r < 0.5)
    if not below.size:
        return None
    peaks = np.flatnonzero((r[1:-1] >= r[:-2]) & (r[1:-1] >= r[2:])) + 1
    peaks = np.concatenate([
        peaks[peaks > below[0]], [max_period] if r[max_period] > r[max_period - 1] else []]).astype(int)
    if not peaks.size or r[peaks].max() < MIN_PERIODIC_CORRELATION:
        return None
    best = r[peaks].max()
    return int(peaks[np.flatnonzero(r[peaks] >= best - 0.02 * (1.0 - MIN_PERIODIC_CORRELATION) - 1e-6)[0]])


def lines_of(stretch: np.ndarray, step: float, size: int, skip: int) -> Lines:
    """Whole periods of a stretch as spectra.

    stretch  (n, 2) input and output, or (n, 3) with the reference
    size     samples per period; skip: periods at the start that are left out, for the transient
    returns  Lines; excited: those of the reference, else of the input
    raises   NotEnoughData: fewer than two periods are left
    """
    count = len(stretch) // size - skip
    if count < 2:
        raise NotEnoughData(
            f"two periods of {size * step:g} s after {skip} for the transient",
            f"{len(stretch) * step:g} s", "Record more periods, or do without --method periodic.")
    x = stretch[len(stretch) - count * size:]  # the last ones: furthest from the transient
    for _ in range(DRIFT_PASSES):
        x = x - _drift(x, size)
    slope = (x[-size:].mean(axis=0) - x[:size].mean(axis=0)) / ((count - 1) * size)
    x = x - x.mean(axis=0) - slope * (np.arange(len(x)) - 0.5 * len(x))[:, None]
    spectra = np.fft.rfft(x.reshape(count, size, -1), axis=1)[:, 1: (size - 1) // 2 + 1] / size
    u, y = spectra[..., 0], spectra[..., 1]
    r = spectra[..., 2] if x.shape[1] > 2 else None
    # Where either is zero, as of a sensor at rest, there is no ratio of scatter and mean.
    there = (np.abs(u.mean(axis=0)) ** 2 > 0.0) & (np.abs(y.mean(axis=0)) ** 2 > 0.0)
    return Lines(u, y, r, step, size, excited_lines(u if r is None else r) & there)


def _drift(x: np.ndarray, size: int) -> np.ndarray:
    """The drift of the signals: their mean over a period around each sample.

    A free drive drifts, and a transient of its slow pole outlasts any record. The mean over a whole period has
    zeros at all lines of the excitation, so that the periodic part is unchanged. Over the half periods at both ends
    the parabola through the adjacent period continues it.
    """
    total = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])
    mean = (total[size:] - total[:-size]) / size  # over x[i: i + size], centred at i + (size - 1)/2
    first = (size - 1) // 2
    if size % 2 == 0:
        mean, first = 0.5 * (mean[:-1] + mean[1:]), size // 2
    t = np.arange(len(x))
    last, found = first + len(mean), np.empty_like(x)
    found[first:last] = mean
    for inside, outside in ((t[first:first + size], t[:first]), (t[max(last - size, first):last], t[last:])):
        middle = inside.mean()
        powers = np.vander((inside - middle) / size, 3)
        found[outside] = np.vander((outside - middle) / size, 3) @ np.linalg.lstsq(powers, found[inside])[0]
    return found


def excited_lines(x: np.ndarray) -> np.ndarray:
    """(n,) whether a line carries excitation: well above the noise, and above the others.

    x  (p, n) spectra of the periods
    """
    mean = np.abs(x.mean(axis=0))
    noise = np.sqrt(np.sum(np.abs(x - x.mean(axis=0)) ** 2, axis=0) / max(len(x) - 1, 1) / len(x))
    sure = mean > np.maximum(3.0 * noise, 1e-3 * mean.max())
    falling = np.sort(mean[sure])[::-1]
    if len(falling) < 2:
        return sure
    ratio = falling[:-1] / falling[1:]
    cut = int(np.argmax(ratio))
    return sure & (mean >= falling[cut]) if ratio[cut] > MIN_AMPLITUDE_RATIO else sure


def periodic_response(runs: Sequence[Lines]) -> Response:
    """The best linear approximation at the excited lines.

    runs     of the same period; several with other phases show the nonlinear distortion
    returns  Response; noise: from the scatter over the periods; total: from that over the runs, NaN for
             one run
    source   Pintelon and Schoukens 2012, sec. 2.5 and 4.3: errors in variables, robust method
    """
    excited = np.logical_and.reduce([r.excited for r in runs])
    if not excited.any():
        raise NotEnoughData("spectral lines that every run excites and the sensor measures", "none",
                            "Look at both channels with inspect; give the runs separately, or name the period with "
                            "--period.")
    g, noise, signal, scatter = [], [], 0.0, 0.0
    for run in runs:
        ratio, variance, floor = _response_of_run(run, excited)
        g.append(ratio)
        noise.append(variance)
        signal, scatter = signal + np.abs(run.y[:, excited].mean(axis=0)) ** 2, scatter + floor
    m = len(runs)
    g, mean = np.array(g), np.mean(g, axis=0)
    noise = np.mean(noise, axis=0) / m
    total = np.sum(np.abs(g - mean) ** 2, axis=0) / (m - 1) / m if m > 1 else np.full(excited.sum(), np.nan)
    return Response(runs[0].frequency[excited], mean, noise, total, signal / (signal + scatter), 1.0,
                    float(sum(len(r.u) for r in runs)), "periodic")


def _response_of_run(run: Lines, excited: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(ratio of the means, its variance, variance of the output's mean) of one run."""
    u, y, p = run.u[:, excited], run.y[:, excited], len(run.u)
    um, ym = u.mean(axis=0), y.mean(axis=0)
    du, dy = u - um, y - ym
    scale = p * (p - 1)
    suu, syy = np.sum(np.abs(du) ** 2, axis=0) / scale, np.sum(np.abs(dy) ** 2, axis=0) / scale
    syu = np.sum(dy * np.conj(du), axis=0) / scale
    g = ym / um
    near = min(int(np.ceil(0.5 * (VARIANCE_VALUES / p - 1.0))), MAX_NEIGHBOUR_LINES)
    suu, syy, syu = (smoothed_lines(a, near) for a in (suu, syy, syu))
    # Noise in the feedback is in input and output: the covariance removes it.
    relative = syy / np.abs(ym) ** 2 + suu / np.abs(um) ** 2 - 2.0 * (syu / (ym * np.conj(um))).real
    return g, np.abs(g) ** 2 * np.maximum(relative, 0.0), syy


def smoothed_lines(x: np.ndarray, near: int) -> np.ndarray:
    """(n,) mean over each line of (n,) and up to so many neighbours to either side, with the ends repeated."""
    half = max(min(near, (len(x) - 1) // 2), 0)
    return np.convolve(np.pad(x, half, mode="edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")


def distortions(runs: Sequence[Lines]) -> tuple[DistortionSection, ...]:
    """Even and odd distortion on the lines inside the excited band that carry no excitation.

    Nothing for a kind without such lines: a full multisine hides its distortion.
    The effect of the input on those lines (feedback, a weak actuator) is removed with the response of the
    neighbours.
    source  Pintelon and Schoukens 2012, sec. 4.3.2.2 (fast method)
    """
    found = []
    for kind, parity in (("even", 0), ("odd", 1)):
        level, noise, signal, count = 0.0, 0.0, 0.0, 0
        for run in runs:
            line = np.arange(1, run.u.shape[1] + 1)
            on = np.flatnonzero(run.excited)
            inside = (line > line[on[0]]) & (line < line[on[-1]]) & ~run.excited & (line % 2 == parity)
            if not inside.any():
                continue
            g, _, _ = _response_of_run(run, run.excited)
            near = np.interp(line, line[on], g.real) + 1j * np.interp(line, line[on], g.imag)
            rest = run.y - near * run.u
            mean = rest.mean(axis=0)
            variance = np.sum(np.abs(rest - mean) ** 2, axis=0) / (len(rest) * (len(rest) - 1))
            level, noise = level + np.sum(np.abs(mean[inside]) ** 2), noise + np.sum(variance[inside])
            signal += np.mean(np.abs(run.y.mean(axis=0)[on]) ** 2) * inside.sum()
            count += int(inside.sum())
        if count:
            level, noise, signal = (float(np.sqrt(square / count)) for square in (level, noise, signal))
            lines = count // len(runs)
            found.append(DistortionSection(
                kind, lines, level, noise, signal, _below_signal_db(lines, level, noise, signal)))
    return tuple(found)


def _below_signal_db(lines: int, level: float, noise: float, signal: float) -> float | None:
    """How far the distortion without the noise lies below the signal; None if it is not significant."""
    square = level**2 - noise**2
    seen = level**2 > LEVEL_SIGNIFICANCE * noise**2 * (1.0 / max(lines, 1) ** 0.5 + 0.2)
    return float(10.0 * np.log10(signal**2 / square)) if seen and square > 0.0 and signal > 0.0 else None
