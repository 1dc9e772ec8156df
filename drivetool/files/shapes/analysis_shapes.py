"""The on-disk shape of spectra and comparison files; the JSON Schemas are made from these types."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, Meta, UnsetType

from drivetool.files.shapes.parameter_shapes import FileSection, FindingSection, Plain, Tool
from drivetool.identify.frequency import DistortionSection, PeakSection
from drivetool.identify.several import DifferenceSection, SpreadSection, SwapSection
from drivetool.results import Number, Shape

SPECTRA_SCHEMA = "drivetool/spectra/1"
COMPARISON_SCHEMA = "drivetool/comparison/1"


class SpectraFile(Shape):
    """What spectra writes; the curves are in the Parquet file beside it."""

    schema: Literal["drivetool/spectra/1"]
    tool: Tool
    step: Literal["spectra"]
    outcome: str
    input: str
    output: str
    unit: Annotated[str, Meta(description="of the magnitude")]
    settings: Plain
    lines: int
    first_hz: float
    last_hz: float
    coherence: Annotated[dict[str, float | None], Meta(description="median, least, share of lines below 0.5")]
    uncertainty: Annotated[dict[str, float | None], Meta(
        description="medians over the lines of std over magnitude: by noise, with distortion, over the runs")]
    peaks: list[PeakSection]
    distortion: list[DistortionSection]
    feedback: Annotated[dict[str, float | None], Meta(
        description="share of the unforetold torque that comes from the sensor, and its p-value")]
    curves: Annotated[str | None, Meta(
        description="Parquet file with all lines, in the folder of this file unless --curves names another")]
    findings: list[FindingSection]
    data: list[FileSection]
    options: Plain


class CrossSection(Shape):
    """A model fitted on one record and checked on another."""

    structure: str
    fitted_on: str
    checked_on: str
    simulation_fit_percent: Annotated[Number, Meta(description="of a free run; null where it is unstable")]


class ComparisonFile(Shape):
    """What compare writes: every structure fitted on every record and checked on all, or two sides of a drive."""

    schema: Literal["drivetool/comparison/1"]
    tool: Tool
    step: Literal["compare"]
    outcome: str
    structures: list[Plain]
    cross: list[CrossSection]
    spread: list[SpreadSection]
    differences: list[DifferenceSection]
    findings: list[FindingSection]
    data: list[FileSection]
    inputs: list[FileSection]
    options: Plain
    swap: Annotated[SwapSection, Meta(description="of --swap alone")] | UnsetType = UNSET


ANALYSIS_FILES = {SPECTRA_SCHEMA: SpectraFile, COMPARISON_SCHEMA: ComparisonFile}
