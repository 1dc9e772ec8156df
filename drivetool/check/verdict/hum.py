"""Lines in the one-step errors: mains, a fan, a structure that rings, whatever the speed of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import find_peaks
from scipy.stats import chi2

from drivetool.check.fit import Model
from drivetool.errors import Finding
from drivetool.identify.noise import filtered

PIECE = 512  # most samples of which a spectrum is made
FEWEST = 8  # pieces that a record must have
AROUND = 41  # frequencies of which the middle one in size is what lies beside a line
CHANCE = 1e-6  # share of spectra without a line in which one would be seen
BOTH = 1.5  # times what is beside it, that a line must have in the slow half of the pieces and in the fast one
APART = 1.25  # by which the halves must differ in speed to tell a line from an order
LEAST = 0.01  # of the errors' variance, below which a line is not worth a word
MOST = 4  # lines that are named
STEEP = 3  # differences of a sensor, after which its motion no longer drowns a line
ANSWER = 0.3  # of a line in the sensor, that the model's answer to the torque must not reach for it to be a hum


@dataclass(frozen=True)
class Line:
    """A line: frequency [Hz], share of the variance of the one-step errors, rms in the sensor itself.

    The filter that foretells makes one-step errors of a fast line larger than it is in the sensor.
    """

    frequency: float
    share: float
    rms: float


def lines_of(model: Model) -> list[Line]:
    """The lines in what a model leaves of the first output, the strongest first; none where speed never changes.

    Nor at frequencies at which the torque moves the drive: what is left there may be an error of the model.
    """
    errors, outputs, runs, speeds, step = _pieces(model)
    if len(errors) < FEWEST or step is None:
        return []
    order = np.argsort(speeds)
    slow, fast = order[:len(order) // 2], order[len(order) // 2:]
    if not speeds[fast].mean() > APART * speeds[slow].mean():
        return []
    size = errors.shape[1]
    power = _power(errors)
    frequency = np.fft.rfftfreq(size, step)[2:-2]
    beside = median_filter(power.mean(axis=0), AROUND, mode="nearest")
    stands = power.mean(axis=0) / beside
    # In the sensor, and in the model's answer: what of the steep part stands out, as flat as it was before.
    flat = (2.0 * np.sin(np.pi * frequency * step)) ** (2 * STEEP)
    sensor, answer = ((p - median_filter(p, AROUND, mode="nearest")) / flat
                      for p in (_power(outputs).mean(axis=0), _power(runs).mean(axis=0)))
    sure = chi2.isf(CHANCE / len(frequency), 2 * len(power)) / (2 * len(power))
    steady = np.minimum(power[slow].mean(axis=0), power[fast].mean(axis=0)) / beside
    found, lines = [], []
    for top in find_peaks(stands, height=sure)[0]:
        low, high = _feet(stands, top)
        share = float(np.sum(power.mean(axis=0)[low:high] - beside[low:high]) / power.mean(axis=0).sum())
        strength = float(sensor[low:high].sum())  # none where motion drowns it: then the torque may move it, too
        hums = strength > 0.0 and answer[low:high].sum() < ANSWER**2 * strength
        stays = np.max(steady[low:high]) > BOTH and share > LEAST
        if stays and hums and not any(low <= f < high for f in found):
            found.append(top)
            lines.append(Line(float(frequency[top]), share, strength**0.5))
    return sorted(lines, key=lambda line: -line.share)[:MOST]


def _power(pieces: np.ndarray) -> np.ndarray:
    """(pieces, frequencies) parts of the variance of each piece, without the lowest and the highest frequencies."""
    window = np.hanning(pieces.shape[1])
    return 2.0 * np.abs(np.fft.rfft(pieces * window, axis=1))[:, 2:-2] ** 2 / (len(window) * np.sum(window**2))


def _feet(stands: np.ndarray, top: int) -> tuple[int, int]:
    """Where a line begins and ends: where it no longer stands out by half."""
    low = high = top
    while low > 0 and stands[low - 1] > BOTH:
        low -= 1
    while high < len(stands) and stands[high] > BOTH:
        high += 1
    return low, high


def _pieces(model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float | None]:
    """One-step errors of the first output, its steep part and that of a free run, mean speeds, sampling time [s].

    (pieces, samples) three times, (pieces,); no step where records differ in it
    """
    traces = model.problem.traces
    size = min(PIECE, sum(t.size for t in traces) // FEWEST)
    plants = model.problem.plants(model.point.values, False)
    errors, outputs, runs, speeds = [], [], [], []
    for f, t, plant, start in zip(filtered(model.problem, model.point, model.noise), traces, plants,
                                  model.point.starts, strict=True):
        run = plant.outputs(t, start)[:, 0]
        for a in range(STEEP, t.size - size + 1, size) if size >= 2 * AROUND else ():
            e, *steep = f.innovations[a:a + size, 0], *(
                np.diff(y[a - STEEP:a + size], STEEP) for y in (t.outputs[:, 0], run))
            if all(np.all(np.isfinite(x)) for x in (e, *steep)):
                errors.append(e - e.mean())
                outputs.append(steep[0])
                runs.append(steep[1])
                speeds.append(np.abs(f.states[a:a + size, 0]).mean())
    step = traces[0].step if len({t.step for t in traces}) == 1 else None
    return *(np.array(p).reshape(len(p), -1) for p in (errors, outputs, runs)), np.array(speeds), step


def hum(model: Model, unit: str) -> list[Finding]:
    """What to say of the lines in the one-step errors of a model."""
    lines: Sequence[Line] = lines_of(model)
    if not lines:
        return []
    told = ", ".join(f"{line.frequency:.4g} Hz ({100.0 * line.share:.2g} %; in the sensor {line.rms:.2g} {unit})"
                     for line in lines)
    return [Finding(
        "note", "one-step-errors-hum",
        f"What the model leaves of each next sample hums at {told}, however fast the drive is: mains, a fan, or a "
        "part that rings and is not in the model.",
        {f"share.{line.frequency:.4g}_hz": line.share for line in lines},
        "Look for it in a record at standstill, with the power stage on and off.")]
