"""The on-disk shape of parameter and validation files; the JSON Schemas are made from these types."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, UnsetType

from drivetool.check.outcome import DiagnosisSection
from drivetool.check.validation import CheckSection
from drivetool.finding import FindingSection
from drivetool.identify.estimate import DerivedSection, LawSection, ParameterSection, StartsSection
from drivetool.results import Number as Number, Shape

PARAMETERS_SCHEMA = "drivetool/parameters/1"
VALIDATION_SCHEMA = "drivetool/validation/1"
# Of a std beside findings that something is missing from the structure.
IF_COMPLETE = "the +- assumes a complete model of the drive, which a finding questions"

Plain = dict[str, Any]


class Tool(Shape):
    """The program that wrote the file."""

    name: str
    version: str


class DriveSection(Shape):
    """The chain of bodies: a known name, or the bodies and shafts by name."""

    name: Annotated[
        str | None, Meta(description="one-body, two-mass, three-mass, vehicle or a name of your own")] = None
    bodies: Annotated[list[str] | None, Meta(description="from the motor outwards")] = None
    shafts: Annotated[list[str] | None, Meta(description="joining neighbours, one fewer than bodies")] = None
    torque_unit: Annotated[
        Literal["Nm", "N", "A", "V", "%"] | None, Meta(description="unit of the torques")] = None
    motion_unit: Annotated[Literal["rad", "m"] | None, Meta(description="unit of the motion")] = None
    damping_law: Annotated[
        Literal["inside", "always", "contact"] | None,
        Meta(description="shaft damping inside the contact only, or always; contact: only there too, and the shaft "
                         "relaxes in the gap")] = None
    input_unit: Annotated[Literal["A", "V", "%"] | UnsetType | None, Meta(
        description="unit of the motors' inputs, of which torque constants make torques")] = UNSET


class CovarianceSection(Shape):
    """Covariance of the fitted parameters, in their units."""

    names: list[str]
    matrix: list[list[float]]


class FileSection(Shape):
    """A file that was read, and its SHA-256."""

    file: str
    sha256: str
    began: Annotated[
        str | UnsetType, Meta(description="when the recording began by its own clock (UTC)")] = UNSET


class MeasureSection(Shape):
    """A number with its unit."""

    value: float
    unit: str


class RatingsSection(Shape):
    """What 100 % stands for; the base of per-unit figures."""

    torque: MeasureSection
    speed: Annotated[MeasureSection, Meta(description="of the first motor")]


class ControllerSection(Shape):
    """What is known of the controller that the drive will get."""

    speed_filter: Annotated[
        MeasureSection | None, Meta(description="time constant of the speed measurement's filter")] = None


class ParameterFile(Shape):
    """What every step writes and the next one reads; a person may edit or write it."""

    schema: Literal["drivetool/parameters/1"]
    tool: Tool | None = None
    step: Annotated[str, Meta(description="the step that wrote the file")] = ""
    outcome: Annotated[str, Meta(description="how the fit ended, in one sentence")] = ""
    drive: DriveSection | None = None
    parameters: Annotated[
        dict[str, ParameterSection | float],
        Meta(description="by name; a bare number is in the drive's own unit")] = {}
    derived: Annotated[dict[str, DerivedSection], Meta(
        description="what follows from the parameters: resonances and their damping ratios by all friction, the "
                    "total inertia, forces at a radius; of a coast-down, friction over inertia",
        )] | UnsetType = UNSET
    explanation: Annotated[str, Meta(
        description="which explanation of the record was chosen, and why")] | UnsetType = UNSET
    laws: Annotated[list[LawSection], Meta(
        description="torques that the motion foretells; no part of the drive")] | UnsetType = UNSET
    fit: dict[str, float | int | str | None] = {}
    starts: StartsSection | None = None
    findings: list[FindingSection] = []
    covariance: CovarianceSection | None = None
    diagnosis: DiagnosisSection | None = None
    ratings: RatingsSection | None = None
    controller: ControllerSection | None = None
    noise: dict[str, float | None] = {}
    details: Annotated[Plain, Meta(description="what else the step found")] = {}
    records: Annotated[list[FileSection], Meta(
        description="recordings with parameters of their own, NAME@FILE")] | UnsetType = UNSET
    data: Annotated[list[FileSection], Meta(description="recordings")] = []
    inputs: Annotated[list[FileSection], Meta(description="parameter files, in the order merged")] = []
    options: Plain = {}


class ValidationFile(Shape):
    """What validate writes."""

    schema: Literal["drivetool/validation/1"]
    tool: Tool
    step: Literal["validate"]
    verdict: str
    passed: bool
    checks: list[CheckSection]
    findings: list[FindingSection]
    data: list[FileSection]
    inputs: list[FileSection]
    options: Plain
