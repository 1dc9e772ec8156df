"""The on-disk shape of a gains file; its JSON Schema is made from these types."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from drivetool.files.shapes.parameter_shapes import DriveSection, FileSection, FindingSection, Plain, Tool
from drivetool.results import Number, Shape
from drivetool.tune.optimisation import CriterionSection, SpreadSection, VariationSection
from drivetool.tune.simulation import HuntingSection
from drivetool.tune.speed_loop import MarginsSection

GAINS_SCHEMA = "drivetool/gains/1"
PerUnit = Annotated[Number, Meta(description="of the ratings; null where the file has none")]


class Figure(Shape):
    """A number in SI and, where the drive is rated, per unit."""

    value: Number
    unit: str
    per_unit: PerUnit = None
    per_unit_unit: Annotated[str, Meta(description="for example % s, for a step of the rated torque")] = ""


class ConstraintSection(Shape):
    """What had to hold."""

    max_sensitivity: float
    max_gain: Annotated[Number, Meta(description="null: no limit")] = None
    confidence: Annotated[
        Number, Meta(description="share of the draws in which Ms must hold; null: nominal drive")] = None


class GainsSection(Shape):
    """What to type in: Kp (1 + 1/(s Ti)) on the speed error of the first motor."""

    kp: Figure
    ti: Figure
    kp2: Annotated[Figure | None, Meta(description="of the second controller of a miso tandem")] = None
    ti2: Figure | None = None
    k3: Annotated[
        Figure | None, Meta(description="share of the last shaft's torque for motor 2 of a mimo tandem")] = None


class SpeedSection(Shape):
    """A speed after a step of load torque."""

    peak: Figure
    impact_drop: Figure
    overshoot_percent: float
    settling_time: Figure
    ie: Figure
    ise: Figure
    iae: Figure


class FactorsSection(Shape):
    """Performance factors of both speeds, and by how much each motor's torque overshoots."""

    load_speed: SpeedSection
    motor_speed: SpeedSection
    torque_overshoot_percent: dict[str, float]


class DesignSection(Shape):
    """One controller and what it does."""

    configuration: Literal["siso", "miso", "mimo"]
    motors: list[str]
    speed_filter: Figure
    dead_time_form: Literal["exact", "zero"]
    gains: GainsSection
    criterion_value: Figure
    active: Annotated[
        Literal["sensitivity", "gain", "confidence", "nothing"],
        Meta(description="what the optimum rests on; nothing: it lies inside the limits")]
    factors: FactorsSection
    margins: MarginsSection
    variations: list[VariationSection]
    hunting: Annotated[list[HuntingSection], Meta(description="empty for a linear drive")]
    spread: SpreadSection | None = None
    kept: Annotated[Number, Meta(description="share of fresh draws in which the limit holds")] = None
    gain_without_cycle: Annotated[
        Number, Meta(description="largest Kp that is stable whatever stiffness the gap pretends to")] = None


class GainsFile(Shape):
    """What tune writes."""

    schema: Literal["drivetool/gains/1"]
    tool: Tool
    step: Literal["tune"]
    outcome: str
    drive: DriveSection
    criterion: CriterionSection
    constraint: ConstraintSection
    best: Annotated[str, Meta(description="configuration with the least criterion")]
    designs: list[DesignSection]
    findings: list[FindingSection]
    inputs: list[FileSection]
    options: Plain
    ratings: dict[str, Figure] | None = None
