"""What a comparison of records, machines or sides of a drive states; light, for files load it."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from drivetool.results import Number, Shape


class FigureSection(Shape):
    """A figure of models of one structure."""

    structure: str
    name: str
    unit: str


class DifferenceSection(FigureSection):
    """A figure in two records, or of two machines."""

    first: str
    second: str
    change: Annotated[Number, Meta(description="second less first")]
    std: Annotated[Number, Meta(
        description="by the noise within both records, or by what varies within both machines")]
    p: Annotated[Number, Meta(description="adjusted for all figures and pairs of the structure (Holm)")]
    differs: bool


class SpreadSection(FigureSection):
    """A figure over several experiments."""

    values: Annotated[list[Number], Meta(description="one per record, in the order of data")]
    stds: Annotated[list[Number], Meta(description="stated by each fit")]
    mean: Number
    std: Annotated[Number, Meta(description="over the experiments; null for one")]
    standard_error: Number


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
