"""The on-disk shape of an inspection; its JSON Schema is made from these types."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, Meta, UnsetType

from drivetool.files.shapes.parameter_shapes import FileSection, FindingSection
from drivetool.logs.door import ChannelSection
from drivetool.results import Shape

INSPECTION_SCHEMA = "drivetool/inspection/1"


class PartSection(Shape):
    """What a step would get at one of several rates."""

    step: Annotated[float, Meta(description="s")]
    samples: int
    segments: int


class ExperimentSection(PartSection):
    """What a step would get."""

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
