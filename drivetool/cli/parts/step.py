"""The command of an estimator; each one's own file only names it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from drivetool.cli.options import (
    Job,
    collected_findings,
    common as cli,
    drive_for,
    errors_as_usage,
    noted_options,
    open_all,
    record_differences,
    start_of,
    windows_of,
    with_torques,
)
from drivetool.cli.output import deliver, recordings_drawn_on_failure
from drivetool.errors import BadOption

if TYPE_CHECKING:
    from drivetool.identify.estimate import Estimate
    from drivetool.identify.setup import Options

    Estimator = Callable[..., Estimate]


def estimator_command(step: str, load: Callable[[], Estimator], own: Mapping[str, tuple] = MappingProxyType({}),
                      ) -> Callable[..., int]:
    """A typer command around an estimator.

    step  name of the command
    load  imports the estimator and returns it; called only when the command runs
    own   options that only this command has, or has in its own way: field of Options -> (annotation, default)
    """
    def command(
        logs: cli.Logs, params: cli.Params = None, map: cli.Map = None, condition: cli.Condition = None,
        drive: cli.DriveName = None,
        hold: cli.Hold = None, free: cli.Free = None, set: cli.Set = None,
        criterion: cli.Criterion = cli.CriterionName.auto, segment: cli.Segment = None,
        starts: cli.Starts = None, seed: cli.Seed = 1, out: cli.Out = None, json: cli.Json = False,
        plot: cli.Plot = None, strict: cli.Strict = False, debug: cli.Debug = False,
        quiet: cli.Quiet = False, **more: object,
    ) -> int:
        from drivetool.identify.setup import Options

        job = Job(step, logs, params or (), map, drive, set or (), out, json, plot, strict, quiet,
                  condition or (), start=more.pop("start", None) or (), record=more.pop("record", None) or (),
                  stages=more.pop("stages", None) or "")
        return run(job, load(), Options(
            tuple(hold or ()), tuple(free or ()), criterion.value, starts, segment, seed,
            **{name: getattr(value, "value", value) for name, value in more.items()}))

    return _with_signature(command, own)


def _with_signature(command: Callable[..., int], own: Mapping[str, tuple]) -> Callable[..., int]:
    """The command with the signature that typer reads: **more spelled out."""
    signature = inspect.signature(command, eval_str=True)
    shown = {name: p for name, p in signature.parameters.items() if p.kind is not p.VAR_KEYWORD}
    for name, (annotation, default) in own.items():
        shown[name] = inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default,
            annotation=annotation)
    every = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in shown.values()]
    command.__signature__ = signature.replace(parameters=every)
    command.__annotations__ = {name: p.annotation for name, p in shown.items()}
    return command


def run(job: Job, estimator: Estimator, options: Options) -> int:
    """Open, estimate, deliver; the exit code."""
    from drivetool.files.results import estimate_file
    from drivetool.identify.channels import used_by
    from drivetool.identify.setup import Options, refuse_unused
    from drivetool.identify.shaft_torque import check_shaft_torque
    from drivetool.logs import refuse_copies

    if job.record and job.step == "steady" and options.method != "coast-down":
        raise BadOption("--method coast-down with --record of steady", f"--method {options.method}",
                        "Give --method coast-down, or leave out --record: other methods assume equal conditions in "
                        "all recordings.")
    refuse_unused(job.step, options)
    opened = open_all(job)
    refuse_copies(opened.experiments)
    stated = drive_for(job, opened, free=options.free)
    differences = record_differences(job, opened.experiments, stated.start)
    opened, drive = with_torques(opened, differences.drive, (*options.free, *differences.free),
                                 job.step == "steady")
    with errors_as_usage():
        for name in (*options.hold, *options.free):
            if name != "all":
                drive.quantity(name)
    check_shaft_torque(opened.experiments, drive)
    options = replace(options, free=(*options.free, *differences.free),
                      known=opened.loaded.covariance(drive, single=True), unidentified=tuple(stated.acting),
                      start=replace(start_of(job.start, drive), records=differences.starts),
                      stages=windows_of(job.stages, drive.motion_unit))
    with recordings_drawn_on_failure(job, opened.experiments):
        estimate = estimator(opened.experiments, drive, options)
    held = {*drive.constants, *(p.name for p in estimate.parameters if p.status == "held")}
    doubts = stated.doubts(held & stated.acting.keys())
    used = asdict(replace(options, known=None)) | dict(estimate.options) | {"set": list(job.set)}
    defaults = asdict(Options())  # the file states options of a single step only where they were requested
    used |= {"stages": job.stages} if job.stages else {}
    of_one_step = {f.name for f in fields(Options) if f.metadata}
    used = {name: value for name, value in used.items()
            if name not in ("known", "unidentified") and not (name in of_one_step and value == defaults[name])}
    estimate = replace(estimate, options=noted_options(job, used, differences.words),
                       findings=collected_findings(opened, (*doubts, *estimate.findings), used_by(
                           job.step, opened.experiments, drive, options.criterion), drive, job.step, options))
    return deliver(job, estimate_file(estimate, opened.inputs, opened.loaded.carried, stated.acting),
                   estimate.exhibits)
