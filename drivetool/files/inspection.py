"""What `inspect` found, as a file, a table and a picture."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import UNSET, Meta, UnsetType
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.errors import Finding
from drivetool.files.result_file import file_sections
from drivetool.files.shapes import FileSection, FindingSection, Number, Shape
from drivetool.files.text import plain
from drivetool.identify.estimate import Exhibit
from drivetool.logs.clocks.clean_clock import FAR
from drivetool.logs.experiment import Source, began
from drivetool.logs.inspect import ChannelReport, Inspection

INSPECTION_SCHEMA = "drivetool/inspection/1"
# More panels than this are no picture.
PANELS = 12


class ChannelSection(Shape):
    """One channel of a log."""

    name: str
    unit: str | None
    role: Annotated[str | None, Meta(description="what a step would take it for")]
    samples: int
    missing: Annotated[int, Meta(description="samples without a finite value")]
    start: Annotated[float, Meta(description="s from the origin of the log")]
    duration: Annotated[float, Meta(description="s")]
    rate: Annotated[Number, Meta(description="Hz")]
    jitter: Annotated[float, Meta(description="largest distance from a uniform grid, in steps")]
    range: Annotated[tuple[Number, Number], Meta(description="least and greatest value, in unit")]
    gaps: Annotated[int, Meta(description="interruptions of more than a few samples")]
    longest_gap: Annotated[float, Meta(description="s")]
    lost: Annotated[int, Meta(description="single samples that are missing")]
    quantum: Annotated[float, Meta(description="quantisation step in unit; 0: none")]
    spikes: Annotated[int, Meta(description="samples that stand out of the running median")]
    held: Annotated[int, Meta(description="how often every value is repeated")]
    clock: Annotated[str, Meta(description="what is wrong with its time stamps")]


class PartSection(Shape):
    """What a step would get at one of several rates."""

    step: Annotated[float, Meta(description="s")]
    samples: int
    segments: int


class ExperimentSection(Shape):
    """What a step would get."""

    step: Annotated[float, Meta(description="s")]
    samples: int
    segments: int
    torque_unit: str
    motion_unit: str
    torque_is: str
    roles: list[str]
    others: Annotated[list[PartSection], Meta(description="what is at other rates, on grids of their own")]
    input_units: Annotated[dict[str, str] | UnsetType, Meta(
        description="roles whose torque is logged in A, V or % beside others in torque_unit")] = UNSET


class InspectionFile(Shape):
    """What inspect writes."""

    schema: Literal["drivetool/inspection/1"]
    origin: Annotated[float, Meta(description="s on the log's clock that times count from")]
    channels: list[ChannelSection]
    unreadable: Annotated[dict[str, str], Meta(description="topics or columns that are not read, and why")]
    experiment: ExperimentSection | None
    findings: list[FindingSection]
    data: list[FileSection]


def inspection_file(found: Inspection, findings: list[FindingSection]) -> InspectionFile:
    """The file of an inspection."""
    experiment = found.experiment
    section = None
    if experiment is not None:
        # The grid of a rate goes on over the others.
        samples = experiment.used if experiment.others else experiment.size
        section = ExperimentSection(
            step=experiment.step, samples=samples, segments=len(experiment.segments),
            torque_unit=experiment.torque_unit, motion_unit=experiment.motion_unit,
            torque_is=experiment.torque_is, roles=list(experiment.signals),
            others=[PartSection(step=o.step, samples=o.used, segments=len(o.segments)) for o in experiment.others],
            input_units=dict(experiment.input_units) or UNSET)
    recording = found.recording
    return InspectionFile(
        schema=INSPECTION_SCHEMA, origin=recording.origin, channels=[_section(each) for each in found.channels],
        unreadable=dict(recording.unreadable), experiment=section, findings=findings,
        data=file_sections([experiment.source if experiment else
                            Source(recording.name, recording.sha256, began(recording.origin))]))


def _section(report: ChannelReport) -> ChannelSection:
    longest = max((after - before for before, after in report.gaps), default=0.0)
    return ChannelSection(
        name=report.name, unit=report.unit, role=report.role, samples=report.samples, missing=report.missing,
        start=report.start, duration=report.duration, rate=report.rate, jitter=report.jitter,
        range=(report.least, report.most), gaps=len(report.gaps), longest_gap=longest, lost=report.lost,
        quantum=report.quantum, spikes=len(report.spikes), held=report.held, clock=report.clock)


def print_inspection(file: InspectionFile, console: Console) -> None:
    """One row per channel below its topic, then what a step would get."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False)
    table.add_column("channel", overflow="fold", min_width=12)
    table.add_column("role", overflow="fold", max_width=12)  # of motor_torque
    table.add_column("unit", overflow="fold")
    for title in ("Hz", "samples", "range", "step", "gaps", "spikes", "lost"):
        table.add_column(title, justify="right", no_wrap=True)
    topic = ""
    for each in file.channels:
        own, dot, field = each.name.partition(".") if each.name.startswith("/") else ("", "", each.name)
        if dot and own != topic:
            table.add_row(Text(own))
        topic = own
        cells = (f"  {field}" if dot else field, each.role or "-", each.unit or "?", _short(each.rate),
                 str(each.samples), f"{_short(each.range[0], 3)}..{_short(each.range[1], 3)}",
                 _short(each.quantum or None, 2), str(each.gaps), str(each.spikes), str(each.missing + each.lost))
        table.add_row(*map(Text, cells), style="" if each.role else "dim")
    console.print(table)
    for name, why in file.unreadable.items():
        console.print(Text(f"  {name}: not read, {why}", style="yellow"))
    if file.experiment:
        e = file.experiment
        more = "".join(f"; {role} in {unit}" for role, unit in (e.input_units or {}).items())
        parts: list[ExperimentSection | PartSection] = [e, *e.others]
        counts = " and ".join(f"{p.samples} samples of {p.step:.6g} s in {p.segments} "
                              f"segment{'s' if p.segments > 1 else ''}" for p in parts)
        console.print(Text(f"  a step would get {', '.join(e.roles)}: {counts}, torque in {e.torque_unit} "
                           f"({e.torque_is}{more}), motion in {e.motion_unit}"))
    else:
        console.print(Text("  no step could use it as it is", style="yellow"))


def _short(value: float | None, digits: int = 4) -> str:
    """A number in a few digits, its exponent without what only costs width."""
    text = "-" if value is None else f"{value:.{digits}g}"
    return text.replace("e+0", "e").replace("e+", "e").replace("e-0", "e-")


def exhibit(found: Inspection) -> Exhibit:
    """The channels over time with gaps and spikes; those with a role first, then as many as fit."""
    ordered = sorted(found.channels, key=lambda report: report.role is None)
    shown = [report for report in ordered if report.least is not None][:PANELS]
    curves: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for report in shown:
        channel = found.recording.channels[report.name]
        order = np.argsort(channel.time, kind="stable")
        order = order[np.abs(channel.time[order]) < FAR]
        time, values = channel.time[order], channel.values[order]
        label = f"{report.role or report.name} [{report.unit or '?'}]"
        while label in curves:
            label += " "
        curves[label] = time, values
        if len(report.spikes):
            curves[f"spikes {label}"] = channel.time[report.spikes], channel.values[report.spikes]
        if report.gaps:
            curves[f"gaps {label}"] = tuple(np.array(report.gaps).T)
    left = len(found.channels) - len(shown)
    title = f"{found.recording.name}: {len(found.channels)} channels" + (f", {left} not shown" if left else "")
    return Exhibit("channels", title, "time from the origin of the log [s]", "", curves)


def finding_sections(findings: tuple[Finding, ...]) -> list[FindingSection]:
    """Findings as they are written."""
    return [FindingSection(severity=f.severity, code=f.code, text=f.text, evidence=plain(f.evidence),
                           action=f.action) for f in findings]
