"""The contents of a log, channel by channel, and the experiment that a step would get."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivetool.errors import BadRecording, DriveToolError
from drivetool.finding import Finding
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
    experiment  what a step would get, or None where none can use the log: a finding says why
    findings    of the reader, and of the experiment if there is one
    """

    recording: Recording
    channels: tuple[ChannelReport, ...]
    experiment: Experiment | None
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
    clocks: dict[int, tuple[np.ndarray, dict[str, Any]]] = {}
    reports = []
    for name, channel in recording.channels.items():
        if id(channel.time) not in clocks:
            clocks[id(channel.time)] = _inspect_clock(channel.time, name, recording.name)
        role, unit = roles.get(name, (None, None))
        reports.append(_channel_report(name, channel, role, unit or channel.unit, *clocks[id(channel.time)]))
    experiment = None
    try:
        steps = [parse_step(text) for text in channel_map.condition] if channel_map else []
        experiment = build_experiment(recording, channel_map, steps)
        findings = [*experiment.findings, *findings]
    except DriveToolError as problem:
        findings = [*recording.findings, *findings, Finding(
            "warning", "recording-not-usable", f"No step can use {recording.name}: {problem}")]
    findings += [Finding("warning", "log-damaged", f"{name} of {recording.name} cannot be read: {why}.")
                 for name, why in recording.unreadable.items()]
    each_sentence_once = {(f.code, f.text): f for f in findings}
    return Inspection(recording, tuple(reports), experiment, tuple(each_sentence_once.values()))


def _roles_of_channels(recording: Recording, channel_map: ChannelMap | None,
                      ) -> tuple[dict[str, tuple[str, str | None]], list[Finding]]:
    """(channel -> role and the unit that the map gives; roles of the map without a channel)."""
    entries = channel_map.roles if channel_map else {role: RoleEntry(role) for role in ROLES}
    roles, findings = {}, []
    for role, entry in entries.items():
        try:
            name = resolve_channel(entry.channel, recording.channels)
        except BadRecording as problem:
            findings.append(Finding("warning", "channel-map-mismatch", f"{role}: {problem}"))
            continue
        if name is not None:
            roles[name] = role, entry.unit
        elif channel_map:
            findings.append(Finding(
                "warning", "channel-map-mismatch", f"There is no channel '{entry.channel}' for {role} "
                f"in {recording.name}.", {"role": role}, "Correct the channel map."))
    return roles, findings


def _inspect_clock(time: np.ndarray, name: str, log: str) -> tuple[np.ndarray, dict[str, Any]]:
    """(samples that it keeps; what a ChannelReport says of it), also of a clock that a step would refuse."""
    known = np.flatnonzero(np.abs(time) < MAX_ABS_TIME)
    try:
        stamps, kept, findings = clean_clock(time, name, log)
        description = " ".join(f.text for f in findings)
        keep = known if kept is None else kept
    except BadRecording as problem:
        description = f"wanted {problem.wanted}; found {problem.found}."
        keep = known[np.argsort(time[known], kind="stable")]
        stamps = np.unique(time[known])
    if len(stamps) < 2:
        return keep, {"rate": None, "jitter": 0.0, "gaps": 0, "gap_times": (), "longest_gap": 0.0, "lost": 0,
                      "clock": description}
    found = find_rates(stamps)
    if found:
        description = f"{description} It changes its rate: {', '.join(rate.text for rate in found)}.".lstrip()
    parts = [stamps[(stamps >= a) & (stamps < b)] for rate in found for a, b in rate.windows] or [stamps]
    grids = [(part, fit_grid(part)) for part in parts if len(part) > 1]
    gaps = tuple(sorted((float(part[i]), float(part[i + 1])) for part, grid in grids for i in grid.gaps))
    return keep, {"rate": 1 / median_step(stamps),
                  "jitter": max(grid.jitter for _, grid in grids), "gaps": len(gaps),
                  "gap_times": gaps, "longest_gap": max((after - before for before, after in gaps), default=0.0),
                  "lost": sum(grid.lost for _, grid in grids), "clock": description}


def _channel_report(name: str, channel: Channel, role: str | None, unit: str | None, keep: np.ndarray,
                    clock: dict[str, Any]) -> ChannelReport:
    """The numbers of one channel; clock: what _inspect_clock found."""
    values, time = channel.values[keep], channel.time[keep]
    finite = values[np.isfinite(values)]
    spike_places = keep[remove_spikes(values)[1]]
    return ChannelReport(
        name, unit, role, len(values), len(values) - len(finite),
        float(time[0]) if len(time) else 0.0, float(time[-1] - time[0]) if len(time) else 0.0,
        range=(float(finite.min()), float(finite.max())) if len(finite) else (None, None),
        quantum=quantisation_step(values), spikes=len(spike_places), held=hold_count(values),
        spike_places=spike_places, **clock)
