"""The text of a validation: the findings and the verdict."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from msgspec import UNSET

from drivetool.check.validation.correlation import DEPENDENCE_SIGNIFICANCE, Correlation
from drivetool.check.validation.result import ValidateOptions
from drivetool.check.validation.sections import CheckSection
from drivetool.finding import Finding
from drivetool.identify.estimate import fit_text, rounding_finding
from drivetool.logs import Experiment

# Of the fitted range, from which a record counts as outside it. A choice: noise extends a range a little.
MAX_EXTRAPOLATION = 0.1
CLEAR_RMSE_RATIO = 1.05  # ratio of two errors from which one model counts as better; the tables show less as a tie


def record_findings(experiment: Experiment, experiments: Sequence[Experiment], fitted_on: Collection[str],
              check: CheckSection) -> list[Finding]:
    """Whether the fit has seen the record, or anything like it.

    experiments  all recordings; those that the fit has seen show its range
    fitted_on    sha256 of the recordings the fit has seen
    """
    if experiment.sha256 in fitted_on:
        return [Finding(
            "warning", "not-held-out",
            f"{check.file} was used for the fit of {check.model}; this is not a validation.", {},
            "Validate on a recording that was not fitted.")]
    fitted = [e for e in experiments if e.sha256 in fitted_on]
    found = []
    for role in ("motor_torque", "motor_speed"):
        if not fitted or any(role not in e.signals for e in (experiment, *fitted)):
            continue
        low, high = _value_range([e.signals[role] for e in fitted])
        lowest, highest = _value_range([experiment.signals[role]])
        if max(low - lowest, highest - high) > MAX_EXTRAPOLATION * (high - low):
            unit = experiment.torque_unit if role.endswith("torque") else f"{experiment.motion_unit}/s"
            found.append(Finding(
                "warning", "extrapolation",
                f"In {check.file} the {role.replace('_', ' ')} reaches from {lowest:.4g} to {highest:.4g} "
                f"{unit}; {check.model} was fitted between {low:.4g} and {high:.4g}.",
                {"fitted_low": low, "fitted_high": high, "low": lowest, "high": highest},
                "Fit on a recording with this range too, if the machine works there."))
    return found


def residual_findings(check: CheckSection, correlation: Correlation | None, options: ValidateOptions,
             exact: bool = False) -> list[Finding]:
    """Limits that are missed, and the test of the residual; exact: that is rounding alone."""
    where, found = _output_text(check), fit_findings(check, options)
    if exact:
        return [*found, rounding_finding(where, check.rmse, check.unit)]
    if correlation is None:
        return [*found, Finding(
            "note", "residual-not-testable",
            f"Whether the residual of {where} depends on the torque cannot be tested: the torque never "
            "changes, or there are too few samples.", {}, "Record while the torque changes.")]
    evidence = {"correlation_p": check.correlation_p, "max_correlation": check.max_correlation,
                "lags_outside_percent": check.lags_outside_percent}
    chance = check.correlation_p >= DEPENDENCE_SIGNIFICANCE and correlation.chance > options.max_correlation
    if check.max_correlation > options.max_correlation:
        found.append(Finding(
            "failure", "limit-missed",
            f"The residual of {where} has a correlation of {check.max_correlation:.2g} with the torque; the limit "
            f"is {options.max_correlation:g}." + (
                " In such a short record this can occur by chance." if chance else ""),
            {**evidence, "limit": options.max_correlation, "chance": correlation.chance},
            "Record longer." if chance else "Run diagnose."))
    if check.correlation_p < DEPENDENCE_SIGNIFICANCE:
        found.append(Finding(
            "warning", "residual-depends-on-input",
            f"The residual of {where} still depends on the torque: the model lacks something "
            "physical, or a parameter is wrong.", evidence, "Run diagnose."))
    return found


def depends_on_torque(check: CheckSection, options: ValidateOptions) -> bool:
    """Whether the residual depends on the torque; one that could not be tested does not."""
    return check.max_correlation > options.max_correlation or check.correlation_p < DEPENDENCE_SIGNIFICANCE


def fit_findings(check: CheckSection, options: ValidateOptions,
           subject: str = "A free run fits") -> list[Finding]:
    """A fit below its limit, or without a limit below zero; subject: of "fits worse than its mean"."""
    explained, found = _fit_text(check), []
    if options.min_fit is not None and not check.simulation_fit_percent >= options.min_fit:
        found.append(Finding(
            "failure", "limit-missed",
            f"{explained[0].upper()}{explained[1:]}; the required fit is {options.min_fit:g} %.",
            {"simulation_fit_percent": check.simulation_fit_percent, "min_fit": options.min_fit},
            "Look at the pictures (--plot), then run diagnose."))
    if options.min_fit is None and check.simulation_fit_percent < 0.0:
        found.append(Finding(
            "failure", "explains-nothing",
            f"{subject} {_output_text(check)} worse than its mean does (fit {check.simulation_fit_percent:.4g} %).",
            {"simulation_fit_percent": check.simulation_fit_percent},
            "Run diagnose, or validate on a record with more motion or by shorter free runs: --segment 1."))
    return found


def ranking_findings(checks: Sequence[CheckSection]) -> list[Finding]:
    """A finding where the model with the smallest error depends on the start state: fitted or measured."""
    found = []
    for file, output in dict.fromkeys((c.file, c.output) for c in checks):
        mine = [(c, c.measured_start_rmse) for c in checks
                if (c.file, c.output) == (file, output) and c.measured_start_rmse is not None]
        if not mine:
            continue
        fitted, measured_rmse = min(mine, key=lambda pair: float(pair[0].rmse))
        from_measured, least = min(mine, key=lambda pair: pair[1])
        if from_measured.rmse > CLEAR_RMSE_RATIO * fitted.rmse and measured_rmse > CLEAR_RMSE_RATIO * least:
            found.append(Finding(
                "note", "ranking-depends-on-start",
                f"For the {output.replace('_', ' ')} in {file}, {fitted.model} has the smallest error with a "
                f"fitted start state and {from_measured.model} with the measured one.",
                {"fitted_start_rmse": fitted.rmse, "measured_start_rmse": least},
                "Compare by shorter free runs, --segment 1, or state how the recording begins with --start."))
    return found


def verdict(checks: Sequence[CheckSection], options: ValidateOptions, unseen: bool,
            limited: Collection[CheckSection] = (), exact: Collection[CheckSection] = ()) -> str:
    """One sentence about the validation.

    unseen   whether any record is one the fit has not seen
    limited  checks whose fit is as good as the torque noise allows
    exact    checks whose residual is rounding alone
    """
    missed = [c for c in checks if not c.passed]
    reported = missed or checks
    worst = min(reported, key=lambda c: (np.nan_to_num(c.simulation_fit_percent, nan=-np.inf),
                                      -np.nan_to_num(c.max_correlation)))
    figures = (f"{_fit_text(worst)} with rmse {worst.rmse:.3g} {worst.unit}" + (
                   " (limited by the torque noise)" if worst in limited else ""))
    if missed:
        start = f"Not passed: {len(missed)} of {len(checks)} checks miss their limit; worst: {figures}"
        if len(checks) == 1:
            start = f"Not passed: {figures}"
        if worst.max_correlation > options.max_correlation:
            start += (", and the residual correlates with the torque "
                      f"(correlation {worst.max_correlation:.2g}, limit {options.max_correlation:g})")
    else:
        all_of = f" all {len(checks)} checks; worst: " if len(checks) > 1 else ": "
        start = f"Passed{all_of}{figures}"
        start += "" if options.min_fit is None else f", at least {options.min_fit:g} % required"
        dependent = [c for c in checks if c.correlation_p < DEPENDENCE_SIGNIFICANCE]
        tested = [c for c in checks if np.isfinite(c.correlation_p)]
        if dependent:
            some = f" in {len(dependent)} of them" if len(checks) > 1 else ""
            start += f", but the residual still depends on the torque{some}: run diagnose"
        elif len(exact) == len(checks):
            start += ": the residual is at rounding level"
        elif tested:
            start += ", and the residual does not depend on the torque"
    return start + ("." if unseen else "; but every record was used for the fit, so this is not a validation.")


def _fit_text(check: CheckSection) -> str:
    """A fit in words: below zero, a constant would explain more."""
    where, fit = _output_text(check), check.simulation_fit_percent
    if np.isnan(fit):
        return f"the simulation's fit of {where} is {fit_text(fit)}"
    share = fit_text(fit) if fit > 0.0 else f"nothing (fit {fit_text(fit)})"
    runs = "" if check.free_run_length is UNSET else (
        f" in free runs of {check.free_run_length:.2g} s, as long as noise across the gap allows,")
    return f"the simulation explains {share} of {where}{runs}"


def _output_text(check: CheckSection) -> str:
    return f"the {check.output.replace('_', ' ')} in {check.file} (model {check.model})"


def _value_range(signals: Sequence[np.ndarray]) -> tuple[float, float]:
    """From the 0.1 % to the 99.9 % quantile: one outlier does not extend the range."""
    values = np.concatenate([s[np.isfinite(s)] for s in signals])
    low, high = np.quantile(values, [0.001, 0.999])
    return float(low), float(high)
