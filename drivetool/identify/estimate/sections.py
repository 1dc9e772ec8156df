"""What an estimate states beside its parameters; light, for files load it."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, Meta, UnsetType

from drivetool.results import Number, Shape

Status = Literal["fitted", "held", "at-bound", "not-identifiable"]


class StartsSection(Shape):
    """How the starts of the fit agreed."""

    tried: Annotated[int, Meta(description="descents from different starts")]
    agreed: Annotated[int, Meta(description="those that ended as good as the best")]
    spread: Annotated[dict[str, float], Meta(
        description="largest difference between the values that these ended at")] = {}


class ParameterSection(Shape):
    """One parameter; only the value is needed in a file written by hand."""

    value: Annotated[Number, Meta(description="null where there is none; reason says why")]
    unit: Annotated[str | None, Meta(description="converted if it is not the drive's own")] = None
    std: Annotated[Annotated[float, Meta(ge=0)] | None, Meta(
        description="standard deviation; null where there is none")] = None
    ci95: Annotated[
        tuple[Number, Number] | None, Meta(description="95 % interval, lower and upper end")] = None
    start: Annotated[Number, Meta(description="value the fit started from")] = None
    status: Status = "held"
    reason: Annotated[str, Meta(description="why there is no std, when it holds, or why the value was held")] = ""
    std_noise: Annotated[float | UnsetType, Meta(description="part of the std by noise")] = UNSET
    std_structure: Annotated[float | UnsetType, Meta(
        description="part of the std by what explanations of the record disagree in: the model's error")] = UNSET
    std_between: Annotated[float | UnsetType, Meta(
        description="part of the std by what varies from recording to recording")] = UNSET
    repeatability: Annotated[float | UnsetType, Meta(
        description="how much that is: the standard deviation of single recordings")] = UNSET


class LawSection(Shape):
    """A torque that the motion foretells and the drive lacks."""

    name: str
    factors: Annotated[list[float], Meta(
        description="its size, root mean square in the unit of the torque, one per component")]
    ci95: Annotated[list[tuple[float, float]], Meta(description="95 % interval of each")]


class DerivedSection(Shape):
    """A figure that follows from the parameters."""

    value: float
    unit: str
    std: Annotated[Annotated[float, Meta(ge=0)] | None, Meta(
        description="by the covariance of the parameters; null where one that counts has no interval")] = None
    ci95: tuple[float, float] | None = None
    reason: Annotated[str, Meta(description="why there is no std")] = ""
