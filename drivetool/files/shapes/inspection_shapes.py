"""The on-disk shape of an inspection; its JSON Schema is made from these types."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, Meta, UnsetType

from drivetool.files.shapes.parameter_shapes import FileSection, FindingSection, Number, Shape

INSPECTION_SCHEMA = "drivetool/inspection/1"


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
