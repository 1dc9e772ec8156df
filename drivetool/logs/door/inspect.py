"""The contents of a log, channel by channel, and the experiment that a step would get."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivetool.errors import BadRecording, DriveToolError, Finding
from drivetool.logs import ROLES, Channel, Experiment, Recording, fit_grid, median_step
from drivetool.logs.channels import ChannelMap, RoleEntry, resolve_channel
from drivetool.logs.clocks import MAX_ABS_TIME, clean_clock, find_rates
from drivetool.logs.conditioning import parse_step
from drivetool.logs.door.build import build_experiment
from drivetool.logs.door.sections import ChannelSection
from drivetool.logs.formats import read_recording
from drivetool.logs.samples import hold_count, quantisation_step, remove_spikes


class ChannelReport(ChannelSection):
    """One channel as it was logged.

    gap_times     [s] last stamp before and first after each interruption
    spike_places  indices of samples that are outliers from the running median
    """

    gap_times: tuple[tuple[float, float], ...]
    spike_places: np.ndarray


@dataclass(frozen=True)
class Inspection:
    """What was found in a log.

    recording   all its numeric channels; channels: a report on each
    experiment  what a step would get, or None with the sentence `refused`
    findings    of the reader, and of the experiment if there is one
    """

    recording: Recording
    channels: tuple[ChannelReport, ...]
    experiment: Experiment | None
    refused: str
    findings: tuple[Finding, ...]


def inspect_log(path: str | Path, channel_map: ChannelMap | None = None) -> Inspection:
    """Everything that can be said about a log without a model.

    path         .parquet or .mcap, or a folder of the parts of a .parquet
    channel_map  for roles, units and the clock; None takes channels named like the roles
    returns      Inspection; what is wrong with channels, roles or units is in its findings
    raises       BadRecording: nothing in the file can be read
    """
    recording = read_recording(path, channel_map, choose=list)
    roles, findings = _roles_of_channels(recording, channel_map)
    clocks: dict[int, _Clock] = {}
    reports = []
    for name, channel in recording.channels.items():
        clock = clocks.get(id(channel.time))
        if clock is None:
            clock = clocks[id(channel.time)] = _inspect_clock(channel.time, name, recording.name)
        role = roles.get(name)
        reports.append(_channel_report(name, channel, role, clock, _channel_unit(channel, role, channel_map)))
    experiment, refused = None, ""
    try:
        steps = [parse_step(text) for text in channel_map.condition] if channel_map else []
        experiment = build_experiment(recording, channel_map, steps)
        findings = [*experiment.findings, *findings]
    except DriveToolError as problem:
        refused = str(problem)
        findings = [*recording.findings, *findings, Finding(
            "warning", "recording-not-usable", f"No step can use {recording.name}: {refused}")]
    findings += [Finding("warning", "log-damaged", f"{name} of {recording.name} cannot be read: {why}.")
                 for name, why in recording.unreadable.items()]
    return Inspection(recording, tuple(reports), experiment, refused, _unique_findings(findings))


def _unique_findings(findings: list[Finding]) -> tuple[Finding, ...]:
    """Each sentence once."""
    return tuple({(f.code, f.text): f for f in findings}.values())


def _roles_of_channels(recording: Recording,
                       channel_map: ChannelMap | None) -> tuple[dict[str, str], list[Finding]]:
    """(channel -> role, roles of the map without a channel)."""
    entries = channel_map.roles if channel_map else {role: RoleEntry(role) for role in ROLES}
    roles, findings = {}, []
    for role, entry in entries.items():
        try:
            name = resolve_channel(entry.channel, recording.channels)
        except BadRecording as problem:
            findings.append(Finding("warning", "channel-map-mismatch", f"{role}: {problem}"))
            continue
        if name is not None:
            roles[name] = role
        elif channel_map:
            findings.append(Finding(
                "warning", "channel-map-mismatch", f"There is no channel '{entry.channel}' for {role} "
                f"in {recording.name}.", {"role": role}, "Correct the channel map."))
    return roles, findings


def _channel_unit(channel: Channel, role: str | None, channel_map: ChannelMap | None) -> str | None:
    """The unit that the map gives, or the log."""
    entry = channel_map.roles.get(role) if channel_map and role else None
    return (entry.unit if entry else None) or channel.unit


@dataclass(frozen=True)
class _Clock:
    """The properties of one clock; see ChannelReport."""

    keep: np.ndarray
    rate: float | None
    jitter: float
    gaps: tuple[tuple[float, float], ...]
    lost: int
    description: str


def _inspect_clock(time: np.ndarray, name: str, log: str) -> _Clock:
    """Rate, gaps and jitter; also of a clock that a step would refuse."""
    known = np.flatnonzero(np.abs(time) < MAX_ABS_TIME)
    try:
        clock, findings = clean_clock(time, name, log)
        description = " ".join(f.text for f in findings)
        keep = known if clock.keep is None else clock.keep
        stamps = clock.time
    except BadRecording as problem:
        description = f"wanted {problem.wanted}; found {problem.found}."
        keep = known[np.argsort(time[known], kind="stable")]
        stamps = np.unique(time[known])
    if len(stamps) < 2:
        return _Clock(keep, None, 0.0, (), 0, description)
    found = find_rates(stamps)
    if found:
        description = f"{description} It changes its rate: {', '.join(rate.text for rate in found)}.".lstrip()
    parts = [stamps[(stamps >= a) & (stamps < b)] for rate in found for a, b in rate.windows] or [stamps]
    grids = [(part, fit_grid(part)) for part in parts if len(part) > 1]
    gaps = tuple(sorted((float(part[i]), float(part[i + 1])) for part, grid in grids for i in grid.gaps))
    return _Clock(keep, 1 / median_step(stamps), max(grid.jitter for _, grid in grids), gaps,
                  sum(grid.lost for _, grid in grids), description)


def _channel_report(name: str, channel: Channel, role: str | None, clock: _Clock,
                    unit: str | None) -> ChannelReport:
    """The numbers of one channel."""
    values, time = channel.values[clock.keep], channel.time[clock.keep]
    finite = values[np.isfinite(values)]
    spike_places = clock.keep[remove_spikes(values)[1]]
    return ChannelReport(
        name, unit, role, len(values), len(values) - len(finite),
        float(time[0]) if len(time) else 0.0, float(time[-1] - time[0]) if len(time) else 0.0,
        clock.rate, clock.jitter, (float(finite.min()), float(finite.max())) if len(finite) else (None, None),
        len(clock.gaps), max((after - before for before, after in clock.gaps), default=0.0), clock.lost,
        quantisation_step(values), len(spike_places), hold_count(values), clock.description, clock.gaps,
        spike_places)
