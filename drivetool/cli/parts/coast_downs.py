"""Coast-downs on the command line: `validate` tests models on them, `diagnose` refuses them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.check.validation import ValidateOptions, Validation, validate_coast_down
from drivetool.cli.options import Opened
from drivetool.drive import Drive
from drivetool.errors import BadOption, BadRecording
from drivetool.files.yaml import coast_down_model, fitted_flux_decay, has_only_ratios, is_coast_down_file
from drivetool.identify.coast_down import flux_decay
from drivetool.identify.estimate import Covariance
from drivetool.identify.setup import SUPPLY_ROLES
from drivetool.logs import Experiment

COAST_DOWN = "coast-down"


def with_coast_down_criterion(opened: Opened, options: ValidateOptions) -> ValidateOptions:
    """The options, completed from the records and the files.

    A file of ratios to the inertia can only be tested on coast-downs. A record without a torque is taken for one
    where the files are of coast-downs; otherwise its torque may have been forgotten.

    raises  BadRecording: no torque, and neither option nor files state a coast-down; BadOption: --flux-decay
            without one
    """
    files = [source.file for source in opened.loaded.sources]
    without_torque = next((e for e in opened.experiments if not {"motor_torque", *SUPPLY_ROLES} & set(e.signals)),
                          None)
    if options.criterion == "simulation":
        if any(map(has_only_ratios, files)) or (without_torque and all(map(is_coast_down_file, files))):
            options = replace(options, criterion="coast-down")
        elif without_torque:
            raise BadRecording(
                "role motor_torque for the drive's input", f"none in {without_torque.name}",
                "Name its channel in the channel map; where the drive coasts down without torque, give "
                f"--criterion {COAST_DOWN}.", without_torque.signals)
    if options.criterion != COAST_DOWN:
        if options.flux_decay is not None:
            raise BadOption(f"--criterion {COAST_DOWN} with --flux-decay", f"--criterion {options.criterion}",
                            f"Give --criterion {COAST_DOWN}, or leave out --flux-decay.")
        return options
    if options.flux_decay is None:  # the models do not cover what the fits left out
        options = replace(options, flux_decay=max(map(fitted_flux_decay, files), default=0.0) or None)
    return options


def with_flux_decay(options: ValidateOptions, drives: Sequence[Drive]) -> ValidateOptions:
    """The options with the flux decay time of a known motor, where the command line gives none."""
    if options.criterion != COAST_DOWN or options.flux_decay is not None:
        return options
    return replace(options, flux_decay=max(map(flux_decay, drives)))


def validate_coast_downs(opened: Opened, drives: Sequence[Drive], options: ValidateOptions,
                         fitted_on: Sequence[Sequence[str]], known: Sequence[Covariance | None]) -> Validation:
    """The validation of every file on the coast-downs of every record."""
    models = [coast_down_model(*each) for each in zip(opened.loaded.sources, drives, known, strict=True)]
    return validate_coast_down(opened.experiments, models, options, fitted_on)


def refuse_coast_downs(experiments: Sequence[Experiment]) -> None:
    """Refuse recordings without a driving torque, which a diagnosis needs.

    raises  BadRecording: no torque was logged in one, or only zeros in all
    """
    without_torque = [e.name for e in experiments if "motor_torque" not in e.signals]
    zero_torque = [e.name for e in experiments
                   if e.name not in without_torque and not e.signals["motor_torque"].any()]
    if without_torque or len(zero_torque) == len(experiments):
        raise BadRecording(
            "a non-zero motor torque, for a diagnosis",
            f"none in {', '.join(without_torque)}" if without_torque else
            f"only zeros in {', '.join(zero_torque)}",
            "Name its channel in the channel map; where the drive coasts down without torque, use steady --method "
            "coast-down, which identifies the missing friction law.")
