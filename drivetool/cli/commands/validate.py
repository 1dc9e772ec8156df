"""Check models on records not seen.

Simulated fit, residuals, cross table; every --params file is a model of its own.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivetool.cli.options import (
    RECORD_OPTION,
    WORD_SEPARATOR,
    Job,
    Opened,
    collected_findings,
    common as cli,
    drive_for,
    noted_options,
    only_known_differences,
    open_all,
    record_differences,
    start_of,
)
from drivetool.cli.output import deliver, recordings_drawn_on_failure, say
from drivetool.errors import BadOption

if TYPE_CHECKING:
    from drivetool.check.validation import ValidateOptions
    from drivetool.drive import Drive
    from drivetool.files.shapes import ParameterFile
    from drivetool.files.yaml import Loaded
    from drivetool.finding import Finding
    from drivetool.logs import Experiment

EXAMPLE = "drivetool validate other.parquet --params backlash.yaml --min-fit 95"

GainsPath = Annotated[str | None, typer.Option(
    "--gains", metavar="FILE", help="Gains that tune wrote: replay the closed loop on a record of a load step.")]
Configuration = Annotated[str | None, typer.Option(
    "--configuration", metavar="NAME", help="Which design of the gains file; default the best.")]


def command(
    logs: cli.Logs, params: cli.Models, map: cli.Map = None, condition: cli.Condition = None,
    drive: cli.DriveName = None,
    min_fit: cli.MinFit = None, max_correlation: cli.MaxCorrelation = 0.15,
    criterion: cli.CheckCriterion = cli.CheckCriterionName.simulation,
    segment: cli.FreeRun = 0.0, flux_decay: cli.FluxDecay = None,
    start: cli.Start = None, record: cli.Record = None, seed: cli.Seed = 1,
    out: cli.Out = None, json: cli.Json = False,
    gains: GainsPath = None, configuration: Configuration = None,
    plot: cli.Plot = None, strict: cli.Strict = False, debug: cli.Debug = False,
    quiet: cli.Quiet = False,
) -> int:
    """Each --params file is a model of its own; the exit code."""
    from drivetool.check.validation import ValidateOptions

    job = Job("validate", logs, params, map, drive, (), out, json, plot, strict, quiet, condition or (),
              (gains,) if gains else (), start or (), record or ())
    options = ValidateOptions(min_fit, max_correlation, segment, seed, criterion=criterion.value,
                              flux_decay=flux_decay)
    return run(job, options) if gains is None else run_gains(job, options, gains, configuration)


def run_gains(job: Job, options: ValidateOptions, gains: str, configuration: str | None) -> int:
    """Replay tuned gains; the exit code."""
    from drivetool.cli.parts import replay_gains
    from drivetool.files.results import validation_file
    from drivetool.tune.simulation import COMPARED_ROLES

    for option, words in (("--start", job.start), ("--record", job.record)):
        if words:
            raise BadOption(f"{option} or --gains", "both",
                            "A replay with --gains starts from the state of the record: leave the other "
                            "option out.")
    if options.criterion != "simulation" or options.flux_decay is not None:
        other = "--flux-decay" if options.criterion == "simulation" else f"--criterion {options.criterion}"
        raise BadOption(f"{other} or --gains", "both",
                        "A replay with --gains is a simulation of the loop: leave the other option out.")
    opened = open_all(job)
    each, assumed, doubts = _assumed_models(job, opened, options.criterion)
    opened, drives = _with_model_torques(opened, assumed, False)
    models = [(one.sources[0].name, one.sources[0].sha256, drive) for one, drive in zip(each, drives, strict=True)]
    validation, entry = replay_gains(opened.experiments, models, gains, configuration, options)
    used = _noted(options) | {"gains": entry[0], "configuration": configuration}
    validation = replace(validation, options=noted_options(job, used), findings=collected_findings(
        opened, (*doubts, *validation.findings), {*COMPARED_ROLES, "load_torque"}, models[0][2], job.step))
    return deliver(job, validation_file(validation, (*opened.inputs, entry)), validation.exhibits)


def _assumed_models(job: Job, opened: Opened, criterion: str) -> tuple[list[Loaded], list[Drive], list[Finding]]:
    """The files one by one, the drive of each with its values taken as known, and findings on those that are not.

    A file of ratios has all that a coast-down depends on.
    """
    from drivetool.cli.parts import COAST_DOWN
    from drivetool.files.yaml import has_only_ratios

    each = [replace(opened.loaded, sources=(source,)) for source in opened.loaded.sources]
    found = [drive_for(job, opened, one).assumed() for one in each]
    return each, [drive for drive, _ in found], [
        finding for one, (_, doubts) in zip(each, found, strict=True) for finding in doubts
        if criterion != COAST_DOWN or not has_only_ratios(one.sources[0].file)]


def _with_model_torques(opened: Opened, drives: Sequence[Drive], off_too: bool) -> tuple[Opened, list[Drive]]:
    """The recordings with inputs in A, V or % as torques, and the drives with the torque constants used.

    off_too  whether stretches in which an induction motor has no supply are kept
    """
    from drivetool.identify.setup import as_torques_for_models

    experiments, known = as_torques_for_models(opened.experiments, drives, off_too)
    return replace(opened, experiments=experiments), known


def _fitted_recordings(file: ParameterFile, experiments: Sequence[Experiment]) -> list[str]:
    """sha256 of the recordings that a fit has used, except those of which it used other parts."""
    from drivetool.logs.conditioning import kept_windows, parse_step

    parts = kept_windows([parse_step(str(text)) for text in file.options.get("condition", ())])
    other_parts = {e.sha256 for e in experiments
             if not any(max(first, e.time[a]) < min(last, e.time[b - 1])
                        for a, b in e.segments for first, last in parts)}
    return [entry.sha256 for entry in file.data if entry.sha256 not in other_parts]


def _noted(options: ValidateOptions) -> dict[str, Any]:
    """The options as the file notes them; flux_decay only for a coast-down."""
    return {name: value for name, value in asdict(options).items() if name != "flux_decay" or value is not None}


def run(job: Job, options: ValidateOptions) -> int:
    """Open, check, deliver; the exit code."""
    from drivetool.check.validation import validate, validate_torque
    from drivetool.cli.parts import COAST_DOWN, validate_coast_downs, with_coast_down_criterion, with_flux_decay
    from drivetool.files.results import validation_file
    from drivetool.identify.channels import used_by

    opened = open_all(job)
    options = with_coast_down_criterion(opened, options)
    each, assumed, doubts = _assumed_models(job, opened, options.criterion)
    differences = [only_known_differences(record_differences(job, opened.experiments, drive), job.step)
                   for drive in assumed]
    opened, drives = _with_model_torques(opened, [found.drive for found in differences],
                                         options.criterion == COAST_DOWN)
    models = [(one.sources[0].name, drive, one.noise) for one, drive in zip(each, drives, strict=True)]
    known = [one.covariance(drive) for one, (_, drive, _) in zip(each, models, strict=True)]
    options = with_flux_decay(replace(options, start=replace(start_of(job.start, models[0][1]),
                                                       records=differences[0].starts)), drives)
    fitted_on = [_fitted_recordings(source.file, opened.experiments) for source in opened.loaded.sources]
    more: dict[str, Any] = {"fitted_on": fitted_on} if any(fitted_on) else {}  # unknown for files written by hand
    with recordings_drawn_on_failure(job, opened.experiments):
        if options.criterion == COAST_DOWN:
            validation = validate_coast_downs(opened, drives, options, fitted_on, known)
        elif options.criterion == "inverse":
            validation = validate_torque(opened.experiments, [(n, d) for n, d, _ in models], options, **more)
        else:
            more |= {"known": known} if any(known) else {}
            validation = validate(opened.experiments, models, options, **more)
    used = _noted(options) | dict(validation.options)
    used_roles = {role for _, drive, _ in models
             for role in used_by(job.step, opened.experiments, drive, options.criterion)}
    validation = replace(validation, options=noted_options(job, used, differences[0].words),
                         findings=collected_findings(
                             opened, (*doubts, *validation.findings), used_roles, models[0][1], job.step))
    code = deliver(job, validation_file(validation, opened.inputs), validation.exhibits)
    if not job.quiet and validation.unexplained:
        words = ["drivetool", "diagnose", *job.logs, "--params", job.params[0]]
        words += ["--map", job.map] if job.map else []
        words += [word for step in job.condition for word in ("--condition", step)]
        words += [word for pair in job.record for word in (RECORD_OPTION, *pair.split(WORD_SEPARATOR))]
        say("validate", f"the residual depends on the input; run diagnose: {shlex.join(words)}")
    return code
