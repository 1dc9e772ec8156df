"""Narrow-band lines in the one-step prediction errors, independent of speed: mains, a fan, a resonance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.check.fit import Model
from drivetool.finding import Finding
from drivetool.identify.noise import filtered

# Samples of a spectrum at most. A choice: longer pieces resolve closer lines, shorter ones leave more to average.
MAX_SPECTRUM_SAMPLES = 512
# Pieces. A choice: four slow and four fast ones; a mean over fewer is too uncertain to compare the halves.
MIN_SPECTRUM_PIECES = 8
BACKGROUND_FREQUENCIES = 41  # frequencies of the median that estimates the background: many more than a line has
# False alarms per spectrum without a line. A choice: a false line is worse than a missed one.
FALSE_LINE_PROBABILITY = 1e-6
# Height over the background in the slow and in the fast half of the pieces. A choice: an order is in one half only.
MIN_LINE_TO_BACKGROUND = 1.5
# Ratio of the halves' mean speeds: an order then moves by a quarter of its frequency, a line stays.
MIN_SPEED_RATIO = 1.25
# Of the errors' variance. A choice: a smaller line changes their rms by less than 0.5 %.
MIN_LINE_VARIANCE_SHARE = 0.01
MAX_SPECTRAL_LINES = 4  # a choice: the strongest lines fill one sentence
DIFFERENCE_ORDER = 3  # differences of a sensor, after which the slow motion no longer masks a line
# Amplitude of the model's response to the torque over that of the line. A choice: above, the torque may excite it.
MAX_RESPONSE_RATIO = 0.3


@dataclass(frozen=True)
class NarrowbandLine:
    """A line: frequency [Hz], share of the variance of the one-step prediction errors, rms in the sensor itself.

    The filter amplifies a line of high frequency: it is larger in the prediction errors than in the sensor.
    """

    frequency: float
    share: float
    rms: float


def find_narrowband_lines(model: Model) -> list[NarrowbandLine]:
    """The lines in the one-step prediction errors of the first output, strongest first; none at constant speed.

    Frequencies at which the torque moves the drive are left out: a residual there may be an error of the model.
    """
    errors, outputs, runs, speeds, step = _residual_pieces(model)
    if len(errors) < MIN_SPECTRUM_PIECES or step is None:
        return []
    order = np.argsort(speeds)
    slow, fast = order[:len(order) // 2], order[len(order) // 2:]
    if not speeds[fast].mean() > MIN_SPEED_RATIO * speeds[slow].mean():
        return []
    size = errors.shape[1]
    power = _power_spectra(errors)
    frequency = np.fft.rfftfreq(size, step)[2:-2]
    background = scipy.ndimage.median_filter(power.mean(axis=0), BACKGROUND_FREQUENCIES, mode="nearest")
    contrast = power.mean(axis=0) / background
    # In the sensor and in the model's response: the excess of the differences over the background, integrated.
    flat = (2.0 * np.sin(np.pi * frequency * step)) ** (2 * DIFFERENCE_ORDER)
    sensor, response = ((p - scipy.ndimage.median_filter(p, BACKGROUND_FREQUENCIES, mode="nearest")) / flat
                        for p in (_power_spectra(outputs).mean(axis=0), _power_spectra(runs).mean(axis=0)))
    threshold = scipy.stats.chi2.isf(FALSE_LINE_PROBABILITY / len(frequency), 2 * len(power)) / (2 * len(power))
    steady = np.minimum(power[slow].mean(axis=0), power[fast].mean(axis=0)) / background
    found, lines = [], []
    for top in scipy.signal.find_peaks(contrast, height=threshold)[0]:
        low, high = _line_limits(contrast, top)
        share = float(np.sum(power.mean(axis=0)[low:high] - background[low:high]) / power.mean(axis=0).sum())
        strength = float(sensor[low:high].sum())  # none where motion masks it: then the torque may excite it, too
        not_excited = strength > 0.0 and response[low:high].sum() < MAX_RESPONSE_RATIO**2 * strength
        at_both_speeds = np.max(steady[low:high]) > MIN_LINE_TO_BACKGROUND and share > MIN_LINE_VARIANCE_SHARE
        if at_both_speeds and not_excited and not any(low <= f < high for f in found):
            found.append(top)
            lines.append(NarrowbandLine(float(frequency[top]), share, strength**0.5))
    return sorted(lines, key=lambda line: -line.share)[:MAX_SPECTRAL_LINES]


def _power_spectra(pieces: np.ndarray) -> np.ndarray:
    """(pieces, frequencies) share of the variance of each piece, without the lowest and the highest frequencies."""
    window = np.hanning(pieces.shape[1])
    return 2.0 * np.abs(np.fft.rfft(pieces * window, axis=1))[:, 2:-2] ** 2 / (len(window) * np.sum(window**2))


def _line_limits(contrast: np.ndarray, top: int) -> tuple[int, int]:
    """First and last index of a line: up to where it exceeds the background by less than half."""
    low = high = top
    while low > 0 and contrast[low - 1] > MIN_LINE_TO_BACKGROUND:
        low -= 1
    while high < len(contrast) and contrast[high] > MIN_LINE_TO_BACKGROUND:
        high += 1
    return low, high


def _residual_pieces(model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float | None]:
    """One-step prediction errors of the first output, differences of it and of a free run, mean speeds, time step.

    (pieces, samples) three times, (pieces,); [s], None where records differ in it
    """
    traces = model.problem.traces
    size = min(MAX_SPECTRUM_SAMPLES, sum(t.size for t in traces) // MIN_SPECTRUM_PIECES)
    plants = model.problem.plants(model.point.values, False)
    errors, outputs, runs, speeds = [], [], [], []
    for f, t, plant, start in zip(filtered(model.problem, model.point, model.noise), traces, plants,
                                  model.point.starts, strict=True):
        run = plant.outputs(t, start)[:, 0]
        for a in range(DIFFERENCE_ORDER, t.size - size + 1, size) if size >= 2 * BACKGROUND_FREQUENCIES else ():
            e, *differences = f.innovations[a:a + size, 0], *(
                np.diff(y[a - DIFFERENCE_ORDER:a + size], DIFFERENCE_ORDER) for y in (t.outputs[:, 0], run))
            if all(np.all(np.isfinite(x)) for x in (e, *differences)):
                errors.append(e - e.mean())
                outputs.append(differences[0])
                runs.append(differences[1])
                speeds.append(np.abs(f.states[a:a + size, 0]).mean())
    step = traces[0].step if len({t.step for t in traces}) == 1 else None
    return *(np.array(p).reshape(len(p), -1) for p in (errors, outputs, runs)), np.array(speeds), step


def narrowband_findings(model: Model, unit: str) -> list[Finding]:
    """Findings on narrow-band lines in the one-step prediction errors of a model."""
    lines: Sequence[NarrowbandLine] = find_narrowband_lines(model)
    if not lines:
        return []
    listed = ", ".join(
        f"{line.frequency:.4g} Hz ({100.0 * line.share:.2g} %; rms {line.rms:.2g} {unit} at the sensor)"
        for line in lines)
    return [Finding(
        "note", "narrow-band-disturbance",
        f"The one-step prediction errors have a narrow-band disturbance at {listed}, independent of speed: "
        "mains, a fan, or an unmodelled resonance.",
        {f"share.{line.frequency:.4g}_hz": line.share for line in lines},
        "Look for it in a record at standstill, with the power stage on and off.")]
