"""What a model says over the torque of a record.

Every speed, angle and shaft torque of the drive, as a Parquet table.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from drivetool.cli.options import (
    Job,
    collected_findings,
    common as cli,
    drive_for,
    open_all,
    start_of,
    with_torques,
)
from drivetool.cli.output import draw, exit_code, say
from drivetool.errors import BadOption
from drivetool.files.disk import write_whole

if TYPE_CHECKING:
    from drivetool.check.validation import ModelRun
    from drivetool.identify.estimate import PlotData
    from drivetool.logs import Experiment

EXAMPLE = "drivetool simulate steps.parquet --params greybox.yaml --out sim.parquet"

Log = Annotated[str, typer.Argument(metavar="LOG", help="Recording, Parquet or MCAP.")]
Table = Annotated[str, typer.Option("--out", "-o", metavar="FILE", help="Where the Parquet table goes.")]


def command(
    log: Log, out: Table, params: cli.Params = None, map: cli.Map = None, condition: cli.Condition = None,
    drive: cli.DriveName = None, set: cli.Set = None, segment: cli.FreeRun = 0.0, start: cli.Start = None,
    plot: cli.Plot = None, strict: cli.Strict = False, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> int:
    """Its options; the exit code."""
    job = Job("simulate", [log], params or (), map, drive, set or (), out, False, plot, strict, quiet,
              condition or (), start=start or ())
    return run(job, segment)


def run(job: Job, segment: float) -> int:
    """Open, simulate, write; the exit code."""
    from drivetool.check.validation import run_model
    from drivetool.files.results import run_table
    from drivetool.identify.channels import used_by

    if not job.out.lower().endswith(".parquet"):
        raise BadOption("a file name that ends in .parquet after --out", f"'{job.out}'",
                        "The table is binary; write for example '--out sim.parquet'.")
    _ = job.log
    opened = open_all(job)
    assumed, doubts = drive_for(job, opened).assumed()
    opened, drive = with_torques(opened, assumed)
    experiment, = opened.experiments
    found = run_model(experiment, drive, segment, start_of(job.start, drive))
    all_findings = collected_findings(opened, doubts, used_by(job.step, opened.experiments, drive), drive, job.step)
    models = ", ".join(name for name, _ in opened.inputs)
    given = {"condition": "; ".join(job.condition), "start": "; ".join(job.start)}
    about = {"record": experiment.name, "record_sha256": experiment.sha256, "models": models,
             **{option: words for option, words in given.items() if words}}
    write_whole(job.out, run_table(found, about))
    pictures = draw(job, [_record_plot(experiment, found, role) for role in found.measured], [])
    if not job.quiet:
        for finding in all_findings:
            say("simulate", f"{finding.severity} {finding.code}: {finding.text} {finding.action}".rstrip())
        for role in found.measured:
            say("simulate", _fit_text(found, role))
        say("simulate", f"wrote {job.out}")
        if pictures:
            say("simulate", f"drew {', '.join(pictures)} in {job.plot}")
    return exit_code((finding.severity for finding in all_findings), True, job.strict)


def _fit_text(found: ModelRun, role: str) -> str:
    """The fit of one simulated sensor, in a line."""
    import numpy as np

    from drivetool.identify.estimate import fit_percent, fit_text

    y, s = found.measured[role], found.simulated[role]
    rmse = float(np.sqrt(np.nanmean((y - s) ** 2)))
    return f"{role}: fit {fit_text(fit_percent(y, s))}, rmse {rmse:.3g} {found.unit(role)}"


def _record_plot(experiment: Experiment, found: ModelRun, role: str) -> PlotData:
    """Measured and simulated of one sensor."""
    from drivetool.identify.estimate import record_picture

    return record_picture(
        f"{experiment.name}: measured and simulated", f"{role.replace('_', ' ')} [{found.unit(role)}]", found.time,
        found.measured[role], found.simulated[role],
        {f"torque [{found.torque_unit}]": found.inputs["motor_torque"]})
