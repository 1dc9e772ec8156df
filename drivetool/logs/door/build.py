"""The one door: from a recording to an experiment. After it all data is SI, uniform and immutable."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivetool.errors import BadRecording, Finding, NotEnoughData
from drivetool.logs import INPUTS, Experiment, Recording, is_motion, quantity
from drivetool.logs.channels import ChannelMap, choose_channels, shared_units, to_signals
from drivetool.logs.clocks import Clean, Rate, at_rate, cleaned, leader_of, onto_grid, rates
from drivetool.logs.conditioning import Cut, Step, condition, cut, parse_step, restarted
from drivetool.logs.formats import read_recording
from drivetool.logs.samples import compare_speed_and_angle, made_of_counts, unmeasured

# Fewer samples than this answer no question about a drive; the second: a piece this short cannot
# even pay for its own start states.
MIN_SAMPLES = 50
MIN_SEGMENT = 10


def open_experiment(path: str | Path, channel_map: ChannelMap | None = None,
                    steps: Sequence[str] = (), further: Sequence[str] = ()) -> Experiment:
    """A log file as an experiment.

    path         .parquet or .mcap, or a folder of the parts of a .parquet
    channel_map  which channel plays which role; None takes channels named like the roles
    steps        conditioning after that of the map, such as 'lowpass cutoff=50'
    further      roles that the drive has besides those of the table; without a map channels may be named like them
    returns      Experiment
    raises       BadRecording, NotEnoughData, BadOption: see read_recording, build_experiment, condition
    """
    todo = [parse_step(text) for text in (*(channel_map.condition if channel_map else ()), *steps)]
    recording = read_recording(path, channel_map, further=further)
    return condition(build_experiment(recording, channel_map, todo, further), todo)


def build_experiment(recording: Recording, channel_map: ChannelMap | None = None,
                     steps: Sequence[Step] = (), further: Sequence[str] = ()) -> Experiment:
    """A recording as an experiment: roles, SI, one grid, segments, and what was wrong.

    recording    channels on their own clocks
    channel_map  which channel plays which role; None takes channels named like the roles
    steps        conditioning, of which the parts of the recording to keep or to omit are taken here
    further      see open_experiment
    returns      Experiment; its findings say what was repaired, lost or looks wrong
    raises       BadRecording: role, unit or time that cannot be used;
                 NotEnoughData: fewer than 50 samples, or nothing moves
    """
    chosen = choose_channels(tuple(recording.channels), channel_map, recording.name, further)
    signals, findings = to_signals(recording, chosen, channel_map)
    units = shared_units(signals, recording.name)
    left = cut(signals, leader_of({role: s.time for role, s in signals.items()}), steps, recording.name)
    clean = cleaned(left.signals, recording.name)
    blank = Experiment(
        recording.name, recording.sha256, 0.0, recording.origin, {}, (), units.torque, units.motion,
        channel_map.torque_is if channel_map else "unknown",
        (*recording.findings, *findings, *units.findings, *left.findings), input_units=units.inputs,
        magnitudes=tuple(r for r, entry in channel_map.roles.items() if entry.unsigned) if channel_map else ())
    if found := rates(clean.time):
        return _at_rates(blank, clean, left, found)
    return _on_grid(blank, clean, left, recording.name)


def _at_rates(blank: Experiment, clean: Clean, left: Cut, found: Sequence[Rate]) -> Experiment:
    """The experiment at the rate at which most was excited, the others beside it, each on a grid of its own.

    blank   what does not depend on the grid
    raises  BadRecording, NotEnoughData: none of them can be used; what the first lacks
    """
    log, parts, errors = blank.name, [], []
    for rate in found:
        label = f"the part of {log} at {rate.text}"
        try:
            part = _on_grid(replace(blank, findings=()), at_rate(clean, rate, label), left, label, rate)
        except (BadRecording, NotEnoughData) as error:
            errors.append((rate, error))
        else:
            parts.append(replace(part, begins=rate is found[0]))
    if not parts:
        raise errors[0][1]
    told = [Finding("warning", "part-left-out", f"The part of {log} at {rate.text} is left out: {error}",
                    {"step": rate.step}) for rate, error in errors]
    if len(parts) > 1:
        told.append(Finding(
            "note", "rate-changes",
            f"{log} changes its rate: {', '.join(f'{p.used} samples at {p.rate}' for p in parts)}. Each rate has a "
            "grid of its own.", {f"samples at {p.rate}": p.used for p in parts}))
    main = max(parts, key=_excitation)
    findings = [*blank.findings, *told]
    for part in parts:
        findings += [f for f in part.findings if f not in findings]
    return replace(main, others=tuple(replace(p, findings=()) for p in parts if p is not main),
                   findings=tuple(findings))


def _excitation(experiment: Experiment) -> float:
    """Sum of the squares of the motor torque about its mean: with it grows what a recording tells of a drive."""
    values = experiment.signals.get("motor_torque", next(iter(experiment.signals.values())))
    seen = values[_inside(experiment.segments, experiment.size)]
    return float(np.nansum((seen - np.nanmean(seen)) ** 2))


def _on_grid(blank: Experiment, clean: Clean, left: Cut, log: str, rate: Rate | None = None) -> Experiment:
    """The experiment on one grid, with its findings.

    blank  what does not depend on the grid
    log    what messages call it; rate: of which the signals are a part; None: all
    """
    gridded = onto_grid(clean, log)
    offset = gridded.start - left.start if left.findings or rate else 0.0
    findings = [*unmeasured(clean.signals), *clean.findings, *gridded.findings]
    segments, signals = restarted(gridded.segments, gridded.signals, left.parts, offset, gridded.step)
    segments, more = _cut(segments, signals, log)
    inside = _inside(segments, len(next(iter(signals.values()))))
    findings += [*more, *_sparse(signals, inside), *_constant(signals, inside, log, f" in {log}" if rate else "")]
    findings += made_of_counts(signals, segments, gridded.step)
    for body in dict.fromkeys(role.rpartition("_")[0] for role in signals):
        angle, speed = f"{body}_angle", f"{body}_speed"
        if angle in signals and speed in signals:
            told = any(f.code == "clock-offset" and {angle, speed} <= set(f.evidence.values()) for f in findings)
            compared = compare_speed_and_angle(signals[angle], signals[speed], gridded.step, segments, body)
            findings += [f for f in compared if not (told and f.code in ("speed-delay", "speed-filtered"))]
    return replace(
        blank, step=gridded.step, start=round(blank.start + gridded.start, 9),
        signals={role: _frozen(values) for role, values in signals.items()}, segments=segments,
        findings=(*blank.findings, *findings), offset=round(offset, 9))


def _frozen(values: np.ndarray) -> np.ndarray:
    """A view that cannot be written to; the recording's own array stays as it was."""
    view = np.ascontiguousarray(values, dtype=float).view()
    view.setflags(write=False)
    return view


def _cut(segments: Iterable[tuple[int, int]], signals: Mapping[str, np.ndarray],
         log: str) -> tuple[tuple[tuple[int, int], ...], list[Finding]]:
    """Segments without a missing torque; too short pieces are dropped."""
    usable = np.ones(len(next(iter(signals.values()))), dtype=bool)
    for role in INPUTS:
        if role in signals:
            usable &= np.isfinite(signals[role])
    pieces, missing = [], 0
    for first, last in segments:
        part = np.concatenate([[False], usable[first:last], [False]])
        edges = np.flatnonzero(np.diff(part.astype(np.int8)))
        pieces += [(first + int(a), first + int(b)) for a, b in edges.reshape(-1, 2)]
        missing += int(np.sum(~usable[first:last]))
    kept = tuple(p for p in pieces if p[1] - p[0] >= MIN_SEGMENT)
    total = sum(b - a for a, b in kept)
    if total < MIN_SAMPLES:
        if missing:
            raise NotEnoughData(f"at least {MIN_SAMPLES} samples without a gap in {log}",
                                f"{total}, since the torque has no value at {missing} of {len(usable)}",
                                "Check the recorder; the model cannot run without the torque.")
        raise NotEnoughData(f"at least {MIN_SAMPLES} samples without a gap in {log}",
                            f"{len(usable)}, of which {total} are in stretches of {MIN_SEGMENT} or more",
                            "Record longer or at a higher rate.")
    findings = []
    if missing:
        there = _inside(segments, len(usable))
        known = np.flatnonzero(there & usable)
        between = int(there[known[0]:known[-1] + 1].sum()) > len(known)
        findings.append(Finding(
            "warning" if between else "note", "torque-missing", f"The torque has no value at {missing} samples of "
            f"{log}; {f'the record is cut there into {len(pieces)} segments' if between else 'they are left out'}.",
            {"samples": missing, "segments": len(pieces)},
            "Check the recorder; the model cannot run without the torque."))
    if len(kept) < len(pieces):
        short = sum(b - a for a, b in pieces) - total
        findings.append(Finding(
            "warning" if short > total else "note", "short-segments",
            f"{len(pieces) - len(kept)} segments of {log} shorter than {MIN_SEGMENT} samples are left out, {short} "
            f"of {short + total} samples.",
            {"segments": len(pieces) - len(kept), "samples": short, "of": short + total}))
    return kept, findings


def _inside(segments: Iterable[tuple[int, int]], size: int) -> np.ndarray:
    """(n,) whether a grid point lies in a segment."""
    inside = np.zeros(size, dtype=bool)
    for first, last in segments:
        inside[first:last] = True
    return inside


def _sparse(signals: Mapping[str, np.ndarray], inside: np.ndarray) -> list[Finding]:
    """Sensors with a value at fewer than half of the grid points."""
    findings = []
    for role, values in signals.items():
        share = float(np.mean(np.isfinite(values[inside])))
        if role not in INPUTS and share < 0.5:
            findings.append(Finding(
                "note", "sparse-sensor",
                f"{role} has a value at only {100 * share:.2g} % of the grid points.",
                {"role": role, "share": share}))
    return findings


def _constant(signals: Mapping[str, np.ndarray], inside: np.ndarray, log: str, where: str) -> list[Finding]:
    """Signals that never change: a finding each, an error if neither torque nor motion does.

    where  what the finding says of the place
    """
    still = []
    for role, values in signals.items():
        seen = values[inside & np.isfinite(values)]
        if len(seen) == 0:
            raise BadRecording(f"values of {role} where {log} can be used", "none",
                               "Choose another channel, or leave the role out.")
        if np.ptp(seen) == 0.0:
            still.append((role, float(seen[0])))
    constant = {role for role, _ in still}
    drives = {"motor_torque"} & set(signals)
    motions = {role for role in signals if is_motion(role)}
    if not drives | motions:
        raise BadRecording(f"motor_torque or a motion in {log}", f"only {', '.join(signals)}",
                           "Name their channels in the channel map.")
    if drives | motions <= constant:
        names = ", ".join(sorted(drives | motions))
        raise NotEnoughData(f"a torque or a motion that changes in {log}", f"only constant signals ({names})",
                            "Check the channels; if they are right, record while the drive is excited.")
    return [Finding("warning", "constant-signal", f"{role} never changes{where}: {value:g} throughout.",
                    {"role": role, "value": value}, "Check that it is the right channel.")
            for role, value in still if quantity(role) not in ("voltage", "frequency")]
