"""`validate` on run-downs: records without a torque, models that may have ratios alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.errors import BadOption

if TYPE_CHECKING:
    from drivetool.check.validation.result import ValidateOptions, Validation
    from drivetool.cli.inputs import Opened
    from drivetool.drive.chain import Drive

COAST_DOWN = "coast-down"


def judged_by(opened: Opened, options: ValidateOptions) -> ValidateOptions:
    """The options, with what they leave to the records and the files.

    A record without a torque channel, and a file of ratios to the inertia, can only be judged by running down.
    """
    from drivetool.files.ratios import flux_decay, only_ratios

    files = [source.file for source in opened.loaded.sources]
    told = any("motor_torque" not in e.signals for e in opened.experiments) or any(map(only_ratios, files))
    if options.criterion == "simulation" and told:
        options = replace(options, criterion="coast-down")
    if options.criterion != COAST_DOWN:
        if options.flux_decay is not None:
            raise BadOption(f"--criterion {COAST_DOWN} with --flux-decay", f"--criterion {options.criterion}",
                            "Say so, or leave it out.")
        return options
    if options.flux_decay is None:  # what the fits left out is no part of their models
        options = replace(options, flux_decay=max(map(flux_decay, files), default=0.0))
    return options


def on_run_downs(opened: Opened, drives: Sequence[Drive], options: ValidateOptions,
                 fitted_on: Sequence[Sequence[str]]) -> Validation:
    """The validation of every file on the run-downs of every record."""
    from drivetool.check.validation.validate_run_down import validate_run_down
    from drivetool.files.ratios import run_down_model

    models = [run_down_model(source, drive) for source, drive in zip(opened.loaded.sources, drives, strict=True)]
    return validate_run_down(opened.experiments, models, options, fitted_on)
