"""Samples that no sensor measured: repeated, interpolated linearly, or saturated at the end of the range.

Fits of the physical model omit them: otherwise the model would have to explain what the logger did.
Spectra and polynomial models, which need a value at every sample, take them as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivetool.finding import Finding
from drivetool.logs import INPUTS, Experiment, Signal, median_step, quantity, true_runs
from drivetool.logs.samples.spikes import STD_PER_MAD, hold_count, quantisation_step, remove_spikes, running_median

# A choice: fewer samples give no shares to test; more do not change whether a sensor is quantised, and take longer.
MIN_SENSOR_SAMPLES, MAX_QUANTUM_SAMPLES = 50, 100_000
# Share of the samples that lie on the line between their neighbours: linear interpolation by a factor of two gives
# half, less some at its ends.
MIN_ON_LINE_SHARE = 0.45
# Share of the line pieces of one length. A choice: real motion has pieces of varying length.
MIN_EQUAL_PIECES_SHARE = 0.9
# Tolerance of a point on a line, as a share of the largest value, for numbers of eight and of four bytes: their
# rounding, and that of the time stamps of the interpolation.
LINE_TOLERANCE, SINGLE_LINE_TOLERANCE = 1e-11, 1e-6
# Share of the samples exactly at one end of the range, and how many in a row. A choice: a signal with noise reaches
# its extreme value once or twice by chance, not for longer.
MIN_SATURATED_SHARE, MIN_SATURATED_RUN = 0.005, 4
# Standard deviations that normal noise does not exceed in a year of recording at 10 kHz (1.3e-15 each sample).
OUTLIER_THRESHOLD = 8.0
MEDIAN_WINDOW = 7  # samples of the running median: up to three outliers among them do not shift it
# A neighbour of an isolated outlier has less than this share of its distance. In a measured triangle it has half.
MAX_NEIGHBOUR_SHARE = 0.25
# Samples before and after that give the local noise. A choice: fewer scatter, more mix operating points.
NOISE_HALF_WINDOW = 50
# White noise reverses its change at two of three samples, smooth motion hardly ever. A choice between them.
MIN_REVERSAL_SHARE = 0.1


def unmeasured_findings(signals: Mapping[str, Signal]) -> list[Finding]:
    """Findings about samples of the sensors' signals, as logged, that no sensor measured."""
    return [f for role, signal in signals.items() if role not in INPUTS
            for f in _mask_unmeasured(role, np.array(signal.values, float), signal.time)[1]]


def without_unmeasured(experiment: Experiment) -> Experiment:
    """The experiment with such samples as NaN: for models in which a sensor may lack a value at any sample."""
    time = experiment.step * np.arange(len(next(iter(experiment.signals.values()))))
    signals = {role: values if role in INPUTS else _mask_unmeasured(role, np.array(values, float), time)[0]
               for role, values in experiment.signals.items()}
    return replace(experiment, signals=signals)


def _mask_unmeasured(role: str, values: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, list[Finding]]:
    """(the values (n,), unmeasured ones missing; what was found)."""
    findings = []
    if np.isfinite(values).sum() >= MIN_SENSOR_SAMPLES:
        for detect in (_detect_held, _detect_interpolated, _detect_saturated, _detect_isolated):
            missing, found = detect(role, values, time)
            values[missing] = np.nan
            findings += found
    return values, findings


Detection = tuple[np.ndarray, list[Finding]]


def _detect_held(role: str, values: np.ndarray, time: np.ndarray) -> Detection:
    """Sensors that were logged faster than they were updated."""
    times = hold_count(values)
    if times < 2:
        return np.zeros(len(values), bool), []
    step = median_step(time)
    return np.concatenate([[False], values[1:] == values[:-1]]), [Finding(
        "warning", "samples-not-measured",
        f"{role} repeats every value {times} times: it is updated at {1 / (times * step):.4g} Hz and was logged at "
        f"{1 / step:.4g} Hz, up to {1e3 * step:.3g} ms late. Fits of physical models exclude the repeated values.",
        {"role": role, "repeats": times, "step": step},
        "Log it at its own rate, or with the time stamp of the sensor.")]


def _detect_interpolated(role: str, values: np.ndarray, time: np.ndarray) -> Detection:
    """Sensors of which a logger has drawn straight lines between the values that it had."""
    inside = _between_neighbours(values)
    lengths = np.diff(np.flatnonzero(~inside & np.isfinite(values)))
    usual = int(np.median(lengths)) if len(lengths) else 0
    if inside.mean() < MIN_ON_LINE_SHARE or usual < 2 or np.mean(lengths == usual) < MIN_EQUAL_PIECES_SHARE:
        return np.zeros(len(values), bool), []
    step = median_step(time)
    return inside, [Finding(
        "warning", "samples-not-measured", f"{role} is linear over {usual} samples each: it was measured at "
        f"{1 / (usual * step):.4g} Hz and interpolated. Fits of physical models exclude the interpolated samples.",
        {"role": role, "pieces": usual, "step": step}, "Log it at its own rate, without interpolation.")]


def _between_neighbours(values: np.ndarray) -> np.ndarray:
    """(n,) whether a sample lies between its neighbours as exactly as its digits allow, while the signal moves."""
    with np.errstate(over="ignore"):
        single = np.array_equal(values.astype(np.float32).astype(float), values, equal_nan=True)
    tolerance = (SINGLE_LINE_TOLERANCE if single else LINE_TOLERANCE) * float(np.nanmax(np.abs(values)))
    inside = np.zeros(len(values), bool)
    with np.errstate(invalid="ignore"):
        second_difference = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
        inside[1:-1] = (second_difference <= tolerance) & (values[2:] != values[1:-1])
    # A quantised sensor in steady motion moves by whole steps, and lies on a line by chance.
    return np.zeros(len(values), bool) if _is_quantised(values) else inside


def _detect_saturated(role: str, values: np.ndarray, _: np.ndarray) -> Detection:
    """Sensors that stop at the end of their range while the motion goes on."""
    missing, findings = np.zeros(len(values), bool), []
    known = values[np.isfinite(values)]
    if _is_quantised(known) or not _has_noise(known):
        return missing, []
    for end in (known.max(), known.min()):
        there = values == end
        # Standstill is exactly zero without saturation.
        if end == 0.0 or there.sum() < max(MIN_SATURATED_SHARE * len(known), MIN_SATURATED_RUN) or \
                np.diff(true_runs(there)).max() < MIN_SATURATED_RUN:
            continue
        missing |= there
        findings.append(Finding(
            "warning", "signal-saturated",
            f"{role} is exactly {end:.6g} at {100.0 * there.mean():.2g} % of its samples and "
            "never beyond: it is saturated there. Fits of physical models exclude these samples.",
            {"role": role, "limit": float(end), "share": float(there.mean())},
            "Widen the range of the sensor or of its channel."))
    return missing, findings


def _detect_isolated(role: str, values: np.ndarray, _: np.ndarray) -> Detection:
    """Isolated outliers of a motion: a body with inertia does not jump to them and back within one sample."""
    missing = np.zeros(len(values), bool)
    if quantity(role) == "torque":  # a shaft torque may: closing backlash makes a peak of one sample
        return missing, []
    known = np.flatnonzero(np.isfinite(values))
    values_known = values[known]
    isolated = _isolated_outliers(values_known)
    if not isolated.any():
        return missing, []
    value, count = _most_frequent_value(values_known[isolated])
    dropped = count > 1 and count >= 0.5 * isolated.sum()
    if dropped and not _is_quantised(values_known[~isolated]):
        # A signal with noise repeats no value; where this one repeats, the sensor gave none.
        isolated |= values_known == value
    missing[known[isolated]] = True
    share = 100.0 * missing.sum() / len(known)
    what = f"drops to exactly {value:.6g}" if dropped else "has outliers"
    return missing, [Finding(
        "warning", "outliers-left-out", f"{role} {what}: {missing.sum()} samples ({share:.2g} %) are "
        f"{OUTLIER_THRESHOLD:g} standard deviations and more from the samples around them. Fits of physical "
        "models exclude these samples.", {"role": role, "samples": int(missing.sum()), "of": len(known)},
        "Check the sensor and its bus for delayed values.")]


def _isolated_outliers(values: np.ndarray) -> np.ndarray:
    """(n,) whether a sample, but neither of its neighbours, is an outlier of the noise around it."""
    _, outliers = remove_spikes(values, MEDIAN_WINDOW, OUTLIER_THRESHOLD)
    # At an end, continuing motion exceeds the threshold as well.
    outliers[:MEDIAN_WINDOW] = outliers[-MEDIAN_WINDOW:] = False
    deviation = values - running_median(values, MEDIAN_WINDOW // 2)[0]
    least = 0.5 * quantisation_step(values)  # noise below the quantisation step
    inliers, alone = np.where(outliers, 0.0, deviation), np.zeros(len(values), bool)
    for k in np.flatnonzero(outliers):
        window = slice(max(k - NOISE_HALF_WINDOW, 0), k + NOISE_HALF_WINDOW)
        bends = np.abs(np.diff(values[window][~outliers[window]], 2)) / np.sqrt(6)
        noise = max(STD_PER_MAD * np.median(np.abs(inliers[window])), STD_PER_MAD * np.median(bends), least)
        # In a measured peak at least one neighbour has a good part of the height, half of it in a triangle.
        side = max(inliers[k - 1] * np.sign(deviation[k]), inliers[k + 1] * np.sign(deviation[k]))
        alone[k] = abs(deviation[k]) > OUTLIER_THRESHOLD * noise and side < MAX_NEIGHBOUR_SHARE * abs(deviation[k])
    return alone


def _most_frequent_value(values: np.ndarray) -> tuple[float, int]:
    """The value that appears most often, and how often."""
    each, counts = np.unique(values, return_counts=True)
    return float(each[counts.argmax()]), int(counts.max())


def _is_quantised(values: np.ndarray) -> bool:
    """Whether a sensor is visibly quantised."""
    return bool(quantisation_step(values[np.isfinite(values)][:MAX_QUANTUM_SAMPLES]))


def _has_noise(values: np.ndarray) -> bool:
    """Whether a signal has noise, so that steady motion does not repeat its values."""
    change = np.diff(values)
    return bool(np.mean(change[1:] * change[:-1] < 0.0) > MIN_REVERSAL_SHARE)
