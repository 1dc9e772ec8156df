"""The one door: from a recording to an experiment. After it all data is SI, uniform and immutable."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivetool.errors import BadRecording, NotEnoughData
from drivetool.finding import Finding
from drivetool.logs import INPUTS, MIN_SAMPLES, Experiment, Recording, is_motion, quantity, true_runs
from drivetool.logs.channels import ChannelMap, choose_channels, shared_units, to_signals
from drivetool.logs.clocks import CleanSignals, Rate, at_rate, clean_signals, find_rates, leader_of, onto_grid
from drivetool.logs.conditioning import (
    ConditioningStep,
    CutSignals,
    condition,
    cut_signals,
    parse_step,
    read_only,
    restart_after_cuts,
)
from drivetool.logs.formats import read_recording
from drivetool.logs.samples import compare_speed_and_angle, quantised_speed_findings, unmeasured_findings

MIN_SEGMENT = 10  # samples; a shorter segment is used up by the estimation of its own initial states


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
                     steps: Sequence[ConditioningStep] = (), further: Sequence[str] = ()) -> Experiment:
    """A recording as an experiment: roles, SI, one grid, segments, and what is wrong with it.

    recording    channels on their own clocks
    channel_map  which channel plays which role; None takes channels named like the roles
    steps        conditioning, of which keep and omit are applied here
    further      see open_experiment
    returns      Experiment; its findings say what was repaired, lost or looks wrong
    raises       BadRecording: role, unit or time that cannot be used;
                 NotEnoughData: fewer than 50 samples, or nothing moves
    """
    chosen = choose_channels(tuple(recording.channels), channel_map, recording.name, further)
    signals, findings = to_signals(recording, chosen, channel_map)
    torque_unit, motion_unit, input_units, mixed = shared_units(signals, recording.name)
    cut_record = cut_signals(signals, leader_of(signals), steps, recording.name)
    clean = clean_signals(cut_record.signals, recording.name)
    blank = Experiment(
        recording.name, recording.sha256, 0.0, recording.origin, {}, (), torque_unit, motion_unit,
        channel_map.torque_is if channel_map else "unknown",
        (*recording.findings, *findings, *mixed, *cut_record.findings), input_units=input_units,
        magnitudes=tuple(r for r, entry in channel_map.roles.items() if entry.unsigned) if channel_map else ())
    if found_rates := find_rates(clean.time):
        return _experiment_at_rates(blank, clean, cut_record, found_rates)
    return _experiment_on_grid(blank, clean, cut_record, recording.name)


def _experiment_at_rates(blank: Experiment, clean: CleanSignals, cut_record: CutSignals,
                         found_rates: Sequence[Rate]) -> Experiment:
    """The experiment at the rate with the largest excitation; other rates are in `others`, each on its own grid.

    blank   what does not depend on the grid
    raises  BadRecording, NotEnoughData: none of them can be used; the error of the first
    """
    log, parts, errors = blank.name, [], []
    for rate in found_rates:
        label = f"the part of {log} at {rate.text}"
        try:
            part = _experiment_on_grid(replace(blank, findings=()), at_rate(clean, rate, label), cut_record, label,
                                       rate)
        except (BadRecording, NotEnoughData) as error:
            errors.append((rate, error))
        else:
            parts.append(replace(part, begins=rate is found_rates[0]))
    if not parts:
        raise errors[0][1]
    rate_findings = [Finding("warning", "rate-changes",
                             f"The samples of {log} at {rate.text} are left out: {error}",
                             {"step": rate.step}) for rate, error in errors]
    if len(parts) > 1:
        rate_findings.append(Finding(
            "note", "rate-changes",
            f"{log} changes its rate: {', '.join(f'{p.used} samples at {p.rate}' for p in parts)}. Each rate has a "
            "grid of its own.", {f"samples at {p.rate}": p.used for p in parts}))
    main = max(parts, key=_excitation)
    findings = [*blank.findings, *rate_findings]
    for part in parts:
        findings += [f for f in part.findings if f not in findings]
    return replace(main, others=tuple(replace(p, findings=()) for p in parts if p is not main),
                   findings=tuple(findings))


def _excitation(experiment: Experiment) -> float:
    """Sum of the squares of the motor torque about its mean: the information about the drive grows with it."""
    values = experiment.signals.get("motor_torque", next(iter(experiment.signals.values())))
    seen = values[_in_segments(experiment.segments, experiment.size)]
    return float(np.nansum((seen - np.nanmean(seen)) ** 2))


def _experiment_on_grid(blank: Experiment, clean: CleanSignals, cut_record: CutSignals, log: str,
                        rate: Rate | None = None) -> Experiment:
    """The experiment on one grid, with its findings.

    blank  what does not depend on the grid
    log    what messages call it; rate: of which the signals are a part; None: all
    """
    gridded = onto_grid(clean, log)
    offset = gridded.start - cut_record.start if cut_record.findings or rate else 0.0
    findings = [*unmeasured_findings(clean.signals), *clean.findings, *gridded.findings]
    segments, signals = restart_after_cuts(gridded.segments, gridded.signals, cut_record.parts, offset,
                                           gridded.step)
    segments, more = _cut_at_missing_torque(segments, signals, log)
    inside = _in_segments(segments, len(next(iter(signals.values()))))
    findings += [*more, *_sparse_sensor_findings(signals, inside),
                 *_constant_signal_findings(signals, inside, log, f" in {log}" if rate else "")]
    findings += quantised_speed_findings(signals, segments, gridded.step)
    for body in dict.fromkeys(role.rpartition("_")[0] for role in signals):
        angle, speed = f"{body}_angle", f"{body}_speed"
        if angle in signals and speed in signals:
            offset_reported = any(f.code == "clock-offset" and {angle, speed} <= set(f.evidence.values())
                                  for f in findings)
            compared = compare_speed_and_angle(signals[angle], signals[speed], gridded.step, segments, body)
            findings += [f for f in compared
                         if not (offset_reported and f.code in ("speed-delay", "speed-filtered"))]
    return replace(
        blank, step=gridded.step, start=round(blank.start + gridded.start, 9),
        signals={role: read_only(values) for role, values in signals.items()}, segments=segments,
        findings=(*blank.findings, *findings), offset=round(offset, 9))


def _cut_at_missing_torque(segments: Iterable[tuple[int, int]], signals: Mapping[str, np.ndarray],
                           log: str) -> tuple[tuple[tuple[int, int], ...], list[Finding]]:
    """Segments without a missing torque; too short pieces are dropped."""
    usable = np.ones(len(next(iter(signals.values()))), dtype=bool)
    for role in INPUTS:
        if role in signals:
            usable &= np.isfinite(signals[role])
    pieces, missing = [], 0
    for first, last in segments:
        pieces += [(first + int(a), first + int(b)) for a, b in true_runs(usable[first:last])]
        missing += int(np.sum(~usable[first:last]))
    long_enough = tuple(p for p in pieces if p[1] - p[0] >= MIN_SEGMENT)
    total = sum(b - a for a, b in long_enough)
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
        there = _in_segments(segments, len(usable))
        known = np.flatnonzero(there & usable)
        between = int(there[known[0]:known[-1] + 1].sum()) > len(known)
        findings.append(Finding(
            "warning" if between else "note", "torque-missing", f"The torque has no value at {missing} samples of "
            f"{log}; {f'the record is cut there into {len(pieces)} segments' if between else 'they are left out'}.",
            {"samples": missing, "segments": len(pieces)},
            "Check the recorder; the model cannot run without the torque."))
    if len(long_enough) < len(pieces):
        short = sum(b - a for a, b in pieces) - total
        findings.append(Finding(
            "warning" if short > total else "note", "recording-interrupted",
            f"{len(pieces) - len(long_enough)} segments between interruptions of {log} are shorter than "
            f"{MIN_SEGMENT} samples and are left out, {short} of {short + total} samples.",
            {"segments": len(pieces) - len(long_enough), "samples": short, "of": short + total}))
    return long_enough, findings


def _in_segments(segments: Iterable[tuple[int, int]], size: int) -> np.ndarray:
    """(n,) whether a grid point lies in a segment."""
    inside = np.zeros(size, dtype=bool)
    for first, last in segments:
        inside[first:last] = True
    return inside


def _sparse_sensor_findings(signals: Mapping[str, np.ndarray], inside: np.ndarray) -> list[Finding]:
    """Sensors with a value at fewer than half of the grid points."""
    findings = []
    for role, values in signals.items():
        share = float(np.mean(np.isfinite(values[inside])))
        if role not in INPUTS and share < 0.5:
            findings.append(Finding(
                "note", "resampled",
                f"{role} has a lower rate than the grid of the record, or lacks samples: it has a value at only "
                f"{100 * share:.2g} % of the grid points.",
                {"role": role, "share": share}))
    return findings


def _constant_signal_findings(signals: Mapping[str, np.ndarray], inside: np.ndarray, log: str,
                              where: str) -> list[Finding]:
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
        raise BadRecording(f"motor_torque, a speed or an angle in {log}", f"only {', '.join(signals)}",
                           "Name the channel of one of these roles in the channel map.")
    if drives | motions <= constant:
        names = ", ".join(sorted(drives | motions))
        raise NotEnoughData(f"a torque or a motion that changes in {log}", f"only constant signals ({names})",
                            "Check the channels; if they are right, record while the drive is excited.")
    return [Finding("warning", "constant-signal", f"{role} never changes{where}: {value:g} throughout.",
                    {"role": role, "value": value}, "Check that it is the right channel.")
            for role, value in still if quantity(role) not in ("voltage", "frequency")]
