"""Steady intervals of a record, and means over them with an uncertainty that allows for correlated noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.identify.plateaus.state import block_means, steady_intervals
from drivetool.logs import Experiment

# Share of an interval that is left out at its start, a choice: a settling tail hidden by the noise still shifts the
# mean.
SETTLING_SHARE = 0.25
# Batches per interval, most first. A choice: three lengths show how the variance falls, five still give a variance.
BATCH_COUNTS = (15, 10, 5)
# Time constants of noise that are fitted, as shares of an interval. A choice, up to the longest batch, a fifth.
NOISE_TIME_CONSTANT_SHARES = (1 / 30, 1 / 12, 1 / 5)
# A hidden acceleration may take at most this share of the record's torque: it biases the friction by as much.
MAX_HIDDEN_TORQUE_SHARE = 0.01


@dataclass(frozen=True)
class SteadyInterval:
    """A steady interval: what was measured, on one grid.

    file, start, end  of which recording, from when to when [s from its start]
    step              [s]
    rise, rise_std    what is left of the acceleration: change of speed from the first to the last tenth,
                      over the duration, and its standard deviation
    fastest           speed that the record exceeds 1 % of the time
    inertia           role of a torque -> inertia that it accelerates, good to a few percent; 0 if unknown
    signals           role -> (n,) samples of that interval
    """

    file: str
    start: float
    end: float
    step: float
    rise: float
    rise_std: float
    fastest: float
    inertia: Mapping[str, float]
    signals: Mapping[str, np.ndarray]

    def mean(self, role: str) -> float:
        """Mean of a signal, leaving out what has no value."""
        return float(np.nanmean(self.signals[role]))


def speed_of(experiment: Experiment, body: str, why: str, spacing: int = 1) -> np.ndarray:
    """Speed of a body: as logged, or the central difference of its angle, so many samples to either side."""
    if f"{body}_speed" not in experiment.signals and f"{body}_angle" in experiment.signals:
        angle = experiment.signals[f"{body}_angle"]
        speed = np.full(len(angle), np.nan)
        for a, b in experiment.segments:
            if b - a > 2 * spacing:
                speed[a + spacing:b - spacing] = (angle[a + 2 * spacing:b] - angle[a:b - 2 * spacing]) / (
                    2 * spacing * experiment.step)
        return speed
    return experiment.signal(f"{body}_speed", why)


def find_intervals(experiment: Experiment) -> list[SteadyInterval]:
    """The steady intervals of a record, settled: without their tails, and none that drifts.

    experiment  with motor_torque and the speed or angle of the motor
    returns     Intervals of at least 30 samples, in order; "difference" is motor less shaft torque
    """
    why = "the steady intervals"
    roles = {"motor_torque": experiment.signal("motor_torque", why),
             "motor_speed": speed_of(experiment, "motor", why)}
    if "motor_torque" in experiment.magnitudes:
        # At constant speed a motor that drives has the sign of the motion.
        roles["motor_torque"] = np.abs(roles["motor_torque"]) * np.sign(roles["motor_speed"])
    torque, speed = roles["motor_torque"], roles["motor_speed"]
    if "shaft_torque" in experiment.signals:
        roles["shaft_torque"] = experiment.signals["shaft_torque"]
        roles["difference"] = torque - roles["shaft_torque"]
    if {"load_speed", "load_angle"} & set(experiment.signals):
        roles["load_speed"] = speed_of(experiment, "load", why)
    inertia = {role: rough_inertia(speed, values, experiment) for role, values in roles.items()
               if not role.endswith("speed")}
    fastest = float(np.nanquantile(np.abs(speed), 0.99))
    max_hidden_torque = MAX_HIDDEN_TORQUE_SHARE * float(np.sqrt(np.nanmean(torque**2)))
    intervals = []
    found, _ = steady_intervals([speed, torque], experiment.segments)
    for first, last in found:
        settled = _settled_from(speed, first, last, experiment.step, inertia["motor_torque"], max_hidden_torque)
        cut = {role: values[settled:last] for role, values in roles.items()} if settled is not None else {}
        if cut and all(np.isfinite(values).mean() > 0.5 for values in cut.values()):
            rise, rise_std = _mean_acceleration(cut["motor_speed"], experiment.step)
            start, end = (experiment.offset + i * experiment.step for i in (settled, last))
            intervals.append(SteadyInterval(experiment.name, start, end, experiment.step, rise, rise_std, fastest,
                                      inertia, cut))
    return intervals


def rough_inertia(speed: np.ndarray, torque: np.ndarray, experiment: Experiment) -> float:
    """Inertia that a torque accelerates, from block means over the whole record; 0 if it is not significant."""
    best, best_ratio = 0.0, 10.0
    for share in (2000, 500, 100):
        inertia, ratio = _regressed_inertia(speed, torque, experiment, max(1, experiment.size // share))
        if ratio > best_ratio:
            best, best_ratio = inertia, ratio
    return best


def _regressed_inertia(speed: np.ndarray, torque: np.ndarray, experiment: Experiment,
                       length: int) -> tuple[float, float]:
    """(inertia, inertia over its standard error) from means over `length` samples."""
    rows, sums = [], []
    for first, last in experiment.segments:
        w, t = (block_means(x[first:last], length) for x in (speed, torque))
        if len(w) > 2:
            # Weighted like the mean torque of three blocks, so that a corner in the speed matters little.
            rise = (w[2:] - w[:-2]) / (2 * length * experiment.step)
            rows.append(np.column_stack([rise, w[1:-1], np.ones(len(rise)), np.sign(w[1:-1])]))
            sums.append((t[2:] + 2 * t[1:-1] + t[:-2]) / 4)
    if not rows:
        return 0.0, 0.0
    a, b = np.concatenate(rows), np.concatenate(sums)
    known = np.isfinite(a).all(axis=1) & np.isfinite(b)
    a, b = a[known], b[known]
    if len(b) < 8:
        return 0.0, 0.0
    found = np.linalg.lstsq(a, b, rcond=None)[0]
    variance = np.linalg.pinv(a.T @ a)[0, 0] * np.sum((b - a @ found)**2) / len(b)
    return float(found[0]), float(found[0] / np.sqrt(variance)) if variance > 0 else 0.0


def _settled_from(speed: np.ndarray, first: int, last: int, step: float, inertia: float,
                  max_hidden_torque: float) -> int | None:
    """First sample after the tail; None if the speed drifts on, or is too noisy for a decision.

    inertia times the slope of the speed is the torque that a drift takes; it matters from `hidden` on.
    """
    begin = first + round(SETTLING_SHARE * (last - first))
    while last - begin >= max(2 * BATCH_COUNTS[0], (last - first) // 3):
        length = (last - begin) // BATCH_COUNTS[0]
        means = block_means(speed[begin:last], length)
        known = np.flatnonzero(np.isfinite(means))
        if len(known) < BATCH_COUNTS[0] // 2:
            return None
        line = scipy.stats.linregress(known * length * step, means[known])
        if inertia * line.stderr > max_hidden_torque:
            return None
        if abs(line.slope) <= 4 * line.stderr or inertia * abs(line.slope) <= 0.1 * max_hidden_torque:
            return begin
        begin += max(1, (last - begin) // 5)
    return None


def _mean_acceleration(speed: np.ndarray, step: float) -> tuple[float, float]:
    """(mean acceleration, its standard deviation) over an interval."""
    means = block_means(speed, len(speed) // BATCH_COUNTS[0])[:BATCH_COUNTS[0]]
    means = means[np.isfinite(means)]
    # The tenths are nine tenths of the duration from each other, but their distance from its ends is part of it.
    change = means[-2:].mean() - means[:2].mean()
    noise = np.diff(means).std() / np.sqrt(2)
    duration = len(speed) * step
    return float(change / duration), float(noise / duration)


def mean_variances(series: Sequence[np.ndarray], steps: Sequence[float]) -> tuple[np.ndarray, float]:
    """Variance of the mean of each series of correlated noise, and its degrees of freedom.

    Three kinds of noise have a mean over a time L of known variance: white, a/L; with a memory tau, that of a
    first-order lag; and what is taken back, like the torque that accelerates the inertia to and fro, 1/L^2 once
    L is longer than the taking back lasts. Weights of these that are not negative, for a few memories up to a
    fifth of the duration, are fitted to the scatter of batch means of several lengths, in all the series
    together, and give the variance at the full length. A series whose batches scatter differently from the
    others (Bartlett's test at 0.1 %) uses its own scatter.

    series   (n_i,) each, n_i >= 2 max(BATCH_COUNTS); NaN counts as the mean; steps [s]
    returns  (k,) variances; degrees of freedom
    """
    duration = np.array([len(values) * step for values, step in zip(series, steps, strict=True)])
    scatter = np.array([_batch_variances(values) for values in series])
    # A constant, as a commanded torque is: what is left are rounding errors.
    if scatter.max() <= 1e-20 * max(float(np.nanmax(np.square(values))) for values in series):
        return np.zeros(len(series)), float(len(series) * (BATCH_COUNTS[0] - 1))
    count = np.array(BATCH_COUNTS)[None, :]
    time_constants = np.median(duration) * np.array(NOISE_TIME_CONSTANT_SHARES)
    whole = _mean_variance(duration[:, None], time_constants)
    # Expectation of the scatter about the series' own mean, which takes the variance at full length off.
    terms = (_mean_variance(duration[:, None] / count, time_constants) - whole) * (count / (count - 1))[..., None]
    strength = _fit_noise_strengths(terms.reshape(-1, terms.shape[-1]), scatter.ravel(),
                                    np.broadcast_to(count - 1, scatter.shape).ravel())
    # If all the noise is taken back, the mean over n batches has 1/n^2 of their variance; no less.
    variance = np.maximum(whole[:, 0] @ strength, scatter[:, 0].mean() / BATCH_COUNTS[0]**2)
    # The full length lies beyond the longest batches: their estimate of it counts for a tenth of their freedom.
    dof = max(3.0, len(series) * (BATCH_COUNTS[-1] - 1) / 10)
    ratio = scatter[:, 0] / np.maximum(terms[:, 0] @ strength, 0.1 * scatter[:, 0].mean())
    if _equal_variances(ratio, BATCH_COUNTS[0] - 1):
        return variance, dof
    return variance * ratio, min(dof, float(BATCH_COUNTS[0] - 1))


def _batch_variances(values: np.ndarray) -> list[float]:
    """Variance between batch means, for each number of batches."""
    values = np.where(np.isfinite(values), values, np.nanmean(values))
    return [float(np.var(block_means(values, len(values) // n)[:n], ddof=1)) for n in BATCH_COUNTS]


def _mean_variance(length: np.ndarray, time_constants: np.ndarray) -> np.ndarray:
    """(..., 2 m + 2) variance of the mean over a time [s] of each kind of noise of unit strength; see above."""
    x = length[..., None] / time_constants
    decay = 1.0 - np.exp(-x)
    length = length[..., None]
    return np.concatenate([1.0 / length, (1.0 - decay / x) / length, 1.0 / length**2, decay / length**2], axis=-1)


def _fit_noise_strengths(terms: np.ndarray, scatter: np.ndarray, dof: np.ndarray) -> np.ndarray:
    """Weights of scatter = terms @ weights, none negative.

    A variance with `dof` degrees of freedom has a relative standard deviation of sqrt(2/dof).
    """
    scale = terms.mean(axis=0)
    predicted = np.full(len(scatter), scatter.mean())
    for _ in range(12):
        weight = np.sqrt(dof / 2) / predicted
        found, _ = scipy.optimize.nnls(terms / scale * weight[:, None], scatter * weight)
        predicted = np.maximum(terms / scale @ found, 0.1 * scatter.mean())
    return found / scale


def _equal_variances(variances: np.ndarray, dof: int) -> bool:
    """Bartlett's test that variances with equal degrees of freedom are the same."""
    k = len(variances)
    if k < 2:
        return True
    if variances.min() <= 1e-12 * variances.max():
        return False
    statistic = dof * (k * np.log(variances.mean()) - np.log(variances).sum())
    return bool(scipy.stats.chi2.sf(statistic / (1 + (k + 1) / (3 * k * dof)), k - 1) > 1e-3)
