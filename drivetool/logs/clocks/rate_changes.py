"""A logger that changed its rate: which stretches of a recording are at which rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drivetool.logs import INPUTS, MIN_SAMPLES
from drivetool.logs.clocks.rate import MIN_RATE_RATIO, MIN_REGULAR_STEPS_SHARE
from drivetool.logs.clocks.resample import CleanSignals, refuse_single, with_leader

Window = tuple[float, float]


@dataclass(frozen=True)
class Rate:
    """One of the rates of a clock: its usual step [s]; (from, to) of its stretches, in the order of time [s]."""

    step: float
    windows: tuple[Window, ...]

    @property
    def text(self) -> str:
        """As messages have it."""
        return f"{1.0 / self.step:.4g} Hz"


def find_rates(time: np.ndarray) -> list[Rate]:
    """Every rate that a clock has one after the other, in the order in which they begin.

    A change is a step that is longer or shorter by a factor, and lasts. Lost, late or random samples make none:
    at a rate, four of five steps are nearest to its own step, and within half of it.

    time     (n,) seconds, strictly increasing
    returns  empty where there is one rate, or no such rates
    """
    steps = np.diff(time)
    if len(steps) < 2 * MIN_SAMPLES or not _may_change(steps):
        return []
    from scipy.ndimage import median_filter

    # The median of 2 n - 1 steps changes only where at least n of them have another length.
    label = _merge_short_runs(_rate_groups(np.log(
        median_filter(steps, size=2 * MIN_SAMPLES - 1, mode="nearest"))))
    usual = np.array([float(np.median(steps[label == k])) for k in range(label.max() + 1)])
    nearest = np.argmin(np.abs(np.log(steps)[:, None] - np.log(usual)), axis=1)
    at_own_rate = (nearest == label) & (np.abs(steps - usual[label]) < 0.5 * usual[label])
    if len(usual) < 2 or any(np.mean(at_own_rate[label == k]) < MIN_REGULAR_STEPS_SHARE for k in range(len(usual))):
        return []
    # A sample goes with the step that follows it: for so long its torque is held.
    edges = np.flatnonzero(np.diff(label)) + 1
    bounds = [-np.inf, *time[edges].tolist(), np.inf]
    found: dict[int, list[Window]] = {}
    for k, window in zip(label[[0, *edges]].tolist(), pairwise(bounds), strict=True):
        found.setdefault(k, []).append(window)
    return [Rate(float(usual[k]), tuple(windows)) for k, windows in found.items()]


def at_rate(clean: CleanSignals, rate: Rate, log: str) -> CleanSignals:
    """The part of a recording at one of its rates.

    raises  NotEnoughData: a signal with fewer than two samples there
    """
    signals, cut = {}, {}
    for role, signal in clean.signals.items():
        key = id(signal.time), role in INPUTS
        if key not in cut:
            at, index = _cut_to_windows(signal.time, rate.windows, role in INPUTS)
            # Inputs on a sensor's clock stay on it.
            same = cut.get((key[0], not key[1]))
            cut[key] = (same[0] if same and np.array_equal(same[0], at) else at, index)
        at, index = cut[key]
        signals[role] = replace(signal, time=at, values=signal.values[index])
    refuse_single(signals, signals, log)
    return with_leader(signals, clean.findings, tuple(begin for begin, _ in rate.windows[1:]))


def _may_change(steps: np.ndarray) -> bool:
    """Whether of so many steps (n,) in a row most are off the usual one by half of what makes two rates."""
    off = np.abs(np.log(steps / np.median(steps))) > 0.5 * np.log(MIN_RATE_RATIO)
    total = np.concatenate([[0], np.cumsum(off)])
    return bool((total[MIN_SAMPLES:] - total[:-MIN_SAMPLES]).max() > MIN_SAMPLES // 2)


def _rate_groups(local: np.ndarray) -> np.ndarray:
    """(n,) number of the group of each local step, (n,) logarithms: groups differ by at least MIN_RATE_RATIO."""
    values = np.unique(local)
    return np.searchsorted(values[1:][np.diff(values) > np.log(MIN_RATE_RATIO)], local, side="right")


def _merge_short_runs(label: np.ndarray) -> np.ndarray:
    """Labels (n,) in which every run lasts, numbered anew: a shorter one counts with what is before it."""
    runs = list(pairwise([0, *(np.flatnonzero(np.diff(label)) + 1).tolist(), len(label)]))
    now = next((label[a] for a, b in runs if b - a >= MIN_SAMPLES), label[0])
    found = np.empty_like(label)
    for a, b in runs:
        now = label[a] if b - a >= MIN_SAMPLES else now
        found[a:b] = now
    return np.unique(found, return_inverse=True)[1].reshape(-1)


def _cut_to_windows(time: np.ndarray, windows: Sequence[Window], held: bool) -> tuple[np.ndarray, np.ndarray]:
    """(stamps within some windows, (m,); index of their samples); what is held acts from where a window begins."""
    at, index = [], []
    for begin, end in windows:
        a, b = np.searchsorted(time, (begin, end)).tolist()
        at.append(time[a:b])
        index.append(np.arange(a, b))
        if held and 0 < a < b and time[a] > begin:
            at.insert(-1, np.array([begin]))
            index.insert(-1, np.array([a - 1]))
    return np.concatenate(at), np.concatenate(index)
