"""A recording as Parquet in SI.

The channels that play a role, named by it, each on its own clock.
"""

from __future__ import annotations

from typing import Annotated

import typer

from drivetool.cli.options import Job, check_outputs, common as cli
from drivetool.cli.output import exit_code, say, show_findings
from drivetool.errors import BadOption
from drivetool.files.disk import write_whole

EXAMPLE = "drivetool convert steps.mcap --map map.yaml --out steps.parquet"

Out = Annotated[str, typer.Option("--out", "-o", metavar="FILE.parquet", help="Where the Parquet goes.")]


def command(
    log: cli.Log, out: Out, map: cli.Map = None, strict: cli.Strict = False, debug: cli.Debug = False,
    quiet: cli.Quiet = False,
) -> int:
    """Its options; the exit code."""
    from drivetool.files.results import finding_sections, recording_bytes
    from drivetool.files.yaml import load_channel_map
    from drivetool.logs.channels import in_si
    from drivetool.logs.formats import read_recording

    if not out.lower().endswith(".parquet"):
        raise BadOption("a file name after --out that ends in .parquet", f"'{out}'",
                        "The output format is Parquet: end the name with .parquet.")
    job = Job("convert", [log], (), map, out=out)
    check_outputs(job)
    channel_map = load_channel_map(map)
    converted = in_si(read_recording(job.log, channel_map), channel_map)
    write_whole(out, recording_bytes(converted))
    if not quiet:
        show_findings(finding_sections(converted.findings))
        counts = ", ".join(f"{len(c.values)} of {name} [{c.unit}]" for name, c in converted.channels.items())
        say("convert", f"wrote {out}: {counts}")
    return exit_code((finding.severity for finding in converted.findings), True, strict)
