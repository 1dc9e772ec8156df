"""What a validation has to say in words: the findings and the verdict."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from drivetool.check.validation.correlation import ALARM, Correlation
from drivetool.check.validation.result import RecordCheck, ValidateOptions
from drivetool.errors import Finding
from drivetool.identify.estimate import fit_words, rounding_alone
from drivetool.logs import Experiment

BEYOND = 0.1  # of the fitted range, from which a record counts as outside it
CLEAR = 1.05  # ratio of two errors from which one model counts as better; the tables show less as a tie


def of_record(experiment: Experiment, experiments: Sequence[Experiment], fitted_on: Collection[str],
              check: RecordCheck) -> list[Finding]:
    """Whether the fit has seen the record, or anything like it.

    experiments  all recordings; those that the fit has seen show its range
    fitted_on    sha256 of the recordings the fit has seen
    """
    if experiment.sha256 in fitted_on:
        return [Finding(
            "warning", "record-was-used-for-the-fit",
            f"{check.file} was used for the fit of {check.model}: this is no validation.", {},
            "Give a recording that the fit has not seen.")]
    fitted = [e for e in experiments if e.sha256 in fitted_on]
    found = []
    for role in ("motor_torque", "motor_speed"):
        if not fitted or any(role not in e.signals for e in (experiment, *fitted)):
            continue
        low, high = _range([e.signals[role] for e in fitted])
        least, most = _range([experiment.signals[role]])
        if max(low - least, most - high) > BEYOND * (high - low):
            unit = experiment.torque_unit if role.endswith("torque") else f"{experiment.motion_unit}/s"
            found.append(Finding(
                "warning", "outside-the-fitted-range",
                f"In {check.file} the {role.replace('_', ' ')} reaches from {least:.4g} to {most:.4g} "
                f"{unit}; {check.model} was fitted between {low:.4g} and {high:.4g}.",
                {"fitted_low": low, "fitted_high": high, "low": least, "high": most},
                "Fit on a recording with this range too, if the machine works there."))
    return found


def of_check(check: RecordCheck, correlation: Correlation | None, options: ValidateOptions,
             exact: bool = False) -> list[Finding]:
    """Bars that are missed, and what the residual says; exact: that is rounding alone."""
    where, found = _where(check), of_fit(check, options)
    if exact:
        return [*found, rounding_alone(where, check.rmse, check.unit)]
    if correlation is None:
        return [*found, Finding(
            "note", "residual-not-testable",
            f"Whether the residual of {where} depends on the torque cannot be told: the torque never "
            "changes, or there are too few samples.", {}, "Record while the torque changes.")]
    evidence = {"correlation_p": check.correlation_p, "max_correlation": check.max_correlation,
                "lags_outside_percent": check.lags_outside_percent}
    chance = check.correlation_p >= ALARM and correlation.chance > options.max_correlation
    if check.max_correlation > options.max_correlation:
        found.append(Finding(
            "failure", "correlation-above-limit",
            f"The residual of {where} correlates with the torque by {check.max_correlation:.2g}; the limit "
            f"is {options.max_correlation:g}." + (
                " In a record this short chance alone may do that." if chance else ""),
            {**evidence, "limit": options.max_correlation, "chance": correlation.chance},
            "Record longer." if chance else "Run diagnose."))
    if check.correlation_p < ALARM:
        found.append(Finding(
            "warning", "residual-depends-on-input",
            f"What the model leaves over of {where} still depends on the torque: the model lacks something "
            "physical, or a parameter is off.", evidence, "Run diagnose."))
    return found


def depends_on_torque(check: RecordCheck, options: ValidateOptions) -> bool:
    """Whether what is left depends on the torque; what could not be tested does not."""
    return check.max_correlation > options.max_correlation or check.correlation_p < ALARM


def of_fit(check: RecordCheck, options: ValidateOptions,
           less: str = "A free run explains less of") -> list[Finding]:
    """The bar of the fit, or none at all, missed; less: what explains less than a constant."""
    explained, found = _explained(check), []
    if options.min_fit is not None and not check.simulation_fit_percent >= options.min_fit:
        found.append(Finding(
            "failure", "fit-below-minimum",
            f"{explained[0].upper()}{explained[1:]}; {options.min_fit:g} % were asked for.",
            {"simulation_fit_percent": check.simulation_fit_percent, "min_fit": options.min_fit},
            "Look at the pictures (--plot), then run diagnose."))
    if options.min_fit is None and check.simulation_fit_percent < 0.0:
        found.append(Finding(
            "failure", "explains-nothing",
            f"{less} {_where(check)} than a constant does (fit {check.simulation_fit_percent:.4g} %).",
            {"simulation_fit_percent": check.simulation_fit_percent},
            "Run diagnose, or validate on a record with more motion or by shorter free runs: --segment 1."))
    return found


def of_ranking(checks: Sequence[RecordCheck]) -> list[Finding]:
    """Where one model errs least with a fitted start state, and another from the measured one."""
    found = []
    for file, output in dict.fromkeys((c.file, c.output) for c in checks):
        mine = [(c, c.measured_start_rmse) for c in checks
                if (c.file, c.output) == (file, output) and c.measured_start_rmse is not None]
        if not mine:
            continue
        fitted, its = min(mine, key=lambda pair: pair[0].rmse)
        begun, least = min(mine, key=lambda pair: pair[1])
        if begun.rmse > CLEAR * fitted.rmse and its > CLEAR * least:
            found.append(Finding(
                "note", "ranking-depends-on-start",
                f"Of the {output.replace('_', ' ')} in {file}, {fitted.model} errs least with a fitted start state "
                f"and {begun.model} from the measured one.",
                {"fitted_start_rmse": fitted.rmse, "measured_start_rmse": least},
                "Compare by shorter free runs, --segment 1, or state how the recording begins with --start."))
    return found


def verdict(checks: Sequence[RecordCheck], options: ValidateOptions, unseen: bool,
            limited: Collection[RecordCheck] = (), exact: Collection[RecordCheck] = ()) -> str:
    """One sentence for the person who has to trust the model.

    unseen   whether any record is one the fit has not seen
    limited  checks whose fit is as good as the torque noise allows
    exact    checks in which nothing but rounding is left
    """
    missed = [c for c in checks if not c.passed]
    shown = missed or checks
    worst = min(shown, key=lambda c: (np.nan_to_num(c.simulation_fit_percent, nan=-np.inf),
                                      -np.nan_to_num(c.max_correlation)))
    figures = (f"{_explained(worst)} with rmse {worst.rmse:.3g} {worst.unit}" + (
                   ", as much as the torque noise allows" if worst in limited else ""))
    if missed:
        start = f"Not passed: {len(missed)} of {len(checks)} checks miss a bar; worst, {figures}"
        if len(checks) == 1:
            start = f"Not passed: {figures}"
        if worst.max_correlation > options.max_correlation:
            start += (", and what is left follows the torque "
                      f"(correlation {worst.max_correlation:.2g}, limit {options.max_correlation:g})")
    else:
        all_of = f" all {len(checks)} checks; worst, " if len(checks) > 1 else ": "
        start = f"Passed{all_of}{figures}"
        start += "" if options.min_fit is None else f", at least {options.min_fit:g} % asked for"
        left = [c for c in checks if c.correlation_p < ALARM]
        tested = [c for c in checks if np.isfinite(c.correlation_p)]
        if left:
            some = f" in {len(left)} of them" if len(checks) > 1 else ""
            start += f", but what is left still depends on the torque{some}: run diagnose"
        elif len(exact) == len(checks):
            start += ": the model explains everything to rounding"
        elif tested:
            start += ", and nothing in what is left depends on the torque"
    return start + ("." if unseen else "; but the fit has seen every record, so this is no validation.")


def _explained(check: RecordCheck) -> str:
    """A fit in words: below zero, the mean would have been the better guess."""
    where, fit = _where(check), check.simulation_fit_percent
    if np.isnan(fit):
        return f"the simulation's fit of {where} is {fit_words(fit)}"
    share = fit_words(fit) if fit > 0.0 else f"nothing (fit {fit_words(fit)})"
    return f"the simulation explains {share} of {where}"


def _where(check: RecordCheck) -> str:
    return f"the {check.output.replace('_', ' ')} in {check.file} (model {check.model})"


def _range(signals: Sequence[np.ndarray]) -> tuple[float, float]:
    """From the 0.1 % to the 99.9 % quantile: one outlier is no range."""
    values = np.concatenate([s[np.isfinite(s)] for s in signals])
    low, high = np.quantile(values, [0.001, 0.999])
    return float(low), float(high)
