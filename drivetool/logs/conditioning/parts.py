"""The parts of a recording that `keep` and `omit` leave: cut before any check, since they cure what they omit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drivetool.errors import BadOption, Finding, NotEnoughData
from drivetool.logs import INPUTS, Signal, usual_step
from drivetool.logs.conditioning.steps import LEAST, Step

Part = tuple[float, float]
WHOLE: tuple[Part, ...] = ((0.0, math.inf),)


@dataclass(frozen=True)
class Cut:
    """What is left.

    signals  role -> Signal
    start    first stamp of the recording, from which the parts count [s]
    parts    (from, to) that are left [s]
    """

    signals: Mapping[str, Signal]
    start: float
    parts: tuple[Part, ...]
    findings: tuple[Finding, ...] = ()


def kept(steps: Sequence[Step]) -> list[Part]:
    """(from, to) in seconds of a recording, of the parts that `keep` and `omit` leave; other steps leave all."""
    parts = list(WHOLE)
    for step in steps:
        if step.name in ("keep", "omit"):
            first, last = step.numbers["from"], step.numbers["to"]
            windows = [(first, last)] if step.name == "keep" else [(0.0, first), (last, math.inf)]
            parts = [(max(a, low), min(b, high)) for a, b in parts for low, high in windows
                     if max(a, low) < min(b, high)]
    return parts


def cut(signals: Mapping[str, Signal], leader: str, steps: Sequence[Step], log: str) -> Cut:
    """The samples of every signal within the parts that are left.

    signals  role -> Signal, with stamps as logged
    leader   the role from whose first stamp the parts count
    raises   BadOption: a part that is empty, or outside the recording; NotEnoughData: too few samples left
    """
    time = signals[leader].time[np.isfinite(signals[leader].time)]
    if not len(time):
        return Cut(signals, 0.0, WHOLE)
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
        left = int(_inside(time, start, kept(steps[:i + 1]), step).sum())
        told = {"keep": f"{left} of {before} samples kept", "omit": f"{before - left} samples left out"}
        findings.append(Finding("note", "conditioned", f"{log}: {each.text}: {told[each.name]}.",
                                {"step": each.name, **each.told, "samples": left}))
        if left < LEAST:
            raise NotEnoughData(f"at least {LEAST} samples of {log} after {each.text}", f"{left}",
                                "Leave more of it.")
        before = left
    if not findings:
        return Cut(signals, start, WHOLE)
    parts = tuple(kept(steps))
    return Cut({role: _within(signal, start, parts, step if role in INPUTS else np.inf)
                for role, signal in signals.items()}, start, parts, tuple(findings))


def restarted(segments: Sequence[tuple[int, int]], signals: Mapping[str, np.ndarray], parts: Sequence[Part],
              offset: float, step: float) -> tuple[list[tuple[int, int]], Mapping[str, np.ndarray]]:
    """Segments and signals, (n,) each on a grid, in which the motion starts anew behind whatever was left out.

    offset  of the first grid point in the recording [s]; step [s]
    """
    for (_, end), (begin, _) in pairwise(parts):
        i, j = (round((edge - offset) / step) for edge in (end, begin))
        segments = [(a, b) for first, last in segments
                    for a, b in ((first, min(last, i)), (max(first, j), last)) if b > a]
        signals = {role: values if role in INPUTS else _without(values, max(i, 0), max(j, 0))
                   for role, values in signals.items()}
    return list(segments), signals


def _without(values: np.ndarray, first: int, last: int) -> np.ndarray:
    values = values.copy()
    values[first:last] = np.nan
    return values


def _inside(time: np.ndarray, start: float, parts: Sequence[Part], step: float) -> np.ndarray:
    """(n,) whether a stamp lies in one of the parts; at an edge, the nearest sample decides."""
    since = time - start
    return np.any([(since >= a - 0.5 * step) & (since < b - 0.5 * step) for a, b in parts], axis=0)


def _within(signal: Signal, start: float, parts: Sequence[Part], late: float) -> Signal:
    """The samples of a signal in the parts, and the one before where the first comes later than half of `late`."""
    step = usual_step(signal.time)
    inside = _inside(signal.time, start, parts, step)
    for first, last in parts:
        own = np.flatnonzero(_inside(signal.time, start, [(first, last)], step))
        if len(own) and own[0] > 0 and signal.time[own[0]] - start - first > 0.5 * late:
            inside[own[0] - 1] = True
    if inside.sum() == len(inside):
        return signal
    lacking = _inside(signal.without, start, parts, step) if len(signal.without) else np.zeros(0, bool)
    return replace(signal, time=signal.time[inside], values=signal.values[inside], without=signal.without[lacking],
                   broken=min(signal.broken, int(lacking.sum())))
