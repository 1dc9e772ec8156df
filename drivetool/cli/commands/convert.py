"""drivetool convert."""

from __future__ import annotations

from typing import Annotated

import typer

from drivetool.cli.options import Job, check_outputs, common as cli
from drivetool.cli.output import exit_code, guarded, say
from drivetool.errors import BadOption
from drivetool.files.disk import write_whole

HELP = "A recording as Parquet in SI. The channels that play a role, named by it, each on its own clock."
EXAMPLE = "drivetool convert steps.mcap --map map.yaml --out steps.parquet"

Log = Annotated[str, typer.Argument(metavar="LOG", help="A recording, Parquet or MCAP, or the folder of one.")]
Out = Annotated[str, typer.Option("--out", "-o", metavar="FILE.parquet", help="Where the Parquet goes.")]


def command(
    log: Log, out: Out, map: cli.Map = None, strict: cli.Strict = False, debug: cli.Debug = False,
    quiet: cli.Quiet = False,
) -> None:
    """See HELP."""
    job = Job("convert", [log], (), map, None, (), out, False, None, strict, debug, quiet)
    guarded("convert", lambda: run(job), debug)


def run(job: Job) -> int:
    """Read, convert, write; the exit code."""
    from rich.console import Console

    from drivetool.files.results import finding_sections, recording_bytes
    from drivetool.files.tables import result_tables as tables
    from drivetool.files.yaml import load_channel_map
    from drivetool.logs.channels import in_si
    from drivetool.logs.formats import read_recording

    if not job.out.lower().endswith(".parquet"):
        raise BadOption("a file name after --out that ends in .parquet", f"'{job.out}'",
                        "The output format is Parquet: end the name with .parquet.")
    check_outputs(job)
    channel_map = load_channel_map(job.map)
    converted = in_si(read_recording(job.log, channel_map), channel_map)
    write_whole(job.out, recording_bytes(converted))
    if not job.quiet:
        tables.print_findings(finding_sections(converted.findings), Console(stderr=True, highlight=False))
        counts = ", ".join(f"{len(c.values)} of {name} [{c.unit}]" for name, c in converted.channels.items())
        say("convert", f"wrote {job.out}: {counts}")
    return exit_code((finding.severity for finding in converted.findings), True, job.strict)
