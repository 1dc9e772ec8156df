"""Signals onto one uniform grid: as they are where possible, otherwise held or interpolated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.errors import BadRecording, NotEnoughData
from drivetool.finding import Finding
from drivetool.logs import (
    INPUTS,
    JITTER_TOLERANCE,
    MAX_STEPS_WITHIN_SEGMENT,
    STEP_TOLERANCE,
    Grid,
    Signal,
    fit_grid,
    median_step,
    usual_step,
)
from drivetool.logs.clocks.clean_stamps import clean_clock
from drivetool.logs.clocks.clock_offset import clock_offsets
from drivetool.logs.clocks.rate import (
    ANTIALIAS_CUT_OFF,
    MIN_RATE_RATIO,
    average_over_steps,
    hold_times,
    low_pass_reference,
)


@dataclass(frozen=True)
class CleanSignals:
    """Signals on clean clocks.

    signals  role -> Signal, its stamps strictly increasing, one array for all with equal stamps
    leader   the role whose clock the grid takes; time (n,) its stamps, with those of others that it lacks [s]
    resumes  when the logger came back to this rate from another one [s]
    """

    signals: Mapping[str, Signal]
    leader: str
    time: np.ndarray
    findings: tuple[Finding, ...] = ()
    resumes: tuple[float, ...] = ()


@dataclass(frozen=True)
class GriddedSignals:
    """Signals on a grid: step, start [s]; role -> (n,); segments without a gap."""

    step: float
    start: float
    signals: Mapping[str, np.ndarray]
    segments: tuple[tuple[int, int], ...]
    findings: tuple[Finding, ...]


def clean_signals(signals: Mapping[str, Signal], log: str) -> CleanSignals:
    """The signals with every stamp once and in order.

    signals  role -> Signal, with stamps as logged
    raises   BadRecording: time goes backwards; NotEnoughData: a signal with fewer than two samples
    """
    clean, findings = _on_clean_clocks(signals, log)
    refuse_single(clean, signals, log)
    return with_leader(clean, (*findings, *clock_offsets(clean, log)))


def with_leader(clean: Mapping[str, Signal], findings: tuple[Finding, ...],
                resumes: tuple[float, ...] = ()) -> CleanSignals:
    """Clean signals with the role whose clock the grid takes."""
    leader = leader_of(clean)
    return CleanSignals(clean, leader, _fill_lost_stamps(leader, clean), findings, resumes)


def onto_grid(clean: CleanSignals, log: str) -> GriddedSignals:
    """All signals on the grid of the fastest sensor, its steps divided where an input is faster.

    Samples whose stamps are those of the grid are taken as they are, bit by bit. Others are converted. An input is
    averaged over what is held during each step, which keeps its impulse exactly. A sensor is interpolated
    between neighbours at most 3 steps apart; a slower one has a value only at the grid points next to its samples.
    What is faster (references alone) is low-passed (rate.py).

    returns  Gridded; neighbours more than 3 steps apart begin a new segment
    raises   BadRecording: clocks that do not overlap
    """
    signals, time, findings = clean.signals, clean.time, []
    # A step is divided for the fastest input.
    inputs = [signals[role].time for role in INPUTS if role in signals]
    parts = max(1, round(median_step(time) / min(map(median_step, inputs), default=np.inf)))
    grid, at = _divided_grid(time, parts, max(map(len, (time, *inputs))), log)
    placed: dict[str, np.ndarray] = {}
    slowed: dict[str, float] = {}
    converted = not grid.uniform
    for role, signal in signals.items():
        places = _matching_grid_points(signal.time, at, grid.step) if grid.uniform else None
        if places is not None:
            placed[role] = _values_on_grid(len(at), places, signal.values, role in INPUTS)
            continue
        own_step = median_step(signal.time)
        if grid.step > MIN_RATE_RATIO * own_step and role not in INPUTS:
            slowed[role] = own_step
        converted = True
        placed[role] = _convert_to_grid(at, grid.step, signal, own_step, role in INPUTS,
                                        signal.time is signals[clean.leader].time)
    if grid.uniform and grid.lost:
        findings.append(_lost_finding(grid, log))
    if slowed:
        findings.append(_slowed_finding(slowed, grid, log))
    if converted:
        findings.append(_resampled_finding(grid, signals, clean.leader, log))
        _require_overlap(placed, log, (*clean.findings, *findings))
    pauses = np.searchsorted(time, clean.resumes) - 1
    stretches = tuple(_segments_between_gaps(grid.index, np.union1d(grid.gaps, pauses)))
    if len(gaps := np.setdiff1d(grid.gaps, pauses)):
        findings.append(_gap_finding(gaps, len(stretches), time, log))
    return GriddedSignals(grid.step, grid.start, placed, stretches, tuple(findings))


def _on_clean_clocks(signals: Mapping[str, Signal], log: str) -> tuple[dict[str, Signal], list[Finding]]:
    """role -> Signal with clean stamps; signals with equal stamps share one array of them."""
    groups: list[tuple[np.ndarray, list[str]]] = []
    for role, signal in signals.items():
        known = next((roles for time, roles in groups
                      if time is signal.time or np.array_equal(time, signal.time, equal_nan=True)), None)
        if known is None:
            groups.append((signal.time, [role]))
        else:
            known.append(role)
    clean: dict[str, Signal] = {}
    findings: list[Finding] = []
    for time, roles in groups:
        # A held torque repeats its values in any log: alone it does not show rows that were logged twice.
        sensor_values = [] if set(roles) <= set(INPUTS) else [signals[role].values for role in roles]
        at, keep, new = clean_clock(time, ", ".join(roles), log, sensor_values, signals[roles[0]].empty_stamps)
        if len(at) > 1:
            _refuse_vast(float(np.ptp(at)) / median_step(at), len(at), log)
        findings += new
        clean |= {role: Signal(at, values if keep is None else values[keep], signals[role].si)
                  for role in roles for values in [signals[role].values]}
    findings += [f for role in signals
                 for f in _missing_values_findings(role, signals[role], clean[role].time, log)]
    return {role: clean[role] for role in signals}, findings


def _missing_values_findings(role: str, signal: Signal, time: np.ndarray, log: str) -> list[Finding]:
    """A finding if rows or messages lack a value where one was due at the signal's own rate."""
    if not len(signal.empty_stamps) or len(time) < 2:
        return []
    own_step = median_step(time)
    place = np.searchsorted(time, signal.empty_stamps)
    inside = np.bincount(place, minlength=len(time) + 1)[1:-1]
    due = int(np.minimum(inside, np.maximum(np.round(np.diff(time) / own_step) - 1, 0)).sum())
    # Before the first sample and after the last: as many as fit at the signal's rate.
    for part in (time[0] - signal.empty_stamps[place == 0], signal.empty_stamps[place == len(time)] - time[-1]):
        due += len(set(np.floor(part / own_step + 1e-3).tolist()) - {0.0})
    due = max(due, signal.invalid_count)
    if not due:
        return []
    total = due + len(time)
    return [Finding(
        "warning", "samples-missing",
        f"{role} is missing or invalid at {100 * due / total:.2g} % of its samples in {log}.",
        {"role": role, "samples": due, "of": total, "share": due / total},
        "Check the recorder and the sensor. If the logger omits zeros (proto3 as JSON does), write "
        f"`absent: 0` for {role} in the channel map.")]


def refuse_single(clean: Mapping[str, Signal], logged: Mapping[str, Signal], log: str) -> None:
    """Refuse a signal with fewer than two clean stamps, however many were logged: they give no interval."""
    for role, signal in clean.items():
        if len(signal.time) < 2:
            count = len(logged[role].time)
            raise NotEnoughData(f"samples of {role} at different times in {log}",
                                f"{count} at one time" if count > 1 else f"{count}",
                                "Choose another clock with `time:` in the channel map." if count > 1
                                else "Record longer.")


def leader_of(signals: Mapping[str, Signal]) -> str:
    """The role whose clock the grid takes: of the fastest sensors, that with most samples.

    Inputs are known at every instant and need no grid of their own; a reference does not call for a finer one.

    signals  role -> Signal, with stamps as logged or clean
    """
    steps = {role: usual_step(signal.time) or np.inf for role, signal in signals.items()}
    own = {role: step for role, step in steps.items() if not role.startswith("reference_")} or steps
    own = {role: step for role, step in own.items() if role not in INPUTS} or own
    fastest = min(own.values())
    return max((role for role in own if own[role] <= (1 + STEP_TOLERANCE) * fastest),
               key=lambda role: len(signals[role].time))


def _divided_grid(time: np.ndarray, parts: int, samples: int, log: str) -> tuple[Grid, np.ndarray]:
    """(the grid through stamps (n,), each step in so many parts, with the place of each stamp; its times (m,)).

    samples  of the signal with most of them, whose number bounds that of the times
    """
    grid = fit_grid(time)
    step = grid.step / parts
    index = grid.index * parts if grid.uniform else np.round((time - grid.start) / step).astype(np.int64)
    count = int(index[-1]) + 1
    _refuse_vast(count, samples, log)
    at = np.interp(np.arange(count), index, time) if grid.uniform else grid.start + np.arange(count) * step
    return replace(grid, step=step, index=index), at


def _fill_lost_stamps(leader: str, signals: Mapping[str, Signal]) -> np.ndarray:
    """The leader's stamps, with those of other clocks where it lacks a sample."""
    time = signals[leader].time
    step = median_step(time)
    for other in {id(signal.time): signal.time for signal in signals.values() if signal.time is not time}.values():
        distance = np.abs(other - time[_nearest_stamps(other, time)]) / step
        missing = (distance > 0.5) & (np.abs(distance - np.round(distance)) < JITTER_TOLERANCE)
        missing &= (other > time[0]) & (other < time[-1])
        if missing.any() and abs(median_step(other) / step - 1) <= STEP_TOLERANCE:
            time = np.union1d(time, other[missing])
    return time


def _nearest_stamps(time: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """(n,) index of the stamp nearest to each time."""
    right = np.clip(np.searchsorted(stamps, time), 1, len(stamps) - 1)
    return right - (time - stamps[right - 1] < stamps[right] - time)


def _matching_grid_points(time: np.ndarray, at: np.ndarray, step: float) -> np.ndarray | None:
    """Grid points of the times (m,); None if they are not those of the grid (n,)."""
    if time[0] < at[0] - JITTER_TOLERANCE * step or time[-1] > at[-1] + JITTER_TOLERANCE * step:
        return None
    nearest = _nearest_stamps(time, at)
    if np.any(np.abs(time - at[nearest]) > JITTER_TOLERANCE * step) or np.any(np.diff(nearest) < 1):
        return None
    return nearest


def _refuse_vast(count: float, samples: int, log: str) -> None:
    """A grid that is nearly all gap would only fill the memory: a step takes up to 500 bytes in a fit."""
    if count > 50 * samples + 200_000:  # a choice: as much as a fit of few samples needs anyway
        raise BadRecording(f"one stretch of time in {log}", f"{samples} samples over {count:.0f} steps",
                           "Cut the record into files, one per run, or check the time stamps.")


def _values_on_grid(count: int, places: np.ndarray, values: np.ndarray, is_input: bool) -> np.ndarray:
    """(count,) with values at their places; an input is held where no sample of its own was lost, NaN elsewhere."""
    if count == len(values):
        return values
    placed = np.full(count, np.nan)
    if not is_input:
        placed[places] = values
        return placed
    hold_steps = np.round(hold_times(places.astype(float))).astype(np.int64)
    last = np.searchsorted(places, np.arange(count), side="right") - 1
    known = (last >= 0) & (np.arange(count) < (places + hold_steps)[last])
    placed[known] = values[last[known]]
    return placed


def _segments_between_gaps(places: np.ndarray, gaps: np.ndarray) -> list[tuple[int, int]]:
    """(first, last+1) grid points of the stretches between gaps."""
    first = places[np.concatenate([[0], gaps + 1]).astype(np.int64)]
    last = places[np.concatenate([gaps, [len(places) - 1]]).astype(np.int64)]
    return [(int(a), int(b) + 1) for a, b in zip(first, last, strict=True)]


def _convert_to_grid(at: np.ndarray, step: float, signal: Signal, own_step: float, is_input: bool,
                     on_grid_clock: bool) -> np.ndarray:
    """(n,) a signal at the grid points (n,); on_grid_clock: the grid is fitted to its stamps."""
    time, values = signal.time, signal.values
    if is_input:
        return (_zero_order_hold if on_grid_clock else average_over_steps)(at, step, time, values)
    if step > MIN_RATE_RATIO * own_step:
        return low_pass_reference(at, step, time, values)
    found = _interpolate(at, step, time, values)
    return _keep_nearest_points(found, at, time) if own_step > MIN_RATE_RATIO * step else found


def _keep_nearest_points(values: np.ndarray, at: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Values (n,) of a slow sensor at the grid points next to its samples alone: others would be invented."""
    nearest = _nearest_stamps(time, at)
    found = np.full(len(values), np.nan)
    found[nearest] = values[nearest]
    return found


def _zero_order_hold(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Zero order hold of what acts in the middle of each step; NaN where a sample was lost."""
    middle = at + 0.5 * step
    index = np.searchsorted(time, middle, side="right") - 1
    known = (index >= 0) & (middle < (time + hold_times(time) + JITTER_TOLERANCE * step)[index])
    return np.where(known, values[index], np.nan)


def _interpolate(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Linear between neighbours that are near each other, and next to samples that are not."""
    right = np.clip(np.searchsorted(time, at, side="right"), 1, len(time) - 1)
    before, after = time[right - 1], time[right]
    nearest = np.minimum(np.abs(at - before), np.abs(after - at))
    inside = (at >= time[0] - JITTER_TOLERANCE * step) & (at <= time[-1] + JITTER_TOLERANCE * step)
    near = (after - before <= (MAX_STEPS_WITHIN_SEGMENT + 2 * JITTER_TOLERANCE) * step) | (nearest <= 0.5 * step)
    return np.where(inside & near, np.interp(at, time, values), np.nan)


def _require_overlap(placed: Mapping[str, np.ndarray], log: str, findings: Sequence[Finding]) -> None:
    """A signal without a value on the grid was recorded at another time, or by another clock."""
    for role, values in placed.items():
        if not np.any(np.isfinite(values)):
            offset_hint = next((f" {f.text} {f.action}" for f in findings
                                if f.code == "clock-offset" and role in f.evidence.values()), "")
            raise BadRecording(f"{role} at the time of the other signals in {log}",
                               "clocks that do not overlap",
                               f"Record all signals on one clock, or leave the role out.{offset_hint}")


def _resampled_finding(grid: Grid, signals: Mapping[str, Signal], leader: str, log: str) -> Finding:
    several = len({id(signal.time) for signal in signals.values()}) > 1
    why = "the signals have different clocks" if several else \
        f"the time stamps are up to {100 * grid.jitter:.0f} % of a step off a uniform grid"
    steps = {f"step_{role}": median_step(signal.time) for role, signal in signals.items()}
    return Finding("note" if several else "warning", "resampled",
                   f"{log} is resampled to a grid of {grid.step:.6g} s, the clock of {leader}, because {why}; "
                   "torques are held, sensors interpolated.",
                   {"step": grid.step, "jitter": grid.jitter, **steps},
                   "" if several else "Record with a fixed rate.")


def _slowed_finding(slowed: Mapping[str, float], grid: Grid, log: str) -> Finding:
    return Finding("note", "resampled",
                   f"{', '.join(slowed)} of {log} have a higher rate than the grid and were low-passed without "
                   f"delay at {ANTIALIAS_CUT_OFF / grid.step:.4g} Hz.",
                   {"step": grid.step, "cut_off": ANTIALIAS_CUT_OFF / grid.step,
                    **{f"step_{role}": own for role, own in slowed.items()}})


def _lost_finding(grid: Grid, log: str) -> Finding:
    return Finding("warning", "samples-missing",
                   f"{log} lacks {grid.lost} single samples ({100 * grid.lost / grid.size:.2g} %); the "
                   "torque is held over them and sensors have no value there.",
                   {"samples": grid.lost, "of": grid.size}, "Check the recorder for overload.")


def _gap_finding(gaps: np.ndarray, segments: int, time: np.ndarray, log: str) -> Finding:
    lengths = np.diff(time)[gaps]
    often = "once" if len(lengths) == 1 else f"{len(lengths)} times"
    return Finding("warning", "recording-interrupted",
                   f"{log} is interrupted {often}, for up to {lengths.max():.4g} s; it is used as "
                   f"{segments} segments.",
                   {"gaps": len(lengths), "longest": float(lengths.max()),
                    "first_at": float(time[gaps[0]])},
                   "Check the recorder for overload.")
