"""drivetool inspect."""

from __future__ import annotations

from typing import Annotated

import typer

from drivetool.cli import options as cli
from drivetool.cli.deliver import deliver
from drivetool.cli.inputs import check_outputs
from drivetool.cli.job import Job
from drivetool.cli.outcomes import guarded

HELP = "What is in a recording. Channels with unit, rate, range, gaps, spikes and the role they would get."
EXAMPLE = "drivetool inspect steps.mcap --plot pictures"

Log = Annotated[str, typer.Argument(metavar="LOG", help="A recording, Parquet or MCAP, or the folder of one.")]


def command(
    log: Log, map: cli.Map = None, out: cli.Out = None, json: cli.Json = False, plot: cli.Plot = None,
    strict: cli.Strict = False, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> None:
    """See HELP."""
    job = Job("inspect", [log], (), map, None, (), out, json, plot, strict, debug, quiet)
    guarded("inspect", lambda: run(job), debug)


def run(job: Job) -> int:
    """Read, look, deliver; the exit code."""
    from drivetool.files.channel_map_file import load_channel_map
    from drivetool.files.inspection import exhibit, inspection_file
    from drivetool.files.result_file import finding_sections
    from drivetool.identify.recorded_timing import looked_at
    from drivetool.logs.inspect import inspect_log

    check_outputs(job)
    found = inspect_log(job.log, load_channel_map(job.map))
    timing = looked_at(found.experiment) if found.experiment else []
    return deliver(job, inspection_file(found, finding_sections((*found.findings, *timing))), [exhibit(found)])
