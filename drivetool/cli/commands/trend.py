"""What changed over the recordings of a site.

Per machine and parameter: the mean with the scatter within a day and between days, the drift, steps, and alarms
with their dates.
"""

from __future__ import annotations

import math
from typing import Annotated

import typer

from drivetool.cli.options import Job, check_outputs, common as cli
from drivetool.cli.output import deliver
from drivetool.errors import BadOption
from drivetool.site.trends import DEFAULT_ALARM_RATIO

EXAMPLE = "drivetool trend site/summary.parquet --out trends.yaml"

Summary = Annotated[str, typer.Argument(
    metavar="SUMMARY", help="Summary of a site, one row per recording, step and parameter, as Parquet.")]
Alarm = Annotated[float, typer.Option(
    "--alarm", metavar="RATIO", min=1.0, help="Size of a change from which on it is an alarm, in standard "
    "deviations of the runs before it.")]


def command(
    summary: Summary, alarm: Alarm = DEFAULT_ALARM_RATIO, out: cli.Out = None, json: cli.Json = False,
    plot: cli.Plot = None, strict: cli.Strict = False, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> int:
    """Its options; the exit code."""
    from drivetool.logs.formats import read_summary
    from drivetool.site.trends import summary_input, trend_plots, trends_file, trends_of

    if not math.isfinite(alarm):
        raise BadOption("a number for --alarm", str(alarm), "Write for example '--alarm 5'.")
    job = Job("trend", (), more=(summary,), out=out, json=json, plot=plot, strict=strict, quiet=quiet)
    check_outputs(job)
    findings, found = trends_of(read_summary(summary), alarm)
    exhibits, machines = trend_plots(found)
    file = trends_file(findings, found, {"alarm": alarm}, [summary_input(summary)])
    return deliver(job, file, exhibits, names=machines)
