"""The on-disk shape of spectra and comparison files; the JSON Schemas are made from these types."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, Meta, UnsetType

from drivetool.files.shapes.parameter_shapes import FileSection, FindingSection, Number, Plain, Shape, Tool

SPECTRA_SCHEMA = "drivetool/spectra/1"
COMPARISON_SCHEMA = "drivetool/comparison/1"


class PeakSection(Shape):
    """A resonance or anti-resonance that stands out of a measured response."""

    kind: Literal["resonance", "anti-resonance"]
    hz: Annotated[float, Meta(description="of the spectral line")]
    magnitude: float
    resolution_hz: Annotated[float, Meta(description="distance of the lines")]
    prominence_db: float


class DistortionSection(Shape):
    """Output on lines without excitation, as rms over the lines of a kind."""

    kind: Literal["even", "odd"]
    lines: int
    level: float
    noise: float
    signal: float
    below_signal_db: Annotated[Number, Meta(description="null where it does not stand out of the noise")]


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


class SpreadSection(Shape):
    """A figure over several experiments."""

    structure: str
    name: str
    unit: str
    values: Annotated[list[Number], Meta(description="one per record, in the order of data")]
    stds: Annotated[list[Number], Meta(description="stated by each fit")]
    mean: Number
    std: Annotated[Number, Meta(description="over the experiments; null for one")]
    standard_error: Number


class DifferenceSection(Shape):
    """A figure in two records, or of two machines."""

    structure: str
    name: str
    unit: str
    first: str
    second: str
    change: Annotated[Number, Meta(description="second less first")]
    std: Annotated[Number, Meta(
        description="by the noise within both records, or by what varies within both machines")]
    p: Annotated[Number, Meta(description="adjusted for all figures and pairs of the structure (Holm)")]
    differs: bool


class SwapLineSection(Shape):
    """A parameter, or a figure that follows from them, in the files of both sides."""

    first: Annotated[str, Meta(description="its name in the first file; empty where that has none")]
    second: Annotated[str, Meta(description="its name in the second file, likewise")]
    unit: str
    factor: Annotated[float, Meta(
        description="by which the second value was multiplied, to refer it across a gear to the first side")]
    values: Annotated[tuple[Number, Number], Meta(description="first and second")]
    stds: Annotated[tuple[Number, Number], Meta(description="standard deviation of each")]
    difference: Annotated[Number, Meta(description="second less first")]
    std: Annotated[Number, Meta(
        description="standard deviation of the difference, of independent recordings")]
    ratio: Annotated[Number, Meta(description="difference over std")]
    differs: Annotated[bool, Meta(description="whether the ratio is beyond 3")]
    reason: Annotated[str, Meta(description="why there is no difference or no ratio")]


class SwapSection(Shape):
    """One drive identified from both of its motors, the bodies of the second file exchanged."""

    first: Annotated[str, Meta(description="name of the first file")]
    second: Annotated[str, Meta(description="name of the second file")]
    lines: list[SwapLineSection]
    derived: Annotated[list[SwapLineSection], Meta(description="figures that follow from the parameters")]
    chi_square: Annotated[Number, Meta(
        description="of all parameters with a ratio, by both covariances; null where there is none")]
    degrees: Annotated[int, Meta(description="of freedom")]
    p: Annotated[Number, Meta(description="chance of a larger chi-square where both sides are one drive")]
    agree: Annotated[bool | None, Meta(description="null where nothing can be compared")]


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
