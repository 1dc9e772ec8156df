"""The result of `inspect`, as a file and a picture."""

from __future__ import annotations

import numpy as np
from msgspec import UNSET

from drivetool.files.results.result_file import file_sections
from drivetool.files.shapes import (
    INSPECTION_SCHEMA,
    ChannelSection,
    ExperimentSection,
    FindingSection,
    InspectionFile,
    PartSection,
)
from drivetool.identify.estimate import PlotData
from drivetool.logs import Source, start_date
from drivetool.logs.clocks import MAX_ABS_TIME
from drivetool.logs.door import Inspection

# A choice: at about one inch a panel, more of them are taller than a screen or a page.
MAX_PANELS = 12


def inspection_file(found: Inspection, findings: list[FindingSection]) -> InspectionFile:
    """The file of an inspection."""
    experiment = found.experiment
    section = None
    if experiment is not None:
        # The grid of one rate continues over the stretches of the others.
        samples = experiment.used if experiment.others else experiment.size
        section = ExperimentSection(
            step=experiment.step, samples=samples, segments=len(experiment.segments),
            torque_unit=experiment.torque_unit, motion_unit=experiment.motion_unit,
            torque_is=experiment.torque_is, roles=list(experiment.signals),
            others=[PartSection(step=o.step, samples=o.used, segments=len(o.segments)) for o in experiment.others],
            input_units=dict(experiment.input_units) or UNSET)
    recording = found.recording
    return InspectionFile(
        schema=INSPECTION_SCHEMA, origin=recording.origin,
        channels=[ChannelSection(*(getattr(each, name) for name in ChannelSection.__struct_fields__))
                  for each in found.channels],
        unreadable=dict(recording.unreadable), experiment=section, findings=findings,
        data=file_sections([experiment.source if experiment else
                            Source(recording.name, recording.sha256, start_date(recording.origin))]))


def channel_plot(found: Inspection) -> PlotData:
    """The channels over time with gaps and spikes; those with a role first, then as many as fit."""
    ordered = sorted(found.channels, key=lambda report: report.role is None)
    drawn = [report for report in ordered if report.range[0] is not None][:MAX_PANELS]
    curves: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for report in drawn:
        channel = found.recording.channels[report.name]
        order = np.argsort(channel.time, kind="stable")
        order = order[np.abs(channel.time[order]) < MAX_ABS_TIME]
        time, values = channel.time[order], channel.values[order]
        label = f"{report.role or report.name} [{report.unit or '?'}]"
        while label in curves:
            label += " "
        curves[label] = time, values
        if report.spikes:
            curves[f"spikes {label}"] = channel.time[report.spike_places], channel.values[report.spike_places]
        if report.gaps:
            curves[f"gaps {label}"] = tuple(np.array(report.gap_times).T)
    omitted = len(found.channels) - len(drawn)
    title = (f"{found.recording.name}: {len(found.channels)} channels"
             + (f", {omitted} not shown" if omitted else ""))
    return PlotData("channels", title, "time from the origin of the log [s]", "", curves)
