"""Signals onto one uniform grid: as they are where possible, otherwise held or interpolated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.errors import BadRecording, Finding, NotEnoughData
from drivetool.logs import BRIDGE_STEPS, INPUTS, JITTER, LIKE_STEP, Grid, Signal, fit_grid, median_step, usual_step
from drivetool.logs.clocks.clean_stamps import Clock, clean_clock
from drivetool.logs.clocks.clock_offset import clock_offsets
from drivetool.logs.clocks.rate import CUT_OFF, FASTER, average, held_for, low_passed


@dataclass(frozen=True)
class Clean:
    """Signals on clean clocks.

    signals  role -> Signal, its stamps strictly increasing; clocks: role -> Clock, one for all with equal stamps
    leader   the role whose clock the grid takes; time (n,) its stamps, with those of others that it lacks [s]
    resumes  when the logger came back to this rate from another one [s]
    """

    signals: Mapping[str, Signal]
    clocks: Mapping[str, Clock]
    leader: str
    time: np.ndarray
    findings: tuple[Finding, ...] = ()
    resumes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Gridded:
    """Signals on a grid: step, start [s]; role -> (n,); segments without a gap."""

    step: float
    start: float
    signals: Mapping[str, np.ndarray]
    segments: tuple[tuple[int, int], ...]
    findings: tuple[Finding, ...]


def cleaned(signals: Mapping[str, Signal], log: str) -> Clean:
    """The signals with every stamp once and in order.

    signals  role -> Signal, with stamps as logged
    raises   BadRecording: time goes backwards; NotEnoughData: a signal with fewer than two samples
    """
    clocks, findings = _clean(signals, log)
    refuse_single(signals, clocks, log)
    clean = {role: Signal(clocks[role].time, clocks[role].of(signal.values), signal.si)
             for role, signal in signals.items()}
    return led(clean, clocks, (*findings, *clock_offsets(clean, log)))


def led(clean: Mapping[str, Signal], clocks: Mapping[str, Clock], findings: tuple[Finding, ...],
        resumes: tuple[float, ...] = ()) -> Clean:
    """Clean signals with what leads them."""
    leader = leader_of({role: clock.time for role, clock in clocks.items()})
    return Clean(clean, clocks, leader, _filled(leader, clocks), findings, resumes)


def onto_grid(clean: Clean, log: str) -> Gridded:
    """All signals on the grid of the fastest sensor, its steps divided where an input is faster.

    Samples whose stamps are those of the grid are taken as they are, bit by bit. Others are converted. An input is
    averaged over what is held during each step, which is exact in what the drive feels. A sensor is interpolated
    between neighbours at most 3 steps apart; a slower one has a value only at the grid points next to its samples.
    What is faster (references alone) is low-passed (rate.py).

    returns  Gridded; neighbours more than 3 steps apart begin a new segment
    raises   BadRecording: clocks that do not overlap
    """
    clocks, leader, time, findings = clean.clocks, clean.leader, clean.time, []
    values = {role: signal.values for role, signal in clean.signals.items()}
    grid, at = _grid(time, _parts(time, clocks), log)
    index = grid.index
    placed: dict[str, np.ndarray] = {}
    slowed: dict[str, float] = {}
    converted = not grid.uniform
    for role, clock in clocks.items():
        places = _places(clock.time, at, grid.step) if grid.uniform else None
        if places is not None:
            placed[role] = _place(len(at), places, values[role], role in INPUTS)
            continue
        own = median_step(clock.time)
        if grid.step > FASTER * own and role not in INPUTS:
            slowed[role] = own
        converted = True
        alike = clock is clocks[leader]
        placed[role] = _converted(at, grid.step, clock.time, values[role], own, role in INPUTS, alike)
    if grid.uniform and grid.lost:
        findings.append(_lost_finding(grid, log))
    if slowed:
        findings.append(_slowed_finding(slowed, grid, log))
    if converted:
        findings.append(_resampled_finding(grid, clocks, leader, log))
        _require_overlap(placed, log, (*clean.findings, *findings))
    pauses = np.searchsorted(time, clean.resumes) - 1
    stretches = tuple(_stretches(index, np.union1d(grid.gaps, pauses)))
    if len(gaps := np.setdiff1d(grid.gaps, pauses)):
        findings.append(_gap_finding(gaps, len(stretches), time, log))
    return Gridded(grid.step, grid.start, placed, stretches, tuple(findings))


def _clean(signals: Mapping[str, Signal], log: str) -> tuple[dict[str, Clock], list[Finding]]:
    """role -> Clock; signals with equal stamps share one Clock object."""
    groups: list[tuple[np.ndarray, list[str]]] = []
    for role, signal in signals.items():
        known = next((roles for time, roles in groups
                      if time is signal.time or np.array_equal(time, signal.time, equal_nan=True)), None)
        if known is None:
            groups.append((signal.time, [role]))
        else:
            known.append(role)
    clocks: dict[str, Clock] = {}
    findings: list[Finding] = []
    for time, roles in groups:
        # A torque that is held repeats its values whoever logs it: alone it tells no row that was logged twice.
        told = [] if set(roles) <= set(INPUTS) else [signals[role].values for role in roles]
        clock, new = clean_clock(time, ", ".join(roles), log, told, signals[roles[0]].without)
        if len(clock.time) > 1:
            _refuse_vast(float(np.ptp(clock.time)) / median_step(clock.time), len(clock.time), log)
        findings += new
        clocks |= dict.fromkeys(roles, clock)
    findings += [f for role in signals for f in _absent(role, signals[role], clocks[role].time, log)]
    return {role: clocks[role] for role in signals}, findings


def _absent(role: str, signal: Signal, time: np.ndarray, log: str) -> list[Finding]:
    """A finding if rows or messages lack a value where one was due at the signal's own rate."""
    if not len(signal.without) or len(time) < 2:
        return []
    own = median_step(time)
    place = np.searchsorted(time, signal.without)
    inside = np.bincount(place, minlength=len(time) + 1)[1:-1]
    due = int(np.minimum(inside, np.maximum(np.round(np.diff(time) / own) - 1, 0)).sum())
    # Before the first sample and after the last: as many as fit at the signal's rate.
    for part in (time[0] - signal.without[place == 0], signal.without[place == len(time)] - time[-1]):
        due += len(set(np.floor(part / own + 1e-3).tolist()) - {0.0})
    due = max(due, signal.broken)
    if not due:
        return []
    of = due + len(time)
    return [Finding(
        "warning", "missing-values",
        f"{role} has no value that can be used at {100 * due / of:.2g} % of its samples in {log}.",
        {"role": role, "samples": due, "of": of, "share": due / of},
        "Check the recorder and the sensor. If the writer leaves zeros out (proto3 as JSON does), write "
        f"`absent: 0` for {role} in the channel map.")]


def refuse_single(signals: Mapping[str, Signal], clocks: Mapping[str, Clock], log: str) -> None:
    """One stamp is no clock."""
    for role, clock in clocks.items():
        if len(clock.time) < 2:
            count = len(signals[role].time)
            raise NotEnoughData(f"samples of {role} at different times in {log}",
                                f"{count} at one time" if count > 1 else f"{count}",
                                "Choose another clock with `time:` in the channel map." if count > 1
                                else "Record longer.")


def leader_of(times: Mapping[str, np.ndarray]) -> str:
    """The role whose clock the grid takes: of the fastest sensors, that with most samples.

    Inputs are known at every instant, and need no grid of their own; what the loop is asked for is no reason for a
    finer one.

    times  role -> (n,) stamps, as logged or clean
    """
    steps = {role: usual_step(time) or np.inf for role, time in times.items()}
    own = {role: step for role, step in steps.items() if not role.startswith("reference_")} or steps
    own = {role: step for role, step in own.items() if role not in INPUTS} or own
    fastest = min(own.values())
    return max((role for role in own if own[role] <= (1 + LIKE_STEP) * fastest), key=lambda role: len(times[role]))


def _parts(time: np.ndarray, clocks: Mapping[str, Clock]) -> int:
    """Into how many parts a step between stamps (n,) is divided, for the fastest input."""
    fastest = min((median_step(clocks[role].time) for role in INPUTS if role in clocks), default=np.inf)
    return max(1, round(median_step(time) / fastest))


def _grid(time: np.ndarray, parts: int, log: str) -> tuple[Grid, np.ndarray]:
    """(the grid through stamps (n,), each step in so many parts, with the place of each stamp; its times (m,))."""
    grid = fit_grid(time)
    step = grid.step / parts
    index = grid.index * parts if grid.uniform else np.round((time - grid.start) / step).astype(np.int64)
    count = int(index[-1]) + 1
    _refuse_vast(count, len(time) * parts, log)
    at = np.interp(np.arange(count), index, time) if grid.uniform else grid.start + np.arange(count) * step
    return replace(grid, step=step, index=index), at


def _filled(leader: str, clocks: Mapping[str, Clock]) -> np.ndarray:
    """The leader's stamps, with those of other clocks where it lacks a sample."""
    time = clocks[leader].time
    step = median_step(time)
    for clock in {id(clock): clock for clock in clocks.values() if clock is not clocks[leader]}.values():
        away = np.abs(clock.time - time[_nearest(clock.time, time)]) / step
        missing = (away > 0.5) & (np.abs(away - np.round(away)) < JITTER)
        missing &= (clock.time > time[0]) & (clock.time < time[-1])
        if missing.any() and abs(median_step(clock.time) / step - 1) <= LIKE_STEP:
            time = np.union1d(time, clock.time[missing])
    return time


def _nearest(time: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """(n,) index of the stamp nearest to each time."""
    right = np.clip(np.searchsorted(stamps, time), 1, len(stamps) - 1)
    return right - (time - stamps[right - 1] < stamps[right] - time)


def _places(time: np.ndarray, at: np.ndarray, step: float) -> np.ndarray | None:
    """Grid points of the times (m,); None if they are not those of the grid (n,)."""
    if time[0] < at[0] - JITTER * step or time[-1] > at[-1] + JITTER * step:
        return None
    nearest = _nearest(time, at)
    if np.any(np.abs(time - at[nearest]) > JITTER * step) or np.any(np.diff(nearest) < 1):
        return None
    return nearest


def _refuse_vast(count: float, samples: int, log: str) -> None:
    """A grid that is nearly all gap would only fill the memory."""
    if count > 50 * samples + 1_000_000:
        raise BadRecording(f"one stretch of time in {log}", f"{samples} samples over {count:.0f} steps",
                           "Cut the record into files, one per run.")


def _place(count: int, places: np.ndarray, values: np.ndarray, is_input: bool) -> np.ndarray:
    """(count,) with values at their places; an input is held where no sample of its own was lost, NaN elsewhere."""
    if count == len(values):
        return values
    placed = np.full(count, np.nan)
    if not is_input:
        placed[places] = values
        return placed
    for_ = np.round(held_for(places.astype(float))).astype(np.int64)
    last = np.searchsorted(places, np.arange(count), side="right") - 1
    known = (last >= 0) & (np.arange(count) < (places + for_)[last])
    placed[known] = values[last[known]]
    return placed


def _stretches(places: np.ndarray, gaps: np.ndarray) -> list[tuple[int, int]]:
    """(first, last+1) grid points of the stretches between gaps."""
    first = places[np.concatenate([[0], gaps + 1]).astype(np.int64)]
    last = places[np.concatenate([gaps, [len(places) - 1]]).astype(np.int64)]
    return [(int(a), int(b) + 1) for a, b in zip(first, last, strict=True)]


def _converted(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray, own: float,
               is_input: bool, alike: bool) -> np.ndarray:
    """(n,) a signal with a step `own` at the grid points (n,); alike: the grid is fitted to its stamps."""
    if is_input:
        return (_hold if alike else average)(at, step, time, values)
    if step > FASTER * own:
        return low_passed(at, step, time, values)
    found = _interpolate(at, step, time, values)
    return _once_each(found, at, time) if own > FASTER * step else found


def _once_each(values: np.ndarray, at: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Values (n,) of a slow sensor at the grid points next to its samples alone: others would be invented."""
    nearest = _nearest(time, at)
    found = np.full(len(values), np.nan)
    found[nearest] = values[nearest]
    return found


def _hold(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Zero order hold of what acts in the middle of each step; NaN where a sample was lost."""
    middle = at + 0.5 * step
    index = np.searchsorted(time, middle, side="right") - 1
    known = (index >= 0) & (middle < (time + held_for(time) + JITTER * step)[index])
    return np.where(known, values[index], np.nan)


def _interpolate(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Linear between neighbours that are near each other, and next to samples that are not."""
    right = np.clip(np.searchsorted(time, at, side="right"), 1, len(time) - 1)
    before, after = time[right - 1], time[right]
    nearest = np.minimum(np.abs(at - before), np.abs(after - at))
    inside = (at >= time[0] - JITTER * step) & (at <= time[-1] + JITTER * step)
    near = (after - before <= (BRIDGE_STEPS + 2 * JITTER) * step) | (nearest <= 0.5 * step)
    return np.where(inside & near, np.interp(at, time, values), np.nan)


def _require_overlap(placed: Mapping[str, np.ndarray], log: str, findings: Sequence[Finding]) -> None:
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
                   f"{', '.join(slowed)} of {log} came faster than the grid and were low-passed without "
                   f"delay at {CUT_OFF / grid.step:.4g} Hz.",
                   {"step": grid.step, "cut_off": CUT_OFF / grid.step,
                    **{f"step_{role}": own for role, own in slowed.items()}})


def _lost_finding(grid: Grid, log: str) -> Finding:
    return Finding("warning", "lost-samples",
                   f"{log} lacks {grid.lost} single samples ({100 * grid.lost / grid.size:.2g} %); the "
                   "torque is held over them and sensors have no value there.",
                   {"samples": grid.lost, "of": grid.size}, "Check the recorder for overload.")


def _gap_finding(gaps: np.ndarray, segments: int, time: np.ndarray, log: str) -> Finding:
    lengths = np.diff(time)[gaps]
    often = "once" if len(lengths) == 1 else f"{len(lengths)} times"
    return Finding("warning", "gaps",
                   f"{log} is interrupted {often}, for up to {lengths.max():.4g} s; it is used as "
                   f"{segments} segments.",
                   {"gaps": len(lengths), "longest": float(lengths.max()),
                    "first_at": float(time[gaps[0]])},
                   "Check the recorder for overload.")
