"""The parts of a recording that `keep` and `omit` leave: cut before any check, which sees only what is left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drivetool.errors import BadOption, NotEnoughData
from drivetool.finding import Finding
from drivetool.logs import INPUTS, MIN_SAMPLES, Signal, usual_step
from drivetool.logs.conditioning.steps import ConditioningStep

Part = tuple[float, float]
WHOLE_RECORDING: tuple[Part, ...] = ((0.0, math.inf),)


@dataclass(frozen=True)
class CutSignals:
    """The signals within the parts that are left.

    signals  role -> Signal
    start    first stamp of the recording, from which the parts count [s]
    parts    (from, to) that are left [s]
    """

    signals: Mapping[str, Signal]
    start: float
    parts: tuple[Part, ...]
    findings: tuple[Finding, ...] = ()


def kept_windows(steps: Sequence[ConditioningStep]) -> list[Part]:
    """(from, to) in seconds of a recording, of the parts that `keep` and `omit` leave; other steps leave all."""
    parts = list(WHOLE_RECORDING)
    for step in steps:
        if step.name in ("keep", "omit"):
            first, last = step.numbers["from"], step.numbers["to"]
            windows = [(first, last)] if step.name == "keep" else [(0.0, first), (last, math.inf)]
            parts = [(max(a, low), min(b, high)) for a, b in parts for low, high in windows
                     if max(a, low) < min(b, high)]
    return parts


def cut_signals(signals: Mapping[str, Signal], leader: str, steps: Sequence[ConditioningStep],
                log: str) -> CutSignals:
    """The samples of every signal within the parts that are left.

    signals  role -> Signal, with stamps as logged
    leader   the role from whose first stamp the parts count
    raises   BadOption: a part that is empty, or outside the recording; NotEnoughData: too few samples left
    """
    time = signals[leader].time[np.isfinite(signals[leader].time)]
    if not len(time):
        return CutSignals(signals, 0.0, WHOLE_RECORDING)
    start, step = float(time[0]), usual_step(time)
    end = float(time.max()) + step - start
    findings = []
    before = len(time)
    for i, each in enumerate(steps):
        if each.name not in ("keep", "omit"):
            continue
        first, last = each.numbers["from"], each.numbers["to"]
        if not first < last or first >= end:
            raise BadOption(f"from before to, within 0 to {end:g} s of {log}, for {each.name}", each.text,
                            "Correct it.")
        remaining = int(_stamps_in_parts(time, start, kept_windows(steps[:i + 1]), step).sum())
        outcomes = {"keep": f"{remaining} of {before} samples kept",
                    "omit": f"{before - remaining} samples left out"}
        findings.append(Finding("note", "conditioned", f"{log}: {each.text}: {outcomes[each.name]}.",
                                {"step": each.name, **each.finite_numbers, "samples": remaining}))
        if remaining < MIN_SAMPLES:
            raise NotEnoughData(f"at least {MIN_SAMPLES} samples of {log} after {each.text}", f"{remaining}",
                                "Leave more of it.")
        before = remaining
    if not findings:
        return CutSignals(signals, start, WHOLE_RECORDING)
    parts = tuple(kept_windows(steps))
    return CutSignals({role: _signal_in_parts(signal, start, parts, step if role in INPUTS else np.inf)
                for role, signal in signals.items()}, start, parts, tuple(findings))


def restart_after_cuts(segments: Sequence[tuple[int, int]], signals: Mapping[str, np.ndarray],
                       parts: Sequence[Part],
                       offset: float, step: float) -> tuple[list[tuple[int, int]], Mapping[str, np.ndarray]]:
    """Segments and signals, (n,) each on a grid, in which the motion starts anew after each omitted part.

    offset  of the first grid point in the recording [s]; step [s]
    """
    for (_, end), (begin, _) in pairwise(parts):
        i, j = (round((edge - offset) / step) for edge in (end, begin))
        segments = [(a, b) for first, last in segments
                    for a, b in ((first, min(last, i)), (max(first, j), last)) if b > a]
        signals = {role: values if role in INPUTS else _with_gap(values, max(i, 0), max(j, 0))
                   for role, values in signals.items()}
    return list(segments), signals


def _with_gap(values: np.ndarray, first: int, last: int) -> np.ndarray:
    values = values.copy()
    values[first:last] = np.nan
    return values


def _stamps_in_parts(time: np.ndarray, start: float, parts: Sequence[Part], step: float) -> np.ndarray:
    """(n,) whether a stamp lies in one of the parts; at an edge, the nearest sample decides."""
    since = time - start
    return np.any([(since >= a - 0.5 * step) & (since < b - 0.5 * step) for a, b in parts], axis=0)


def _signal_in_parts(signal: Signal, start: float, parts: Sequence[Part], hold_step: float) -> Signal:
    """Samples of a signal in the parts, and the one before where the first is later than half of `hold_step`."""
    step = usual_step(signal.time)
    inside = _stamps_in_parts(signal.time, start, parts, step)
    for first, last in parts:
        own = np.flatnonzero(_stamps_in_parts(signal.time, start, [(first, last)], step))
        if len(own) and own[0] > 0 and signal.time[own[0]] - start - first > 0.5 * hold_step:
            inside[own[0] - 1] = True
    if inside.sum() == len(inside):
        return signal
    empty_inside = _stamps_in_parts(signal.empty_stamps, start, parts, step) if len(signal.empty_stamps) \
        else np.zeros(0, bool)
    return replace(signal, time=signal.time[inside], values=signal.values[inside],
                   empty_stamps=signal.empty_stamps[empty_inside],
                   invalid_count=min(signal.invalid_count, int(empty_inside.sum())))
