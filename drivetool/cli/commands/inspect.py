"""What is in a recording.

Channels with unit, rate, range, gaps, spikes and the role they would get.
"""

from __future__ import annotations

from drivetool.cli.options import Job, check_outputs, common as cli
from drivetool.cli.output import deliver

EXAMPLE = "drivetool inspect steps.mcap --plot pictures"


def command(
    log: cli.Log, map: cli.Map = None, out: cli.Out = None, json: cli.Json = False, plot: cli.Plot = None,
    strict: cli.Strict = False, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> int:
    """Its options; the exit code."""
    from drivetool.check.faults import torque_timing_findings
    from drivetool.files.results import channel_plot, finding_sections, inspection_file
    from drivetool.files.yaml import load_channel_map
    from drivetool.logs.door import inspect_log

    job = Job("inspect", [log], (), map, None, (), out, json, plot, strict, quiet)
    check_outputs(job)
    found = inspect_log(job.log, load_channel_map(job.map))
    timing = torque_timing_findings(found.experiment) if found.experiment else []
    return deliver(job, inspection_file(found, finding_sections((*found.findings, *timing))), [channel_plot(found)])
