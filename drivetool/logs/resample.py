"""Signals onto one uniform grid: as they are where possible, otherwise held or interpolated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivetool.errors import BadRecording, Finding, NotEnoughData
from drivetool.logs.clock import (
    BRIDGE_STEPS,
    GAP_STEPS,
    JITTER,
    Clock,
    Grid,
    clean_clock,
    fit_grid,
    median_step,
)
from drivetool.logs.clock_offset import clock_offsets
from drivetool.logs.convert import Signal
from drivetool.logs.experiment import INPUTS
from drivetool.logs.rate import CUT_OFF, FASTER, average, low_passed


@dataclass(frozen=True)
class Gridded:
    """Signals on a grid: step, start [s]; role -> (n,); segments without a gap in time."""

    step: float
    start: float
    signals: Mapping[str, np.ndarray]
    segments: tuple[tuple[int, int], ...]
    findings: tuple[Finding, ...]


def onto_grid(signals: Mapping[str, Signal], log: str) -> Gridded:
    """All signals on the grid of the motor torque (without one, of the fastest signal).

    One clock with less than 5 % jitter: the samples are taken as they are, bit by bit. Otherwise an
    input takes, at each grid point, the value that acts during most of the step that follows (zero
    order hold), and a sensor is interpolated between neighbours at most 3 steps apart. Slower
    sensors get a value only at the grid points next to their samples; faster ones are low-passed,
    and faster inputs averaged (rate.py).

    signals  role -> Signal
    returns  Gridded; neighbours more than 3 steps apart begin a new segment
    raises   BadRecording: time goes backwards, or clocks that do not overlap; NotEnoughData: a
             signal with fewer than two samples
    """
    clocks, findings = _clean(signals, log)
    for role, clock in clocks.items():
        if len(clock.time) < 2:
            count = len(signals[role].time)
            raise NotEnoughData(f"samples of {role} at different times in {log}",
                                f"{count} at one time" if count > 1 else f"{count}",
                                "Choose another clock with `time:` in the channel map." if count > 1
                                else "Record longer.")
    findings += clock_offsets({role: Signal(clock.time, clock.of(signals[role].values), signals[role].si)
                               for role, clock in clocks.items()}, log)
    leader = "motor_torque" if "motor_torque" in clocks else min(
        clocks, key=lambda role: median_step(clocks[role].time))
    grid = fit_grid(clocks[leader].time)
    values = {role: clocks[role].of(signal.values) for role, signal in signals.items()}
    if grid.uniform and all(clock is clocks[leader] for clock in clocks.values()):
        count = grid.size
        _refuse_vast(count, len(grid.index), log)
        placed = {role: _place(grid, v, role in INPUTS) for role, v in values.items()}
        segments = _stretches(grid.index, grid.gaps)
        if grid.lost:
            findings.append(_lost_finding(grid, log))
    else:
        count = round((clocks[leader].time[-1] - grid.start) / grid.step) + 1
        _refuse_vast(count, len(grid.index), log)
        at = grid.start + np.arange(count) * grid.step
        placed, slowed = _convert_rates(at, grid.step, clocks, values)
        if slowed:
            findings.append(_slowed_finding(slowed, grid, log))
        places = np.round((clocks[leader].time - grid.start) / grid.step).astype(np.int64)
        segments = _stretches(places, grid.gaps)
        findings.append(_resampled_finding(grid, clocks, leader, log))
        _require_overlap(placed, log, findings)
    if len(grid.gaps):
        findings.append(_gap_finding(grid, clocks[leader].time, log))
    return Gridded(grid.step, grid.start, placed, tuple(segments), tuple(findings))


def _clean(signals: Mapping[str, Signal], log: str) -> tuple[dict[str, Clock], list[Finding]]:
    """role -> Clock; signals with equal stamps share one Clock object."""
    clocks, findings, seen = {}, [], []
    for role, signal in signals.items():
        known = next((clock for time, clock in seen
                      if time is signal.time or np.array_equal(time, signal.time, equal_nan=True)), None)
        if known is None:
            known, new = clean_clock(signal.time, role, log)
            findings += new
            seen.append((signal.time, known))
        clocks[role] = known
    return clocks, findings


def _refuse_vast(count: int, samples: int, log: str) -> None:
    """A grid that is nearly all gap would only fill the memory."""
    if count > 50 * samples + 1_000_000:
        raise BadRecording(f"one stretch of time in {log}", f"{samples} samples over {count} steps",
                           "Cut the record into files, one per run.")


def _place(grid: Grid, values: np.ndarray, held: bool) -> np.ndarray:
    """(n,) on the grid; lost samples are held for an input and missing for a sensor."""
    if grid.size == len(values):
        return values
    if held:
        return values[np.searchsorted(grid.index, np.arange(grid.size), side="right") - 1]
    placed = np.full(grid.size, np.nan)
    placed[grid.index] = values
    return placed


def _stretches(places: np.ndarray, gaps: np.ndarray) -> list[tuple[int, int]]:
    """(first, last+1) grid points of the stretches between gaps."""
    first = places[np.concatenate([[0], gaps + 1]).astype(np.int64)]
    last = places[np.concatenate([gaps, [len(places) - 1]]).astype(np.int64)]
    return [(int(a), int(b) + 1) for a, b in zip(first, last, strict=True)]


def _hold(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Zero order hold; NaN once a value is older than the bridge allows at the signal's own rate."""
    index = np.searchsorted(time, at + 0.5 * step, side="right") - 1
    age = at - time[np.maximum(index, 0)]
    valid = (index >= 0) & (age <= GAP_STEPS * max(step, median_step(time)))
    return np.where(valid, values[np.maximum(index, 0)], np.nan)


def _interpolate(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Linear between neighbours that are near each other, and next to samples that are not."""
    known = np.isfinite(values)
    time, values = time[known], values[known]
    if len(time) < 2:
        return np.full(len(at), np.nan)
    right = np.clip(np.searchsorted(time, at, side="right"), 1, len(time) - 1)
    before, after = time[right - 1], time[right]
    nearest = np.minimum(np.abs(at - before), np.abs(after - at))
    inside = (at >= time[0] - JITTER * step) & (at <= time[-1] + JITTER * step)
    near = (after - before <= (BRIDGE_STEPS + 2 * JITTER) * step) | (nearest <= 0.5 * step)
    return np.where(inside & near, np.interp(at, time, values), np.nan)


def _convert_rates(at: np.ndarray, step: float, clocks: Mapping[str, Clock],
                   values: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """(role -> (n,) on the grid, role -> own step of those that were faster)."""
    placed, slowed = {}, {}
    for role, v in values.items():
        time = clocks[role].time
        known = time[np.isfinite(v)]
        own = median_step(known) if len(known) > 2 else step
        if step > FASTER * own:
            slowed[role] = own
            placed[role] = (average if role in INPUTS else low_passed)(at, step, time, v)
        else:
            placed[role] = (_hold if role in INPUTS else _interpolate)(at, step, time, v)
    return placed, slowed


def _require_overlap(placed: Mapping[str, np.ndarray], log: str, findings: list[Finding]) -> None:
    """A signal without a value on the grid was recorded at another time, or by another clock."""
    for role, values in placed.items():
        if not np.any(np.isfinite(values)):
            told = next((f" {f.text} {f.action}" for f in findings
                         if f.code == "clock-offset" and role in f.evidence.values()), "")
            raise BadRecording(f"{role} at the time of the other signals in {log}",
                               "clocks that do not overlap",
                               f"Record all signals on one clock, or leave the role out.{told}")


def _resampled_finding(grid: Grid, clocks: Mapping[str, Clock], leader: str, log: str) -> Finding:
    several = len({id(clock) for clock in clocks.values()}) > 1
    why = "the signals have clocks of their own" if several else \
        f"the time stamps are up to {100 * grid.jitter:.0f} % of a step off a uniform grid"
    steps = {f"step_{role}": median_step(clock.time) for role, clock in clocks.items()}
    return Finding("note" if several else "warning", "resampled",
                   f"{log} was put on a grid of {grid.step:.6g} s, that of {leader}, because {why}; "
                   "torques are held, sensors interpolated.",
                   {"step": grid.step, "jitter": grid.jitter, **steps},
                   "" if several else "Record with a fixed rate.")


def _slowed_finding(slowed: Mapping[str, float], grid: Grid, log: str) -> Finding:
    return Finding("note", "anti-aliased",
                   f"{', '.join(slowed)} of {log} came faster than the grid; sensors were low-passed without "
                   f"delay at {CUT_OFF / grid.step:.4g} Hz, inputs averaged over each step.",
                   {"step": grid.step, "cut_off": CUT_OFF / grid.step,
                    **{f"step_{role}": own for role, own in slowed.items()}})


def _lost_finding(grid: Grid, log: str) -> Finding:
    return Finding("warning", "lost-samples",
                   f"{log} lacks {grid.lost} single samples ({100 * grid.lost / grid.size:.2g} %); the "
                   "torque is held over them and sensors have no value there.",
                   {"samples": grid.lost, "of": grid.size}, "Check the recorder for overload.")


def _gap_finding(grid: Grid, time: np.ndarray, log: str) -> Finding:
    lengths = np.diff(time)[grid.gaps]
    often = "once" if len(lengths) == 1 else f"{len(lengths)} times"
    return Finding("warning", "gaps",
                   f"{log} is interrupted {often}, for up to {lengths.max():.4g} s; it is used as "
                   f"{len(lengths) + 1} segments.",
                   {"gaps": len(lengths), "longest": float(lengths.max()),
                    "first_at": float(time[grid.gaps[0]])},
                   "Check the recorder for overload.")
