"""What is in a recording.

Channels with unit, rate, range, gaps, spikes and the role they would get.
"""

from __future__ import annotations

from typing import Annotated

import typer

from drivetool.cli.options import Job, check_outputs, common as cli
from drivetool.cli.output import deliver

EXAMPLE = "drivetool inspect steps.mcap --plot pictures"
Timing = Annotated[bool, typer.Option(
    "--timing", help="Test too, by a fitted model, whether the torque is logged in the cycle in which it acts.")]


def command(
    log: cli.Log, map: cli.Map = None, timing: Timing = False, out: cli.Out = None,
    json: cli.Json = False, plot: cli.Plot = None,
    strict: cli.Strict = False, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> int:
    """Its options; the exit code."""
    from drivetool.files.results import channel_plot, finding_sections, inspection_file
    from drivetool.files.yaml import load_channel_map
    from drivetool.logs.door import inspect_log

    job = Job("inspect", [log], (), map, None, (), out, json, plot, strict, quiet)
    check_outputs(job)
    found = inspect_log(job.log, load_channel_map(job.map))
    findings = [*found.findings]
    if timing and found.experiment:
        from drivetool.check.faults import torque_timing_findings  # loads and fits, which inspecting does not

        findings += torque_timing_findings(found.experiment)
    return deliver(job, inspection_file(found, finding_sections(findings)), [channel_plot(found)])
