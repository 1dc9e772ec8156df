"""Does the motion of a record require the torque that was logged? Validation by inverse dynamics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from drivetool.check.validation import remarks
from drivetool.check.validation.result import ValidateOptions, Validation, named_pairs
from drivetool.check.validation.sections import CheckSection
from drivetool.drive import Drive
from drivetool.errors import BadOption, NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.estimate import PlotData, fit_text
from drivetool.identify.inverse import regression_of
from drivetool.identify.motion import check_no_signal_path, torque_fit, torque_picture
from drivetool.identify.setup import KnownStart, roles_of
from drivetool.logs import Experiment


def validate_torque(experiments: Sequence[Experiment], models: Sequence[tuple[str, Drive]],
                    options: ValidateOptions, fitted_on: Sequence[Iterable[str]] = ()) -> Validation:
    """Every model on every record: the required torque against the logged one.

    experiments  motor_torque, and the motor's speed or angle
    models       (name, drive) each
    options      min_fit
    fitted_on    per model, the sha256 of the recordings its fit has seen
    returns      Validation; one check per model and record, of motor_torque over what the filter lets pass
    raises       BadOption: a path between torque and body, a start state or segments
    source       Gautier, Janot and Vandanjon 2013, cross validation of inverse dynamics
    """
    files, named = named_pairs(experiments, [name for name, _ in models], fitted_on)
    if options.start != KnownStart() or options.segment:
        raise BadOption("free runs for --start and --segment", "--criterion inverse, which simulates no free runs",
                        "Leave them out, or --criterion.")
    checks: list[CheckSection] = []
    findings: list[Finding] = []
    exhibits: list[PlotData] = []
    for (name, hashes), (_, drive) in zip(named, models, strict=True):
        drive.require(drive.missing(), "the torque that a motion requires")
        check_no_signal_path(drive, ())
        for file, e in zip(files, experiments, strict=True):
            check, picture = _check_record(name, file, e, drive, options)
            checks.append(check)
            exhibits.append(picture)
            findings += remarks.record_findings(e, experiments, hashes, check)
            findings += remarks.fit_findings(check, options, "The required torque fits")
    unseen = any(e.sha256 not in hashes for _, hashes in named for e in experiments)
    return Validation(tuple(checks), _verdict(checks, unseen), tuple(findings),
                      tuple(e.source for e in experiments), {}, tuple(exhibits))


def _check_record(name: str, file: str, e: Experiment, drive: Drive,
             options: ValidateOptions) -> tuple[CheckSection, PlotData]:
    roles = roles_of([e], drive)
    q = regression_of([e], drive, (), roles.outputs[0], roles.inputs[1:]).with_motion()[0]
    if not q.used.any():
        raise NotEnoughData("samples in which the motor moves", f"none in {e.name}",
                            "Record while the motor moves.")
    f, nan, value_range = torque_fit([q]), float("nan"), float(np.ptp(q.torque[q.used]))
    check = CheckSection(
        name, file, "motor_torque", e.torque_unit, f.fit_percent, None, f.rmse,
        f.rmse / value_range if value_range else nan, 1.0 - f.over_sd**2, f.n, nan, nan, nan, nan, None,
        f.fit_percent >= (0.0 if options.min_fit is None else options.min_fit),  # a constant torque has no fit
        rmse_percent=100.0 * f.over_rms)
    title = f"{file}, model {name}: torque required by the motion, fit {fit_text(f.fit_percent, '.1f')}"
    return check, torque_picture(e, {"": q}, title)


def _verdict(checks: Sequence[CheckSection], unseen: bool) -> str:
    missed = [c for c in checks if not c.passed]
    worst = min(missed or checks, key=lambda c: np.nan_to_num(c.simulation_fit_percent, nan=-np.inf))
    share = fit_text(worst.simulation_fit_percent)
    figures = (f"the required torque in {worst.file} explains {share} of the logged torque (model {worst.model}) "
               f"with an rms error of {worst.rmse:.3g} {worst.unit}, {worst.rmse_percent:.3g} % of its rms")
    start = f"Not passed: {len(missed)} of {len(checks)} checks miss their limit; worst: " if missed else (
        "Passed: " if len(checks) == 1 else f"Passed all {len(checks)} checks; worst: ")
    return start + figures + (
        "." if unseen else "; but every record was used for the fit, so this is not a validation.")
