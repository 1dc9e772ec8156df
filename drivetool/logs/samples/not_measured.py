"""Samples of a sensor that nobody measured: repeated, drawn as a straight line, or cut off at the end of its range.

Fits of the physical model do without them: taken for measurements, it would have to explain what the logger did.
Spectra and polynomial models, which need a value at every sample, take them as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivetool.errors import Finding
from drivetool.logs import INPUTS, Experiment, Signal, median_step, quantity
from drivetool.logs.samples.spikes import MAD, despiked, held, quantum, running

LEAST, ENOUGH = 50, 100_000  # samples that tell anything, and that tell whether a sensor is coarse
STRAIGHT = 0.45  # share of the samples that must lie on the line between their neighbours
REGULAR = 0.9  # share of the pieces of line that must be of one length
# Of the largest value, by which a point on a line may be off: numbers of eight bytes or of four, and the rounding
# of the time stamps that it was drawn over.
NEAR, NEAR_SINGLE = 1e-11, 1e-6
CUT, RUN = 0.005, 4  # share of the samples at one end of the range, and how many there in a row, that are no chance
# Standard deviations beyond which a sample of noise is not met in a year of recording at 10 kHz (1.3e-15 each).
UNSUPPORTED = 8.0
WINDOW = 7  # samples that a median is taken of: three bad ones do not carry it away
ALONE = 0.25  # share of its distance from the median that a neighbour of a lone sample stays below
AROUND = 50  # samples before and behind, that tell the noise there
NOISY = 0.1  # share of the samples at which a signal with noise turns back, at least


def unmeasured(signals: Mapping[str, Signal]) -> list[Finding]:
    """What of the sensors' signals, as they were logged, no sensor has measured."""
    return [f for role, signal in signals.items() if role not in INPUTS
            for f in _looked_at(role, np.array(signal.values, float), signal.time)[1]]


def measured(experiment: Experiment) -> Experiment:
    """The experiment with such samples missing: for models that take a sensor's value or none, at any sample."""
    time = experiment.step * np.arange(len(next(iter(experiment.signals.values()))))
    signals = {role: values if role in INPUTS else _looked_at(role, np.array(values, float), time)[0]
               for role, values in experiment.signals.items()}
    return replace(experiment, signals=signals)


def _looked_at(role: str, values: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, list[Finding]]:
    """(the values (n,), unmeasured ones missing; what was found)."""
    findings = []
    if np.isfinite(values).sum() >= LEAST:
        for look in (_repeated, _interpolated, _cut_off, _unsupported):
            missing, found = look(role, values, time)
            values[missing] = np.nan
            findings += found
    return values, findings


Look = tuple[np.ndarray, list[Finding]]


def _repeated(role: str, values: np.ndarray, time: np.ndarray) -> Look:
    """Sensors that were logged faster than they were updated."""
    times = held(values)
    if times < 2:
        return np.zeros(len(values), bool), []
    step = median_step(time)
    return np.concatenate([[False], values[1:] == values[:-1]]), [Finding(
        "warning", "held-samples",
        f"{role} repeats every value {times} times: it comes at {1 / (times * step):.4g} Hz and was logged at "
        f"{1 / step:.4g} Hz, up to {1e3 * step:.3g} ms late. Physical models are fitted without the repeats.",
        {"role": role, "repeats": times, "step": step},
        "Log it at its own rate, or with the time stamp of the sensor.")]


def _interpolated(role: str, values: np.ndarray, time: np.ndarray) -> Look:
    """Sensors of which a logger has drawn straight lines between the values that it had."""
    inside, none = _on_a_line(values), np.zeros(len(values), bool)
    if inside.mean() < STRAIGHT:
        return none, []
    lengths = np.diff(np.flatnonzero(~inside & np.isfinite(values)))
    usual = int(np.median(lengths)) if len(lengths) else 0
    if usual < 2 or np.mean(lengths == usual) < REGULAR:
        return none, []
    step = median_step(time)
    return inside, [Finding(
        "warning", "interpolated", f"{role} lies on straight lines over {usual} samples each: it comes at "
        f"{1 / (usual * step):.4g} Hz and was interpolated. Physical models are fitted without what is between.",
        {"role": role, "pieces": usual, "step": step}, "Log it at its own rate, without interpolation.")]


def _on_a_line(values: np.ndarray) -> np.ndarray:
    """(n,) whether a sample lies between its neighbours as exactly as its digits allow, while the signal moves."""
    with np.errstate(over="ignore"):
        single = np.array_equal(values.astype(np.float32).astype(float), values, equal_nan=True)
    near = (NEAR_SINGLE if single else NEAR) * float(np.nanmax(np.abs(values)))
    inside = np.zeros(len(values), bool)
    with np.errstate(invalid="ignore"):
        bend = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
        inside[1:-1] = (bend <= near) & (values[2:] != values[1:-1])
    # A coarse sensor in steady motion moves by whole steps, and is on a line by chance.
    return np.zeros(len(values), bool) if _steps(values) else inside


def _cut_off(role: str, values: np.ndarray, _: np.ndarray) -> Look:
    """Sensors that stop at the end of their range while the motion goes on."""
    missing, findings = np.zeros(len(values), bool), []
    known = values[np.isfinite(values)]
    if _steps(known) or not _noisy(known):
        return missing, []
    for end in (known.max(), known.min()):
        there = values == end
        # Standstill is exactly zero without anything cut off.
        if end == 0.0 or there.sum() < max(CUT * len(known), RUN) or _longest(there) < RUN:
            continue
        missing |= there
        findings.append(Finding(
            "warning", "cut-off", f"{role} is exactly {end:.6g} at {100.0 * there.mean():.2g} % of its samples and "
            "never beyond: it is cut off there. Physical models are fitted without those.",
            {"role": role, "limit": float(end), "share": float(there.mean())},
            "Widen the range of the sensor or of its channel."))
    return missing, findings


def _unsupported(role: str, values: np.ndarray, _: np.ndarray) -> Look:
    """Single samples of a motion that no neighbour supports: what has mass does not jump there and back."""
    missing = np.zeros(len(values), bool)
    if quantity(role) == "torque":  # that of a shaft may: a gap that closes makes a peak of one sample
        return missing, []
    known = np.flatnonzero(np.isfinite(values))
    given = values[known]
    alone = _alone(given)
    if not alone.any():
        return missing, []
    value, count = _usual_value(given[alone])
    dropped = count > 1 and count >= 0.5 * alone.sum()
    if dropped and not _steps(given[~alone]):
        # A signal with noise has no value twice; where it has this one, the sensor had none.
        alone |= given == value
    missing[known[alone]] = True
    share = 100.0 * missing.sum() / len(known)
    what = f"drops to exactly {value:.6g}" if dropped else "has outliers"
    return missing, [Finding(
        "warning", "unsupported-samples", f"{role} {what}: {missing.sum()} samples ({share:.2g} %) are "
        f"{UNSUPPORTED:g} standard deviations and more from all that is near them. Physical models are fitted "
        "without those.", {"role": role, "samples": int(missing.sum()), "of": len(known)},
        "Check the sensor and its bus for values that come late.")]


def _alone(values: np.ndarray) -> np.ndarray:
    """(n,) whether a sample stands out of the noise around it, and neither of its neighbours with it."""
    _, away = despiked(values, WINDOW, UNSUPPORTED)
    away[:WINDOW] = away[-WINDOW:] = False  # at an end, motion that goes on stands out as well
    off = values - running(values, WINDOW // 2)[0]
    least = 0.5 * quantum(values)  # noise that a coarse sensor may hide
    calm, alone = np.where(away, 0.0, off), np.zeros(len(values), bool)
    for k in np.flatnonzero(away):
        near = slice(max(k - AROUND, 0), k + AROUND)
        rough = np.abs(np.diff(values[near][~away[near]], 2)) / np.sqrt(6)
        noise = max(MAD * np.median(np.abs(calm[near])), MAD * np.median(rough), least)
        # Of a peak that was measured at least one neighbour goes a good part of the way, half of it in a triangle.
        side = max(calm[k - 1] * np.sign(off[k]), calm[k + 1] * np.sign(off[k]))
        alone[k] = abs(off[k]) > UNSUPPORTED * noise and side < ALONE * abs(off[k])
    return alone


def _usual_value(values: np.ndarray) -> tuple[float, int]:
    """The value that appears most often, and how often."""
    each, counts = np.unique(values, return_counts=True)
    return float(each[counts.argmax()]), int(counts.max())


def _steps(values: np.ndarray) -> bool:
    """Whether a sensor is coarse."""
    return bool(quantum(values[np.isfinite(values)][:ENOUGH]))


def _noisy(values: np.ndarray) -> bool:
    """Whether a signal has noise, so that steady motion does not repeat its values."""
    change = np.diff(values)
    return bool(np.mean(change[1:] * change[:-1] < 0.0) > NOISY)


def _longest(mask: np.ndarray) -> int:
    """Length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))
