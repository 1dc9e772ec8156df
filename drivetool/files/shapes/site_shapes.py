"""The on-disk shape of a site file: which recordings there are, what is done with them, what they are judged by."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from drivetool.files.shapes.parameter_shapes import MeasureSection, Shape

SITE_SCHEMA = "drivetool/site/1"
ONE_KIND = "recording"  # where no kind is given, all are of this one
NEXT, PREVIOUS = "next", "previous"
Word = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]


class MachineSection(Shape):
    """How a recording says to which machine it belongs; one of the three."""

    folder: Annotated[Annotated[int, Meta(ge=1)] | None, Meta(
        description="the name of a folder above it: 1 is the one that it is in")] = None
    file: Annotated[str | None, Meta(
        description="pattern of its file name, as in '{machine}_*.mcap'; * is any text")] = None
    metadata: Annotated[str | None, Meta(
        description="key in the metadata of a Parquet file, or in a metadata record of an MCAP file")] = None


class RecordingsSection(Shape):
    """Recordings that are alike; one that several sections match belongs to the first."""

    files: Annotated[str, Meta(description="pattern of paths from the folder of the site file; ** is any folders")]
    kind: Annotated[Word, Meta(
        description="what was recorded, in a word of your own: steady, steps, gap")] = ONE_KIND
    machine: Annotated[MachineSection | str | None, Meta(
        description="a name, or where it stands; default: the folder that the recording is in")] = None
    map: Annotated[str | None, Meta(description="channel map, as after --map")] = None


class StepSection(Shape):
    """One step of the recipe, done with every recording of a kind."""

    command: Annotated[str, Meta(description="as typed, without recordings and --out: greybox --free all")]
    kind: Annotated[Word, Meta(description="the kind of recordings that it reads")] = ONE_KIND
    params: Annotated[tuple[str, ...], Meta(
        description="earlier steps; the newest file of each for the machine goes in with --params")] = ()
    joint: Annotated[bool, Meta(description="fit all recordings of the kind of one machine together")] = False
    name: Annotated[Word | None, Meta(
        description="what its files are called; default: the command's first word")] = None
    judge: Annotated[Word | None, Meta(
        description="of validate and diagnose: which recording of the machine judges the fit of this one: next, "
        "previous, or the newest of another kind, by the name of that kind")] = None


class BarSection(Shape):
    """What every recording must reach: a figure with one limit, or findings that there must not be."""

    figure: Annotated[str | None, Meta(
        description="a parameter, derived.NAME, or a figure of fit such as simulation_fit_percent")] = None
    at_most: Annotated[MeasureSection | float | None, Meta(
        description="with a unit, where the figure has one")] = None
    at_least: MeasureSection | float | None = None
    findings: Annotated[Literal["no-failure", "no-warning"] | None, Meta(
        description="no-warning forbids failures, too")] = None
    step: Annotated[str | None, Meta(
        description="the step that tells; default: of a figure the last that has it, of findings every one")] = None


class SiteFile(Shape):
    """A site of recordings; a recipe alone has no recordings."""

    schema: Literal["drivetool/site/1"]
    recordings: tuple[RecordingsSection, ...] = ()
    recipe: Annotated[tuple[StepSection, ...], Meta(description="in the order in which it is done")] = ()
    bars: tuple[BarSection, ...] = ()
