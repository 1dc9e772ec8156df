"""Is the torque logged in the cycle in which it acts? Asked of a fitted model, whatever else it lacks.

Drives log the torque of the cycle that has passed, or the command of the next one. Taken as logged, it puts
inertias off by several per cent, and what it leaves looks like a further mass. The same model is fitted with the
torque some samples earlier and later; the likelihood of thousands of samples tells one from the others. A model
that lacks something else says nothing: a shift would take some of that on itself.

A torque that is measured, not held, acts between its samples, half way to one that is late. So the mean of two
neighbours is fitted as well, and whole samples have to be likelier than that. A low-pass in front of the logger
makes the torque late as well, one behind the command early. A shift explains them in part only, so the torque is
fitted without the low-pass, or with one, too; where that is likelier, no shift is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.errors import Finding
from drivetool.identify.noise import Fit, fit_innovations
from drivetool.identify.setup import Outcome
from drivetool.logs import Experiment

ROLE = "motor_torque"
# Log likelihood by which a shift must be better than none, once in 20 000 by chance, and than half a sample less,
# or a low-pass than it. Models that are right but for the shift gain tens where the torque is noisy, else hundreds.
SURE, THAN_HALF = 10.0, 5.0
# Correlation between one-step errors up to 20 samples apart that a model may leave with the shift: one that leaves
# more lacks something else. Right ones leave 0.04 in thousands of samples, one body fitted to a resonance 0.6 and
# more.
LEFT, LAGS = 0.1, 20
HOPELESS = 3.0 * LEFT  # from here on neither a shift nor a low-pass makes a right model of a wrong one
EARLIER, LATER = -1, 1  # where the torque goes that is logged late, and early
MOST_SAMPLES = 20  # of a shift; the sensor's noise hides what a drive does in more
# Time constants of a low-pass, in samples; the likeliest is then looked for around it in steps of half that ratio.
TIMES, RATIO, FINER = tuple(0.25 * 2.0**k for k in range(8)), 2.0, 4
FEW = (0.5, 1.0, 2.0)  # over the samples of a shift: one of these is likelier than it if a low-pass is
Change = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Asked:
    """The model fitted to a changed torque: log likelihood over that of the torque as logged.

    left     the largest correlation between one-step errors of the first sensor
    samples  by which the torque was moved, all in all; time: of them by a low-pass
    """

    gain: float
    left: float
    samples: float
    time: float = 0.0


def torque_timing(outcome: Outcome) -> list[Finding]:
    """A finding if a fitted model is much likelier with the torque earlier or later than it was logged.

    outcome  by innovations; others say nothing
    """
    fit = outcome.fit
    if fit is None or ROLE not in outcome.task.roles.inputs:
        return []
    for way in (EARLIER, LATER):
        whole = _asked(outcome, fit, _moved(way), 1)
        if whole.gain <= SURE:
            continue
        n = 1
        while n < MOST_SAMPLES and (next_ := _asked(outcome, fit, _moved(way * (n + 1)), n + 1)).gain > whole.gain:
            whole, n = next_, n + 1
        less, more = (_asked(outcome, fit, _moved(way * (n + off)), n + off) for off in (-0.5, 0.5))
        if whole.gain - less.gain <= THAN_HALF or whole.left > HOPELESS:
            return []
        passes = {cycle: _low_pass(outcome, fit, way, cycle) for cycle in (0, 1)}
        best = max(more, *(ask(time * n) for ask in passes.values() for time in FEW), key=lambda asked: asked.gain)
        experiments = outcome.task.experiments
        if best.gain - whole.gain > THAN_HALF:
            best = max(best, *(_likeliest(ask) for ask in passes.values()), key=lambda asked: asked.gain)
            found = _lagging(way, best, experiments)
            return [found] if found and best.left < LEFT else []
        return [_finding(way, n, whole.gain, experiments)] if whole.left < LEFT else []
    return []


def explains(fit: Fit) -> bool:
    """Whether a model leaves nothing that a shift could take on itself."""
    return _correlation(fit) < LEFT


def _low_pass(outcome: Outcome, fit: Fit, way: int, cycle: int) -> Callable[[float], Asked]:
    """What asks for a torque without, or with, a low-pass of first order in front of the log, of a time constant.

    cycle  by how many samples it is earlier, or later, besides
    """
    def ask(time: float) -> Asked:
        def change(torque: np.ndarray) -> np.ndarray:
            moved = _moved(way * cycle)(torque)
            return _without_lag(moved, time) if way == EARLIER else _with_lag(moved, time)

        return replace(_asked(outcome, fit, change, cycle + time), time=time)

    return ask


def _likeliest(ask: Callable[[float], Asked]) -> Asked:
    """The best time constant."""
    best, ratio = max(map(ask, TIMES), key=lambda asked: asked.gain), RATIO
    for _ in range(FINER):
        ratio **= 0.5
        best = max(best, ask(best.time / ratio), ask(best.time * ratio), key=lambda asked: asked.gain)
    return best


def _asked(outcome: Outcome, fit: Fit, change: Change, samples: float) -> Asked:
    """The fit again with a changed torque, for two rounds from where it was: all that moves does so in them."""
    task = replace(outcome.task, experiments=_changed(outcome.task.experiments, change))
    other = fit_innovations(replace(outcome.problem, traces=task.traces()), fit.point, fit.noise, most=2,
                            arrived=True)
    return Asked(fit.value - other.value, _correlation(other), samples)


def _correlation(fit: Fit) -> float:
    """The largest correlation between one-step errors of the first sensor."""
    z = np.concatenate([f.innovations[:, 0] / np.sqrt(f.variance[:, 0]) for f in fit.passes])
    z = z[np.isfinite(z)] - np.mean(z[np.isfinite(z)])
    return float(max(abs(z[k:] @ z[:-k]) for k in range(1, LAGS + 1)) / (z @ z))


def _changed(experiments: Sequence[Experiment], change: Change) -> tuple[Experiment, ...]:
    """The recordings with another torque, segment by segment."""
    found = []
    for e in experiments:
        torque = e.signals[ROLE].copy()
        for first, last in e.segments:
            torque[first:last] = change(e.signals[ROLE][first:last])
        found.append(replace(e, signals={**e.signals, ROLE: torque}))
    return tuple(found)


def _moved(samples: float) -> Change:
    """That many samples later, between two of them their mean; at an end the last value stands in."""
    def whole(torque: np.ndarray, by: int) -> np.ndarray:
        return torque[np.clip(np.arange(len(torque)) - by, 0, len(torque) - 1)]

    low, high = int(np.floor(samples)), int(np.ceil(samples))
    return lambda torque: whole(torque, low) if low == high else 0.5 * (whole(torque, low) + whole(torque, high))


def _without_lag(torque: np.ndarray, time: float) -> np.ndarray:
    """What a digital low-pass, y += (u - y) / (1 + time), was given."""
    return torque + time * np.diff(torque, prepend=torque[0])


def _with_lag(torque: np.ndarray, time: float) -> np.ndarray:
    """What such a low-pass gives."""
    from scipy.signal import lfilter

    rest = time / (1.0 + time)
    return lfilter([1.0 - rest], [1.0, -rest], torque, zi=[rest * torque[0]])[0]


def _finding(way: int, samples: int, gain: float, experiments: Sequence[Experiment]) -> Finding:
    shift = way * samples * experiments[0].step
    told = "one sample" if samples == 1 else f"{samples} samples"
    alike = len({round(e.step, 12) for e in experiments}) == 1
    cure = f"`shift: {shift:.6g}`" if alike else f"a `shift` of {'minus ' if shift < 0 else ''}{told}"
    text = {EARLIER: f"is logged {told} late: the motion answers before it is there",
            LATER: f"is logged {told} early: the motion answers {told if samples > 1 else 'a sample'} later than "
                   "it should"}
    more = "" if way == EARLIER else " A dead time or a lag of the converter, or a filter of the speed, " \
        "looks the same; then free converter.dead_time or converter.bandwidth, or set sensor.bandwidth, instead."
    return Finding("warning", "torque-late" if way == EARLIER else "torque-early", f"The torque {text[way]}.",
                   {"shift": float(shift), "log_likelihood": float(gain)},
                   f"Write {cure} for {ROLE} in the channel map.{more}")


def _lagging(way: int, best: Asked, experiments: Sequence[Experiment]) -> Finding | None:
    """What is said where a low-pass, or a part of a sample, is likelier than whole samples."""
    step = experiments[0].step
    if way == EARLIER:
        return Finding(
            "warning", "torque-filtered", "The logged torque follows the one that acts as behind a low-pass of "
            f"about {best.time * step:.2g} s; no `shift` cures that.",
            {"time_constant": float(best.time * step), "log_likelihood": float(best.gain)},
            "Log the torque in front of its filter, or the command.") if best.time else None
    return Finding(
        "warning", "input-delay", f"The motion answers the torque about {best.samples * step:.2g} s later than the "
        "model does, and not by whole samples: the converter has a lag or a dead time, or the speed is filtered.",
        {"delay": float(best.samples * step), "log_likelihood": float(best.gain)},
        "Free converter.bandwidth or converter.dead_time, or set sensor.bandwidth.")
