"""Is the torque logged in the cycle in which it acts? A test by a fitted model.

Drives log the torque of the previous cycle, or the command of the next one. Taken as logged, it biases inertias by
several per cent, and the residual resembles that of a further mass. The same model is fitted with the torque some
samples earlier and later; the likelihood of thousands of samples distinguishes them. A model that lacks something
else is not tested: a shift would compensate for part of that.

A torque that is measured, not held, acts between its samples, half a sample from one that is late. So the mean of
two neighbours is fitted as well, and whole samples have to be likelier than that. A low-pass in front of the logger
makes the torque late as well, one behind the command early. A shift explains them only in part, so the torque is
also fitted without the low-pass, or with one; where that is likelier, no shift is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.finding import Finding
from drivetool.identify.noise import Fit, fit_innovations
from drivetool.identify.setup import Outcome
from drivetool.logs import Experiment

TORQUE_ROLE = "motor_torque"
# Log likelihood by which a shift must be better than none, once in 20 000 by chance, and than half a sample less,
# or a low-pass than a shift. Right models with only a shift gain tens where the torque is noisy, else hundreds.
MIN_SHIFT_GAIN, MIN_HALF_SAMPLE_GAIN = 10.0, 5.0
# Autocorrelation of the one-step prediction errors at lags up to 20 that a model may have with the shift: one with
# more lacks something else. Right ones have 0.04 in thousands of samples, one body fitted to a resonance 0.6 and
# more.
MAX_AUTOCORRELATION, AUTOCORRELATION_LAGS = 0.1, 20
# Above, neither a shift nor a low-pass makes a right model of a wrong one. A choice.
MAX_REPAIRABLE = 3.0 * MAX_AUTOCORRELATION
EARLIER, LATER = -1, 1  # direction of the correction for a torque that is logged late, and early
MAX_SHIFT_SAMPLES = 20  # of a shift. A choice: a drive that waits longer is another fault; each sample costs a fit
# Time constants of a low-pass, in samples; the likeliest is then refined in steps of the square root of the ratio,
# four times: to 4 %.
TIME_CONSTANTS, TIME_CONSTANT_RATIO, REFINEMENTS = tuple(0.25 * 2.0**k for k in range(8)), 2.0, 4
# Over the samples of a shift: one of these is likelier than the shift if a low-pass is.
TIMES_OF_SHIFT = (0.5, 1.0, 2.0)
Change = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class ShiftedFit:
    """The model fitted to a changed torque: log likelihood over that of the torque as logged.

    left     the largest autocorrelation of the one-step prediction errors of the first sensor
    samples  total shift of the torque; time: the part of it by a low-pass
    """

    gain: float
    left: float
    samples: float
    time: float = 0.0


def torque_timing(outcome: Outcome) -> list[Finding]:
    """A finding if a fitted model is much likelier with the torque earlier or later than it was logged.

    outcome  by innovations; others give no finding
    """
    fit = outcome.fit
    if fit is None or TORQUE_ROLE not in outcome.task.roles.inputs:
        return []
    for way in (EARLIER, LATER):
        whole = _fit_with_torque(outcome, fit, _shifted(way), 1)
        if whole.gain <= MIN_SHIFT_GAIN:
            continue
        n = 1
        while n < MAX_SHIFT_SAMPLES and (next_ := _fit_with_torque(
                outcome, fit, _shifted(way * (n + 1)), n + 1)).gain > whole.gain:
            whole, n = next_, n + 1
        less, more = (_fit_with_torque(outcome, fit, _shifted(way * (n + off)), n + off) for off in (-0.5, 0.5))
        if whole.gain - less.gain <= MIN_HALF_SAMPLE_GAIN or whole.left > MAX_REPAIRABLE:
            return []
        passes = {cycle: _fit_by_time_constant(outcome, fit, way, cycle) for cycle in (0, 1)}
        best = max(more, *(fit_at(time * n) for fit_at in passes.values() for time in TIMES_OF_SHIFT),
                   key=lambda f: f.gain)
        experiments = outcome.task.experiments
        if best.gain - whole.gain > MIN_HALF_SAMPLE_GAIN:
            best = max(best, *(_likeliest_time_constant(fit_at) for fit_at in passes.values()),
                       key=lambda f: f.gain)
            found = _low_pass_finding(way, best, experiments)
            return [found] if found and best.left < MAX_AUTOCORRELATION else []
        return [_shift_finding(way, n, whole.gain, experiments)] if whole.left < MAX_AUTOCORRELATION else []
    return []


def residual_uncorrelated(fit: Fit) -> bool:
    """Whether the residual of a model has no correlation that a shift could explain."""
    return _largest_autocorrelation(fit) < MAX_AUTOCORRELATION


def _fit_by_time_constant(outcome: Outcome, fit: Fit, way: int, cycle: int) -> Callable[[float], ShiftedFit]:
    """A function from a time constant to the fit without, or with, a low-pass of first order in front of the log.

    cycle  samples by which the torque is also shifted
    """
    def fit_at(time: float) -> ShiftedFit:
        def change(torque: np.ndarray) -> np.ndarray:
            moved = _shifted(way * cycle)(torque)
            # The input of a digital low-pass, from its output; or the output.
            return moved + time * np.diff(moved, prepend=moved[0]) if way == EARLIER else _with_lag(moved, time)

        return replace(_fit_with_torque(outcome, fit, change, cycle + time), time=time)

    return fit_at


def _likeliest_time_constant(fit_at: Callable[[float], ShiftedFit]) -> ShiftedFit:
    """The best time constant."""
    best, ratio = max(map(fit_at, TIME_CONSTANTS), key=lambda f: f.gain), TIME_CONSTANT_RATIO
    for _ in range(REFINEMENTS):
        ratio **= 0.5
        best = max(best, fit_at(best.time / ratio), fit_at(best.time * ratio), key=lambda f: f.gain)
    return best


def _fit_with_torque(outcome: Outcome, fit: Fit, change: Change, samples: float) -> ShiftedFit:
    """The refit with a changed torque, two rounds from the optimum: the values converge within them."""
    task = replace(outcome.task, experiments=_with_changed_torque(outcome.task.experiments, change))
    other = fit_innovations(replace(outcome.problem, traces=task.traces()), fit.point, fit.noise, max_rounds=2,
                            near_optimum=True)
    return ShiftedFit(fit.value - other.value, _largest_autocorrelation(other), samples)


def _largest_autocorrelation(fit: Fit) -> float:
    """The largest autocorrelation of the one-step prediction errors of the first sensor."""
    z = np.concatenate([f.innovations[:, 0] / np.sqrt(f.variance[:, 0]) for f in fit.passes])
    z = z[np.isfinite(z)] - np.mean(z[np.isfinite(z)])
    return float(max(abs(z[k:] @ z[:-k]) for k in range(1, AUTOCORRELATION_LAGS + 1)) / (z @ z))


def _with_changed_torque(experiments: Sequence[Experiment], change: Change) -> tuple[Experiment, ...]:
    """The recordings with another torque, segment by segment."""
    found = []
    for e in experiments:
        torque = e.signals[TORQUE_ROLE].copy()
        for first, last in e.segments:
            torque[first:last] = change(e.signals[TORQUE_ROLE][first:last])
        found.append(replace(e, signals={**e.signals, TORQUE_ROLE: torque}))
    return tuple(found)


def _shifted(samples: float) -> Change:
    """A shift to later by so many samples, between two of them their mean; the end value is repeated."""
    def whole(torque: np.ndarray, by: int) -> np.ndarray:
        return torque[np.clip(np.arange(len(torque)) - by, 0, len(torque) - 1)]

    low, high = int(np.floor(samples)), int(np.ceil(samples))
    return lambda torque: whole(torque, low) if low == high else 0.5 * (whole(torque, low) + whole(torque, high))


def _with_lag(torque: np.ndarray, time: float) -> np.ndarray:
    """The output of a digital low-pass, y += (u - y) / (1 + time)."""
    from scipy.signal import lfilter

    pole = time / (1.0 + time)
    return lfilter([1.0 - pole], [1.0, -pole], torque, zi=[pole * torque[0]])[0]


def _shift_finding(way: int, samples: int, gain: float, experiments: Sequence[Experiment]) -> Finding:
    shift = way * samples * experiments[0].step
    count = "one sample" if samples == 1 else f"{samples} samples"
    one_rate = len({round(e.step, 12) for e in experiments}) == 1
    entry = f"`shift: {shift:.6g}`" if one_rate else f"a `shift` of {'minus ' if shift < 0 else ''}{count}"
    text = {EARLIER: f"is logged {count} late: the motion responds before the logged torque changes",
            LATER: f"is logged {count} early: the motion responds {count} too late"}
    more = "" if way == EARLIER else " A dead time or a lag of the converter, or a filter of the speed, " \
        "has the same effect; in that case free converter.dead_time or converter.bandwidth, or set " \
        "sensor.bandwidth, instead."
    return Finding("warning", "torque-shifted", f"The torque {text[way]}.",
                   {"shift": float(shift), "log_likelihood": float(gain)},
                   f"Write {entry} for {TORQUE_ROLE} in the channel map.{more}")


def _low_pass_finding(way: int, best: ShiftedFit, experiments: Sequence[Experiment]) -> Finding | None:
    """The finding where a low-pass, or a part of a sample, is likelier than whole samples."""
    step = experiments[0].step
    if way == EARLIER:
        return Finding(
            "warning", "torque-filtered", "The logged torque is low-pass filtered with a time constant of "
            f"about {best.time * step:.2g} s; no `shift` corrects that.",
            {"time_constant": float(best.time * step), "log_likelihood": float(best.gain)},
            "Log the torque in front of its filter, or the command.") if best.time else None
    return Finding(
        "warning", "input-delay", f"The motion lags the model by about {best.samples * step:.2g} s, not a whole "
        "number of samples: the converter has a lag or a dead time, or the speed is filtered.",
        {"delay": float(best.samples * step), "log_likelihood": float(best.gain)},
        "Free converter.bandwidth or converter.dead_time, or set sensor.bandwidth.")
