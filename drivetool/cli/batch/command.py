"""drivetool batch."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivetool.cli import options as cli
from drivetool.cli.outcomes import guarded, say
from drivetool.errors import BadOption

if TYPE_CHECKING:
    from drivetool.files.site.shapes import SiteFile

HELP = ("A site of recordings: the recipe of its file, done with every recording of every machine on the cores "
        "there are. What is done stays done; a second run does what has changed.")
EXAMPLE = "drivetool batch site.yaml"

# Ten times what a fit of a usual recording takes; beyond it a recording is a mistake more often than large.
MEMORY_MB = 2000.0
MINUTES_15 = 900.0

Given = Annotated[list[str], typer.Argument(
    metavar="SITE|PATTERN", help="A site file; with --recipe recordings, or a quoted pattern such as "
    "'logs/**/*.mcap'.")]
Recipe = Annotated[str | None, typer.Option(
    "--recipe", metavar="FILE", help="A site file without recordings, whose recipe is done with those named.")]
Out = Annotated[str | None, typer.Option(
    "--out", "-o", metavar="DIR", help="Folder of the results. Default: the site file's or recipe's name with "
    "-results.")]
Workers = Annotated[int | None, typer.Option(
    "--workers", metavar="N", min=1, help="Processes at work. Default: one per core.")]
Scheduler = Annotated[str | None, typer.Option(
    "--scheduler", metavar="ADDRESS", help="Of a Dask cluster that does the work: tcp://HOST:PORT. It sees the "
    "recordings and the results under the same paths.")]
TimeLimit = Annotated[float, typer.Option(
    "--time-limit", metavar="S", min=0.001, help="Longest time in s that one step of one recording may take.")]
MemoryLimit = Annotated[float | None, typer.Option(
    "--memory-limit", metavar="MB", min=1.0, help="Most resident memory of a worker, where the system tells it. "
    "Default: 2000.")]
Explain = Annotated[bool, typer.Option("--explain", help="Say for everything that is run what has changed.")]
Verify = Annotated[bool, typer.Option(
    "--verify", help="Run nothing; exit code 3 unless the results are those of the recordings as they are.")]
Retry = Annotated[bool, typer.Option(
    "--retry", help="Run again what gave no result.")]
Junit = Annotated[str | None, typer.Option(
    "--junit", metavar="FILE", help="Verdicts as JUnit XML; - is standard output.")]
Markdown = Annotated[str | None, typer.Option(
    "--markdown", metavar="FILE", help="Verdicts as Markdown; - is standard output.")]


@dataclass(frozen=True)
class Asked:
    """The words of the command line."""

    given: Sequence[str]
    recipe: str | None
    map: str | None
    out: str | None
    workers: int | None
    scheduler: str | None
    time_limit: float
    memory_limit: float | None
    explain: bool
    verify: bool
    retry: bool
    junit: str | None
    markdown: str | None
    quiet: bool


def command(
    given: Given, recipe: Recipe = None, map: cli.Map = None, out: Out = None, workers: Workers = None,
    scheduler: Scheduler = None, time_limit: TimeLimit = MINUTES_15, memory_limit: MemoryLimit = None,
    explain: Explain = False, verify: Verify = False, retry: Retry = False, junit: Junit = None,
    markdown: Markdown = None, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> None:
    """See HELP."""
    asked = Asked(given, recipe, map, out, workers, scheduler, time_limit, memory_limit, explain, verify, retry,
                  junit, markdown, quiet)

    def work() -> int:
        from drivetool.cli.batch.site import run

        return run(asked)

    guarded("batch", work, debug, quiet)


def site_of(asked: Asked) -> tuple[SiteFile, Path, str]:
    """(the site, the folder that its paths count from, its file).

    raises  BadOption: words that do not fit together; BadParameters: see load_site
    """
    from drivetool.files.site.site_file import load_site, with_recordings

    if asked.recipe is None:
        if len(asked.given) > 1 or not asked.given[0].lower().endswith((".yaml", ".yml")):
            raise BadOption("one site file (.yaml), or recordings with --recipe", ", ".join(asked.given[:3]),
                            "Write the first site file with `drivetool init`, or name the recipe.")
        if asked.map is not None:
            raise BadOption("--map with --recipe only", "it beside a site file",
                            "Write the map into the site file.")
        site = load_site(asked.given[0])
        if not site.recordings:
            raise BadOption("recordings in the site file, or on the command line",
                            f"none in {asked.given[0]}", "Name them, and this file after --recipe.")
        return site, Path(os.path.abspath(asked.given[0])).parent, asked.given[0]
    site = load_site(asked.recipe)
    kinds = list(dict.fromkeys(step.kind for step in site.recipe))
    if site.recordings or len(kinds) > 1:
        found = "recordings in it" if site.recordings else f"the kinds {', '.join(kinds)}"
        raise BadOption(f"a recipe of one kind and without recordings in {asked.recipe}", found,
                        "Give the site file alone, which says the kind of each recording.")
    return with_recordings(site, asked.given, kinds[0], asked.map), Path.cwd(), asked.recipe


def out_of(asked: Asked, folder: Path, name: str) -> Path:
    """The folder of the results."""
    return Path(os.path.abspath(asked.out)) if asked.out else folder / f"{Path(name).stem}-results"


def check_verdicts(asked: Asked) -> None:
    """Raise BadOption where a file of verdicts could not be written, or both would go to one place."""
    from drivetool.files.write import check_target

    if asked.junit and asked.junit == asked.markdown:
        raise BadOption("different files for --junit and --markdown", f"{asked.junit} for both", "Rename one.")
    for path in filter(None, (asked.junit, asked.markdown)):
        check_target(path)


def speaker(asked: Asked):
    """What takes lines for a person: nobody where it should be quiet."""
    return (lambda text: None) if asked.quiet else (lambda text: say("batch", text))
