"""The one door: from a recording to an experiment. After it all data is SI, uniform and immutable."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivetool.errors import BadRecording, Finding, NotEnoughData
from drivetool.logs.channel_map import ChannelMap, choose_channels
from drivetool.logs.clocks.resample import leader_of, onto_grid
from drivetool.logs.condition import Step, condition, parse_step
from drivetool.logs.convert import shared_units, to_signals
from drivetool.logs.experiment import Experiment, Recording
from drivetool.logs.parts import cut, restarted
from drivetool.logs.read import read_recording
from drivetool.logs.roles import INPUTS, quantity
from drivetool.logs.samples.counts import made_of_counts
from drivetool.logs.samples.speed_check import compare_speed_and_angle
from drivetool.logs.samples.unmeasured import unmeasured

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
    findings = [*recording.findings, *findings, *units.findings, *left.findings]
    gridded = onto_grid(left.signals, recording.name)
    findings += [*unmeasured(gridded.clean), *gridded.findings]
    offset = gridded.start - left.start if left.findings else 0.0
    segments, on_grid = restarted(gridded.segments, gridded.signals, left.parts, offset, gridded.step)
    gridded = replace(gridded, signals=on_grid)
    segments, more = _cut(segments, gridded.signals, recording.name)
    findings += more
    inside = _inside(segments, len(next(iter(gridded.signals.values()))))
    findings += _sparse(gridded.signals, inside)
    findings += _constant(gridded.signals, inside, recording.name)
    findings += made_of_counts(gridded.signals, segments, gridded.step)
    for body in dict.fromkeys(role.rpartition("_")[0] for role in gridded.signals):
        angle, speed = f"{body}_angle", f"{body}_speed"
        if angle in gridded.signals and speed in gridded.signals:
            told = any(f.code == "clock-offset" and {angle, speed} <= set(f.evidence.values()) for f in findings)
            findings += [f for f in compare_speed_and_angle(gridded.signals[angle], gridded.signals[speed],
                                                            gridded.step, segments, body)
                         if not (told and f.code in ("speed-delay", "speed-filtered"))]
    return Experiment(
        name=recording.name, sha256=recording.sha256, step=gridded.step,
        start=round(recording.origin + gridded.start, 9),
        signals={role: _frozen(values) for role, values in gridded.signals.items()},
        segments=segments, torque_unit=units.torque, motion_unit=units.motion, input_units=units.inputs,
        torque_is=channel_map.torque_is if channel_map else "unknown", findings=tuple(findings),
        offset=round(offset, 9),
        magnitudes=tuple(r for r, entry in channel_map.roles.items() if entry.unsigned) if channel_map else ())


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


def _constant(signals: Mapping[str, np.ndarray], inside: np.ndarray, log: str) -> list[Finding]:
    """Signals that never change: a finding each, an error if neither torque nor motion does."""
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
    motions = {role for role in signals if quantity(role) != "torque"}
    if not drives | motions:
        raise BadRecording(f"motor_torque or a motion in {log}", f"only {', '.join(signals)}",
                           "Name their channels in the channel map.")
    if drives | motions <= constant:
        names = ", ".join(sorted(drives | motions))
        raise NotEnoughData(f"a torque or a motion that changes in {log}", f"only constant signals ({names})",
                            "Check the channels; if they are right, record while the drive is excited.")
    return [Finding("warning", "constant-signal", f"{role} never changes: {value:g} throughout.",
                    {"role": role, "value": value}, "Check that it is the right channel.")
            for role, value in still]
