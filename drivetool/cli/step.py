"""The command of an estimator; each one's own file only names it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from drivetool.cli import options as cli
from drivetool.cli.deliver import deliver, draw_recordings
from drivetool.cli.inputs import Job, drive_for, findings, open_all
from drivetool.cli.outcomes import guarded
from drivetool.errors import DriveToolError

if TYPE_CHECKING:
    from drivetool.identify.estimate import Estimate
    from drivetool.identify.options import Options

    Estimator = Callable[..., Estimate]


def estimator_command(step: str, load: Callable[[], Estimator]) -> Callable[..., None]:
    """A typer command around an estimator.

    step  name of the command
    load  imports the estimator and returns it; called only when the command runs
    """
    def command(
        logs: cli.Logs, params: cli.Params = None, map: cli.Map = None, drive: cli.DriveName = None,
        hold: cli.Hold = None, free: cli.Free = None, set: cli.Set = None,
        criterion: cli.Criterion = cli.CriterionName.innovations, segment: cli.Segment = None,
        starts: cli.Starts = None, seed: cli.Seed = 1, out: cli.Out = None, json: cli.Json = False,
        plot: cli.Plot = None, strict: cli.Strict = False, debug: cli.Debug = False,
        quiet: cli.Quiet = False,
    ) -> None:
        job = Job(step, logs, params or (), map, drive, set or (), out, json, plot, strict, debug, quiet)

        def work() -> int:
            from drivetool.identify.options import Options

            return run(job, load(), Options(
                tuple(hold or ()), tuple(free or ()), criterion.value, starts, segment, seed))

        guarded(step, work, debug)

    return command


def run(job: Job, estimator: Estimator, options: Options) -> int:
    """Open, estimate, deliver; the exit code."""
    from drivetool.files.result_file import estimate_file

    opened = open_all(job)
    drive = drive_for(job, opened)
    for name in (*options.hold, *options.free):
        if name != "all":
            drive.quantity(name)
    options = replace(options, known=opened.loaded.covariance(drive))
    try:
        estimate = estimator(opened.experiments, drive, options)
    except DriveToolError:
        draw_recordings(job, opened.experiments)
        raise
    used = asdict(replace(options, known=None)) | dict(estimate.options) | {"set": list(job.set)}
    used.pop("known")
    estimate = replace(estimate, options=used, findings=findings(opened, estimate.findings))
    return deliver(job, estimate_file(estimate, opened.inputs, opened.loaded.carried), estimate.exhibits)
