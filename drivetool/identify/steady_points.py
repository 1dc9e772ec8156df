"""From steady intervals to points with an uncertainty that allows for correlated noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from drivetool.drive.chain import Drive
from drivetool.identify.steady_state import block_means, steady_intervals
from drivetool.logs.experiment import Experiment

# Share of an interval that is left out at its start: a settling tail that no longer shows in the
# noise still shifts the mean.
TAIL = 0.25
# Batches per interval. Fewer blur the correction for neighbours, more let noise into it.
BATCHES = 20
# A hidden acceleration may take at most this share of the record's torque.
HIDDEN = 0.01


@dataclass(frozen=True)
class Interval:
    """A steady interval: what was measured, on one grid.

    file, start, end  of which recording, from when to when [s from its first sample]
    step              [s]; role -> (n,) samples of that interval
    """

    file: str
    start: float
    end: float
    step: float
    signals: dict[str, np.ndarray]

    def mean(self, role: str) -> float:
        """Mean of a signal, leaving out what has no value."""
        return float(np.nanmean(self.signals[role]))


def speed_of(experiment: Experiment, body: str, why: str) -> np.ndarray:
    """Speed of a body: as logged, or the central difference of its angle."""
    if f"{body}_speed" not in experiment.signals and f"{body}_angle" in experiment.signals:
        angle = experiment.signals[f"{body}_angle"]
        speed = np.full(len(angle), np.nan)
        for first, last in experiment.segments:
            speed[first + 1:last - 1] = (angle[first + 2:last] - angle[first:last - 2]) / (2 * experiment.step)
        return speed
    return experiment.signal(f"{body}_speed", why)


def find_intervals(experiment: Experiment, body: str = "motor") -> list[Interval]:
    """The steady intervals of a record, settled: without their tails, and none that drifts.

    experiment  with motor_torque and the speed or angle of `body`
    returns     Intervals of at least 2 BATCHES samples, in order
    """
    speed = speed_of(experiment, body, "the steady intervals")
    torque = experiment.signal("motor_torque", "the steady intervals")
    found, _ = steady_intervals([speed, torque], experiment.segments)
    inertia = _rough_inertia(speed, torque, experiment)
    rms = float(np.sqrt(np.nanmean(torque**2)))
    roles = {role: experiment.signals[role] for role in ("shaft_torque", "load_speed", "load_angle")
             if role in experiment.signals}
    if "load_angle" in roles and "load_speed" not in roles:
        roles["load_speed"] = speed_of(experiment, "load", "the steady intervals")
    roles.pop("load_angle", None)
    intervals = []
    for first, last in found:
        first = _settled(speed, first, last, experiment.step, inertia, HIDDEN * rms)
        if first is None or last - first < 2 * BATCHES:
            continue
        part = {"motor_torque": torque, "motor_speed": speed, **roles}
        cut = {role: values[first:last] for role, values in part.items()}
        if all(np.isfinite(values).mean() > 0.5 for values in cut.values()):
            intervals.append(Interval(experiment.name, first * experiment.step, last * experiment.step,
                                      experiment.step, cut))
    return intervals


def _rough_inertia(speed: np.ndarray, torque: np.ndarray, experiment: Experiment) -> float:
    """Inertia of the whole drive from block means, good to a factor of two; 0 if it does not show."""
    best, surest = 0.0, 0.0
    for share in (2000, 500, 100):
        inertia, sure = _regressed_inertia(speed, torque, experiment, max(1, experiment.size // share))
        if sure > surest:
            best, surest = inertia, sure
    return best


def _regressed_inertia(speed: np.ndarray, torque: np.ndarray, experiment: Experiment,
                       length: int) -> tuple[float, float]:
    """(inertia, inertia over its standard error) from means over `length` samples."""
    rows, sums = [], []
    for first, last in experiment.segments:
        w, t = (block_means(x[first:last], length) for x in (speed, torque))
        if len(w) > 2:
            rise = (w[2:] - w[:-2]) / (2 * length * experiment.step)
            rows.append(np.column_stack([rise, w[1:-1], np.ones(len(rise)), np.sign(w[1:-1])]))
            sums.append(t[1:-1])
    if not rows:
        return 0.0, 0.0
    a, b = np.concatenate(rows), np.concatenate(sums)
    known = np.isfinite(a).all(axis=1) & np.isfinite(b)
    a, b = a[known], b[known]
    if len(b) < 8:
        return 0.0, 0.0
    found = np.linalg.lstsq(a, b, rcond=None)[0]
    spread = np.linalg.pinv(a.T @ a)[0, 0] * np.sum((b - a @ found)**2) / len(b)
    return float(found[0]), float(found[0] / np.sqrt(spread)) if spread > 0 else 0.0


def _settled(speed: np.ndarray, first: int, last: int, step: float, inertia: float,
             hidden: float) -> int | None:
    """First sample after the tail; None if the speed drifts on, or is too noisy to tell.

    inertia times the slope of the speed is the torque that a drift takes; it matters from `hidden` on.
    """
    begin = first + round(TAIL * (last - first))
    while last - begin >= max(2 * BATCHES, (last - first) // 3):
        length = (last - begin) // BATCHES
        means = block_means(speed[begin:last], length)
        known = np.flatnonzero(np.isfinite(means))
        if len(known) < BATCHES // 2:
            return None
        line = stats.linregress(known * length * step, means[known])
        if inertia * line.stderr > hidden:
            return None
        if abs(line.slope) <= 4 * line.stderr or inertia * abs(line.slope) <= 0.1 * hidden:
            return begin
        begin += max(1, (last - begin) // 5)
    return None


def mean_variances(series: Sequence[np.ndarray], steps: Sequence[float]) -> tuple[np.ndarray, float]:
    """Variance of the mean of each series of correlated noise, and their degrees of freedom.

    Batch means, with the covariance of neighbouring batches added: noise of the torque adds up over a
    batch, but what only swings to and fro (acceleration of the inertia) is taken back in the next one
    and must not count. The noise is taken as equally strong in all series unless their batches differ
    (Bartlett's test at 0.1 %).

    series   (n_i,) each, n_i >= 2 BATCHES; NaN counts as the mean; steps [s]
    returns  (k,) variances; degrees of freedom
    """
    zero, one, duration = [], [], []
    for values, step in zip(series, steps, strict=True):
        values = np.where(np.isfinite(values), values, np.nanmean(values))
        length = len(values) // BATCHES
        means = block_means(values, length)[:BATCHES]
        off = means - means.mean()
        zero.append(float(off @ off) * length * step)
        one.append(float(off[1:] @ off[:-1]) * length * step)
        duration.append(len(values) * step)
    zero, one, duration = np.array(zero), np.array(one), np.array(duration)
    n, k = BATCHES, len(series)
    if zero.sum() == 0.0:
        return np.zeros(k), float(k * (n - 1))
    # For white noise the sums have the expectations (n-1) and -(n-1)/n times its strength.
    plain = zero / (n - 1)
    strength = float(np.sum(zero + 2 * one)) / (k * (n - 1) * (1 - 2 / n))
    share = max(0.05, strength / float(plain.mean()))
    # A sum of one variance and two covariances is three times as uncertain as a variance.
    if _alike(plain, n - 1):
        return share * plain.mean() / duration, k * (n - 1) / 3
    return share * plain / duration, (n - 1) / 2


def _alike(variances: np.ndarray, dof: int) -> bool:
    """Bartlett's test that variances with equal degrees of freedom are the same."""
    k = len(variances)
    if k < 2:
        return True
    if variances.min() <= 1e-12 * variances.max():
        return False
    spread = dof * (k * np.log(variances.mean()) - np.log(variances).sum())
    return bool(stats.chi2.sf(spread / (1 + (k + 1) / (3 * k * dof)), k - 1) > 1e-3)


def is_standing(speeds: np.ndarray) -> np.ndarray:
    """(k,) which means are standstill: sticking friction takes any torque, so they are on no line."""
    return np.abs(speeds) < 0.01 * np.abs(speeds).max(initial=0.0)


def total_start(drive: Drive, suffix: str) -> float | None:
    """Start value of the sum over all bodies; None if nothing is known."""
    total = f"total.{suffix}"
    if total in drive.values:
        return drive.values[total]
    parts = [drive.values[f"{body}.{suffix}"] for body in drive.bodies if f"{body}.{suffix}" in drive.values]
    return sum(parts) if parts else None
