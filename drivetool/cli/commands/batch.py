"""A site of recordings: the recipe of its file, done with every recording of every machine on the cores there are.

What is done stays done; a second run does what has changed.
"""

from __future__ import annotations

from typing import Annotated

import typer

from drivetool.cli.options import common as cli
from drivetool.cli.output import DONE, MISSED, say, write_stdout
from drivetool.site import BatchRequest

EXAMPLE = "drivetool batch site.yaml"

DEFAULT_TIME_LIMIT = 900.0  # s. A choice: minutes suffice for a long record; a step that hangs frees its worker.

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


def command(
    typer_context: typer.Context, given: Given, recipe: Recipe = None, map: cli.Map = None, out: Out = None,
    workers: Workers = None, scheduler: Scheduler = None, time_limit: TimeLimit = DEFAULT_TIME_LIMIT,
    memory_limit: MemoryLimit = None, explain: Explain = False, verify: Verify = False, retry: Retry = False,
    junit: Junit = None, markdown: Markdown = None, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> int:
    """Its options; the exit code."""
    from drivetool.site import run

    request = BatchRequest(given, recipe, map, out, workers, scheduler, time_limit, memory_limit, explain, verify,
                           retry, junit, markdown, lambda text: None if quiet else say("batch", text), write_stdout)
    return DONE if run(request, typer_context.obj) else MISSED
