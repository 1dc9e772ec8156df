"""drivetool compare."""

from __future__ import annotations

from dataclasses import asdict, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from drivetool.cli import options as cli
from drivetool.cli.deliver import deliver, draw_recordings
from drivetool.cli.inputs import Job, drive_for, findings, noted, open_all
from drivetool.cli.outcomes import guarded
from drivetool.errors import DriveToolError

if TYPE_CHECKING:
    from drivetool.identify.compare import CompareOptions

HELP = ("Structures side by side. Each fitted on every record and checked on all the others; "
        "mean and spread of what they find over the experiments.")
EXAMPLE = "drivetool compare one.parquet two.parquet --structure oe --out compare.yaml"


class ComparedName(StrEnum):
    """What can be compared."""

    oe = "oe"
    bj = "bj"
    arx = "arx"
    armax = "armax"
    innovations = "innovations"
    physical = "physical"
    physical_innovations = "physical-innovations"


Structures = Annotated[list[ComparedName] | None, typer.Option(
    "--structure", help="Repeatable; physical is the drive fitted to simulate (K = 0), physical-innovations to "
    "predict. Default: oe and bj.")]
Order = Annotated[int | None, typer.Option(
    "--order", metavar="N", min=1, help="Of the polynomial ones. Default: 2 n - 1 for a drive of n bodies.")]


def command(
    logs: cli.Logs, params: cli.Params = None, map: cli.Map = None, condition: cli.Condition = None,
    drive: cli.DriveName = None, structure: Structures = None, order: Order = None,
    noise_order: cli.NoiseOrder = None, set: cli.Set = None,
    out: cli.Out = None, json: cli.Json = False, plot: cli.Plot = None, strict: cli.Strict = False,
    debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> None:
    """See HELP."""
    job = Job("compare", logs, params or (), map, drive, set or (), out, json, plot, strict, debug, quiet,
              condition or ())

    def work() -> int:
        from drivetool.identify.compare import CompareOptions

        names = tuple(dict.fromkeys(s.value for s in structure)) if structure else ("oe", "bj")
        return run(job, CompareOptions(names, order, noise_order))

    guarded("compare", work, debug, quiet)


def run(job: Job, options: CompareOptions) -> int:
    """Open, fit, check, deliver; the exit code."""
    from drivetool.files.comparison_file import comparison_file
    from drivetool.identify.compare import compare

    opened = open_all(job)
    drive = drive_for(job, opened)
    try:
        found = compare(opened.experiments, drive, options)
    except DriveToolError:
        draw_recordings(job, opened.experiments)
        raise
    found = replace(found, options=noted(job, asdict(options)), findings=findings(opened, found.findings))
    return deliver(job, comparison_file(found, opened.inputs), found.exhibits)
