"""What a diagnosis states of its verdict, rounds, causes and gain; light, for files load it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta

from drivetool.identify.estimate import ParameterSection
from drivetool.results import Number, Shape

Verdict = Literal["nothing-found", "named", "undetermined", "unexplained"]
State = Literal["named", "possible", "worse", "no-gain", "not-shown", "in-the-model", "failed"]


class GainSection(Shape):
    """How much better free runs over data held out became, or the torque that a motion asks for."""

    unit: Annotated[str, Meta(description="of rmse, its std and the noise floor")]
    of: Annotated[Literal["motion", "torque"], Meta(
        description="motion: errors of free runs; torque: of what the motion asks for")] = "motion"
    segment: Annotated[Number, Meta(description="length of the free runs in s")] = None
    held_out_rmse_before: Annotated[Number, Meta(description="of the base, fitted to all that is no judge")] = None
    held_out_rmse_after: Annotated[
        Number, Meta(description="of the extended drive, fitted without what it is run over")] = None
    rmse_std: Annotated[Number, Meta(description="standard error of rmse before - after")] = None
    rmse_gain_ci95: Annotated[tuple[Number, Number] | None, Meta(
        description="95 % interval of rmse before - after on a further record of the same length")] = None
    held_out_fit_before: Annotated[Number, Meta(description="percent")] = None
    held_out_fit_after: Annotated[Number, Meta(description="percent")] = None
    noise_floor: Annotated[Number, Meta(description="std of the sensor alone")] = None
    unexplained_percent: Annotated[
        Number, Meta(description="share of what the base left unexplained that is still there")] = None


class SizeSection(Shape):
    """A number with its unit."""

    value: Number
    unit: str | None = None


class CandidateSection(Shape):
    """One cause that was tried in one round of a diagnosis."""

    code: Annotated[str, Meta(description="of the catalogue, see drivetool effects")]
    state: State
    round: Annotated[int, Meta(description="from one; each looks for one more cause")] = 1
    law: str = ""
    shown: Annotated[bool | None, Meta(description="whether this record can show it; null: not known")] = None
    gain: Annotated[Number, Meta(description="log likelihood gained on data held out")] = None
    gain_std: Annotated[Number, Meta(description="standard error of the gain")] = None
    evidence: Annotated[
        Number, Meta(description="log10 of 1 over the share of records without any cause that show as much")] = None
    smallest: Annotated[
        dict[str, SizeSection], Meta(description="smallest size this record would have shown")] = {}
    parameters: Annotated[
        dict[str, ParameterSection], Meta(description="fitted with this cause, on the whole record")] = {}
    reason: Annotated[str, Meta(description="why there is no gain to state, or where the cause was seen")] = ""


class RoundSection(Shape):
    """One round of a diagnosis; cause is null in the one that ended the search."""

    round: int
    cause: str | None = None
    gain: GainSection | None = None


class DiagnosisSection(Shape):
    """What the simulation got wrong and why, as diagnose found it."""

    verdict: Verdict
    sentence: Annotated[str, Meta(description="the verdict in words")] = ""
    causes: Annotated[list[str], Meta(description="in the order found")] = []
    between: Annotated[list[str], Meta(
        description="causes that explain the record equally well; with unlisted, what is in no catalogue, the "
        "part of it that has a name")] = []
    closest: Annotated[list[str], Meta(
        description="unexplained: what the extended drive has of the catalogue, maybe for something else")] = []
    experiment: Annotated[str, Meta(description="what would decide, or show a smaller effect")] = ""
    evidence: Annotated[dict[str, Number], Meta(description="log10 per cause")] = {}
    gain: Annotated[GainSection | None, Meta(description="from the base to the extended drive")] = None
    candidates: list[CandidateSection] = []
    rounds: list[RoundSection] = []
    rule: Annotated[str, Meta(description="the line of the table of rules that decided")] = ""
    facts: Annotated[
        dict[str, Any], Meta(description="what the rules compare, see docs/explanation/diagnosis.md")] = {}
