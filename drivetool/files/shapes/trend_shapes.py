"""The on-disk shape of a trends file; its JSON Schema is made from these types."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from drivetool.files.shapes.parameter_shapes import FileSection, FindingSection, Number, Plain, Shape, Tool

TRENDS_SCHEMA = "drivetool/trends/1"


class MeanSection(Shape):
    """A random-effects mean over recordings."""

    value: float
    ci95: Annotated[tuple[Number, Number] | None, Meta(
        description="95 % interval by Hartung and Knapp, over the days where there are several; null for one "
        "recording")]
    std_within_day: Annotated[Number, Meta(
        description="s_r: from recording to recording of one day, beyond the stated std; null where no day has two "
        "recordings")]
    std_between_days: Annotated[Number, Meta(
        description="s_R: from day to day; null for one day, or without dates")]
    recordings: Annotated[int, Meta(description="number of recordings")]
    days: Annotated[int | None, Meta(description="number of days (UTC); null without dates")]


class SlopeSection(Shape):
    """A slope over the recordings or over the days."""

    value: float
    std: float
    ci95: Annotated[tuple[Number, Number], Meta(
        description="95 % interval by Student's t, the correlation of neighbours included")]


class DriftSection(Shape):
    """The line beside the steps of a series."""

    per_recording: SlopeSection
    per_day: Annotated[SlopeSection | None, Meta(description="null without dates on three days")]
    before: Annotated[float, Meta(description="of the line, at the first recording")]
    after: Annotated[float, Meta(description="at the last one")]
    std: Annotated[float, Meta(description="of the recordings about drift and steps")]
    ratio: Annotated[Number, Meta(description="change from the first to the last recording over std")]
    chance: Annotated[float, Meta(description="of such a slope without a drift, for all tests of the site")]
    significant: Annotated[bool, Meta(description="whether it drifts")]
    alarm: Annotated[bool, Meta(description="whether the drift is as large as an alarm asks")]


class ChangeSection(Shape):
    """A step of a series."""

    last_before: Annotated[str, Meta(description="the last recording before it")]
    first_after: Annotated[str, Meta(description="the first recording after it")]
    began: Annotated[tuple[str, str] | None, Meta(description="when these two began (UTC); null without dates")]
    before: Annotated[float, Meta(description="mean before; beside a drift the line at the step")]
    after: Annotated[float, Meta(description="mean after it, likewise")]
    std: Annotated[float, Meta(description="of the runs before, since the step before, their drift included")]
    runs: Annotated[int, Meta(description="number of the runs before")]
    ratio: Annotated[Number, Meta(description="size over std; null where the runs before are all equal")]
    chance: Annotated[float, Meta(description="of such a step without one, for all places and tests of the site")]
    alarm: Annotated[bool, Meta(description="whether it is as large as an alarm asks")]


class OutlierSection(Shape):
    """A recording far from all others of its series."""

    recording: str
    value: float
    expected: Annotated[float, Meta(description="what the others say at its place")]
    std: Annotated[float, Meta(description="of the others about that")]
    ratio: Annotated[float, Meta(description="distance over std")]
    chance: Annotated[float, Meta(description="of one as far off, for all recordings and tests of the site")]


class SeriesSection(Shape):
    """A parameter of a machine over its recordings."""

    machine: str
    parameter: str
    step: Annotated[str, Meta(description="the step that fitted it")]
    kind: Annotated[str, Meta(description="of the recordings, a word of the site file")]
    unit: str
    first: Annotated[str, Meta(description="the first recording")]
    last: Annotated[str, Meta(description="the last recording")]
    left_out: Annotated[int, Meta(description="recordings without a fitted, finite value")]
    outliers: Annotated[list[OutlierSection], Meta(
        description="recordings far from all others; what follows is of the rest")]
    mean: MeanSection
    parts: Annotated[list[MeanSection], Meta(description="means between the steps; empty without steps")]
    drift: Annotated[DriftSection | None, Meta(description="null where reason says why")]
    changes: list[ChangeSection]
    correlation: Annotated[float, Meta(description="of neighbours, beside steps and drift")]
    reason: Annotated[str, Meta(description="why neither drift nor steps are looked for")]


class TrendsFile(Shape):
    """What trend writes."""

    schema: Literal["drivetool/trends/1"]
    tool: Tool
    step: Literal["trend"]
    outcome: str
    series: list[SeriesSection]
    findings: list[FindingSection]
    inputs: Annotated[list[FileSection], Meta(description="the summary that was read")]
    options: Plain
