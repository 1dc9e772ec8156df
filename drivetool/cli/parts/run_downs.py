"""Run-downs on the command line: `validate` judges models by them, `diagnose` refuses them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.errors import BadOption, BadRecording

if TYPE_CHECKING:
    from drivetool.check.validation import ValidateOptions, Validation
    from drivetool.cli.options import Opened
    from drivetool.drive import Drive
    from drivetool.identify.estimate import Covariance
    from drivetool.logs import Experiment

COAST_DOWN = "coast-down"


def judged_by(opened: Opened, options: ValidateOptions) -> ValidateOptions:
    """The options, with what they leave to the records and the files.

    A file of ratios to the inertia can only be judged by run-downs. A record without a torque is taken for one
    where the files are of coast-downs; otherwise its torque may have been forgotten.

    raises  BadRecording: no torque, and nobody speaks of a coast-down; BadOption: --flux-decay without one
    """
    from drivetool.files.yaml import flux_decay, of_coast_down, only_ratios
    from drivetool.identify.setup import SUPPLY

    files = [source.file for source in opened.loaded.sources]
    silent = next((e for e in opened.experiments if not {"motor_torque", *SUPPLY} & set(e.signals)), None)
    if options.criterion == "simulation":
        if any(map(only_ratios, files)) or (silent and all(map(of_coast_down, files))):
            options = replace(options, criterion="coast-down")
        elif silent:
            raise BadRecording(
                "role motor_torque for the drive's input", f"none in {silent.name}",
                "Name its channel in the channel map; where the drive runs down without torque, say "
                f"--criterion {COAST_DOWN}.", silent.signals)
    if options.criterion != COAST_DOWN:
        if options.flux_decay is not None:
            raise BadOption(f"--criterion {COAST_DOWN} with --flux-decay", f"--criterion {options.criterion}",
                            "Say so, or leave it out.")
        return options
    if options.flux_decay is None:  # what the fits left out is no part of their models
        options = replace(options, flux_decay=max(map(flux_decay, files), default=0.0) or None)
    return options


def with_decay(options: ValidateOptions, drives: Sequence[Drive]) -> ValidateOptions:
    """The options with the time that the flux of a known motor takes, where nobody said one."""
    from drivetool.identify.coast_down import flux_decay

    if options.criterion != COAST_DOWN or options.flux_decay is not None:
        return options
    return replace(options, flux_decay=max(map(flux_decay, drives)))


def on_run_downs(opened: Opened, drives: Sequence[Drive], options: ValidateOptions,
                 fitted_on: Sequence[Sequence[str]], known: Sequence[Covariance | None]) -> Validation:
    """The validation of every file on the run-downs of every record."""
    from drivetool.check.validation import validate_run_down
    from drivetool.files.yaml import run_down_model

    models = [run_down_model(*each) for each in zip(opened.loaded.sources, drives, known, strict=True)]
    return validate_run_down(opened.experiments, models, options, fitted_on)


def refuse_run_downs(experiments: Sequence[Experiment]) -> None:
    """Refuse recordings of which a diagnosis has no torque.

    raises  BadRecording: no torque was logged in one, or zeros alone in all
    """
    silent = [e.name for e in experiments if "motor_torque" not in e.signals]
    zero = [e.name for e in experiments if e.name not in silent and not e.signals["motor_torque"].any()]
    if silent or len(zero) == len(experiments):
        raise BadRecording(
            "a torque that drives, for a diagnosis", f"none in {', '.join(silent)}" if silent else
            f"zeros alone in {', '.join(zero)}",
            "Name its channel in the channel map; where the drive runs down without torque, take steady --method "
            "coast-down, which names the law that its friction lacks.")
