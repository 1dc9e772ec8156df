"""Is a model true on coast-downs its fit has not seen? Validation without any torque."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec import UNSET

from drivetool.check.validation import remarks
from drivetool.check.validation.coast_down_comparison import (
    CoastDownComparison,
    Signal,
    compare_coast_down,
    with_parameter_errors,
)
from drivetool.check.validation.result import ValidateOptions, Validation, named_pairs
from drivetool.check.validation.sections import CheckSection
from drivetool.drive import Drive
from drivetool.errors import BadOption
from drivetool.finding import Finding
from drivetool.identify.coast_down import Stretch, coast_down_assumed, stretches_of
from drivetool.identify.estimate import Covariance, PlotData, fit_percent, fit_text, record_picture
from drivetool.identify.setup import KnownStart
from drivetool.logs import Experiment
from drivetool.quantity import RPM_PER_RAD_S

# Ratio to the rmse of quantisation alone. A uniform error over 1000 samples has an rmse that is known to 1.4 %.
MAX_ERROR_TO_COUNTS = 1.05
PARAMETER_ERROR_STDS = 2.6  # standard deviations by the parameters: one normal error in a hundred is larger


@dataclass(frozen=True)
class CoastDownModel:
    """A model of a parameter file.

    name     of the file
    drive    with values for a simulation
    ratios   whether the file has ratios to the inertia alone, so that the inertia of `drive` is arbitrary
    encoder  standard deviation of the encoder's error beyond quantisation, by the fit
    spread   covariance of parameters of `drive`; None: not known, which counts as exact
    """

    name: str
    drive: Drive
    ratios: bool = False
    encoder: float = 0.0
    spread: Covariance | None = None


def validate_coast_down(experiments: Sequence[Experiment], models: Sequence[CoastDownModel],
                        options: ValidateOptions,
                        fitted_on: Sequence[Iterable[str]] = ()) -> Validation:
    """Every model on the coast-downs of every record: errors of the angle, in counts too, and of the speed.

    A coast-down depends on ratios to the inertia alone, so that a model of ratios is simulated with any inertia.

    experiments  motor_angle or motor_speed; motor_torque where it was logged
    models       one per parameter file
    options      min_fit, flux_decay
    fitted_on    per model, the sha256 of the recordings its fit has seen
    returns      Validation; per model and record a check of motor_angle, where it was measured, and of motor_speed
    raises       NotEnoughData: no coast-down without torque; BadRecording: too few counts; BadOption: a start
                 state or segments
    source       "Mechanical Parameter Estimation of an Induction Motor for a Digital Twin Using Coast-Down Data"
    """
    files, named = named_pairs(experiments, [m.name for m in models], fitted_on)
    if options.start != KnownStart() or options.segment:
        raise BadOption("no --start and no --segment with a coast-down", "one of them",
                        "Leave it out: the start of every coast-down is fitted.")
    off = [[s for s in stretches_of([e], options.flux_decay or 0.0) if s.off] for e in experiments]
    checks: list[CheckSection] = []
    findings: list[Finding] = []
    exhibits: list[PlotData] = []
    for (name, hashes), model in zip(named, models, strict=True):
        model.drive.require(model.drive.missing(), "a simulation")
        findings += _ratios_finding(name) if model.ratios else []
        for file, e, stretches in zip(files, experiments, off, strict=True):
            runs = [_compared(e, s, model) for s in stretches]
            mine = _checks(name, file, e, runs, options)
            checks += mine
            findings += remarks.record_findings(e, experiments, hashes, mine[0])
            for check in mine:
                findings += [*remarks.fit_findings(check, options), *_unexplained_findings(check)]
            exhibits.append(_plot(e, runs, mine[-1]))
    findings += coast_down_assumed(experiments)
    unseen = any(e.sha256 not in hashes for _, hashes in named for e in experiments)
    return Validation(tuple(checks), _verdict(checks, unseen), tuple(findings),
                      tuple(e.source for e in experiments), {}, tuple(exhibits))


def _compared(e: Experiment, stretch: Stretch, model: CoastDownModel) -> CoastDownComparison:
    """A coast-down with the model's, and its error by the uncertainty of the model."""
    run = compare_coast_down(e, stretch, model.drive, model.encoder)
    return run if model.spread is None else with_parameter_errors(e, stretch, model.drive, run, model.spread)


def _checks(name: str, file: str, e: Experiment, runs: Sequence[CoastDownComparison],
            options: ValidateOptions) -> list[CheckSection]:
    """Of the angle, where it was measured, and of the speed; all coast-downs of a record together."""
    speed = _check(name, file, "motor_speed", f"{e.motion_unit}/s", [r.speed for r in runs], options)
    angles = [r.angle for r in runs if r.angle is not None]
    if not angles:
        return [speed]
    return [_check(name, file, "motor_angle", e.motion_unit, [_centred(a) for a in angles], options), speed]


def _centred(angle: Signal) -> Signal:
    """About its mean: the angle at which another coast-down begins is no part of the motion."""
    mean = np.nanmean(angle.measured)
    return replace(angle, measured=angle.measured - mean, simulated=angle.simulated - mean,
                   from_beginning=angle.from_beginning - mean)


def _check(name: str, file: str, output: str, unit: str, signals: Sequence[Signal],
           options: ValidateOptions) -> CheckSection:
    """The figures of one output."""
    y, simulated, from_beginning = (np.concatenate([getattr(s, part) for s in signals])
                                    for part in ("measured", "simulated", "from_beginning"))
    known = np.isfinite(y)
    y, simulated, from_beginning = y[known], simulated[known], from_beginning[known]
    fit, rmse, nan = fit_percent(y, simulated), _rms(y - simulated), float("nan")
    value_range, total = float(np.ptp(y)), float(np.sum((y - y.mean()) ** 2))
    count, parameter_errors = (max(s.count for s in signals),
                               [s.parameters_rms for s in signals if s.parameters_rms is not None])
    return CheckSection(
        name, file, output, unit, fit, None, rmse, rmse / value_range if value_range else nan,
        1.0 - rmse**2 * len(y) / total if value_range and total else nan, len(y), nan, nan, nan, nan, None,
        not fit < 0.0 if options.min_fit is None else fit >= options.min_fit,
        fit_percent(y, from_beginning), _rms(y - from_beginning),
        rmse_counts=float(rmse * np.sqrt(12.0) / count) if count else UNSET,
        nrmse_mean=rmse / abs(float(np.mean(y))) if output == "motor_speed" else UNSET,
        sensor_rmse=_rms(np.array([s.sensor for s in signals])),
        parameters_rmse=_rms(np.array(parameter_errors)) if parameter_errors else UNSET)


def _rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _ratios_finding(name: str) -> list[Finding]:
    """That no inertia is known, and none is needed."""
    return [Finding(
        "note", "ratios-only", f"{name} states only ratios to the inertia. It is simulated with an inertia "
        "of one, on which no coast-down depends; these figures do not test an inertia.", {},
        "To validate on a record with torque, fit a coast-down with a known scale.")]


def _unexplained_findings(check: CheckSection) -> list[Finding]:
    """A quantised angle whose error exceeds quantisation; the noise of another sensor need not be white."""
    if check.rmse_counts is UNSET or not check.sensor_rmse:
        return []
    if check.rmse <= np.hypot(
            MAX_ERROR_TO_COUNTS * check.sensor_rmse, PARAMETER_ERROR_STDS * (check.parameters_rmse or 0.0)):
        return []
    times = check.rmse / check.sensor_rmse
    return [Finding(
        "warning", "coast-down-not-explained", f"The simulated angle in {check.file} (model {check.model}) has an "
        f"rms error of {check.rmse:.3g} {check.unit}, {times:.4g} times that of quantisation alone. It exceeds "
        "what the uncertainty of the model explains: the friction differs from that of the model.",
        {"rmse": check.rmse, "rmse_counts": check.rmse_counts, "times": times,
         **({} if check.parameters_rmse is UNSET else {"parameters_rmse": check.parameters_rmse})},
        "Fit this record too (steady --method coast-down): that fit decides between a changed "
        "friction (scatter-beyond-noise) and another friction law (nonlinear-friction).")]


def _plot(e: Experiment, runs: Sequence[CoastDownComparison], check: CheckSection) -> PlotData:
    """Measured and simulated speed, and the error."""
    time = np.concatenate([r.time for r in runs])
    y, s = (np.concatenate([getattr(r.speed, part) for r in runs]) for part in ("measured", "simulated"))
    return record_picture(
        f"{check.file}, model {check.model}: coast-down, fit {fit_text(check.simulation_fit_percent, '.4f')}",
        f"motor speed [{check.unit}]", time, y, s)


def _verdict(checks: Sequence[CheckSection], unseen: bool) -> str:
    """One sentence about all, with the figures of the worst record."""
    missed = [c for c in checks if not c.passed]
    speeds = [c for c in checks if c.output == "motor_speed"]
    records = {(c.model, c.file) for c in missed} or {(c.model, c.file) for c in checks}
    worst = max((c for c in speeds if (c.model, c.file) in records), key=lambda c: float(c.rmse))
    angle = next((c for c in checks if (c.model, c.file) == (worst.model, worst.file) and c is not worst), None)
    figures = f"{worst.file} (model {worst.model}): "
    if angle is not None:
        counts = angle.rmse_counts
        in_counts = "" if counts is UNSET else f", {counts:{'.3f' if counts < 10.0 else '.4g'}} count/sqrt(12)"
        figures += f"angle rmse {angle.rmse:.3g} {angle.unit}{in_counts}; "
    rpm = f" ({worst.rmse * RPM_PER_RAD_S:.3g} rpm)" if worst.unit == "rad/s" else ""
    figures += (f"speed rmse {worst.rmse:.3g} {worst.unit}{rpm}, {100.0 * worst.nrmse:.2g} % of the range and "
                f"{100.0 * (worst.nrmse_mean or np.nan):.2g} % of the mean, R2 {worst.r2:.6f}")
    start = f"Not passed: {len(missed)} of {len(checks)} checks miss their limit; worst: " if missed else (
        "Passed: " if len(speeds) == 1 else f"Passed on all {len(speeds)} records; worst: ")
    differing = {c.file for c in checks if _unexplained_findings(c)}
    figures += (f", but the friction of {', '.join(sorted(differing))} differs from that of the model"
                if differing else "")
    return start + figures + (
        "." if unseen else "; but every record was used for the fit, so this is not a validation.")
