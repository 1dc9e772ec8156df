"""Is a model true on records its fit has not seen?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from msgspec import UNSET

from drivetool.check.validation import remarks
from drivetool.check.validation.correlation import Correlation, correlate, whiteness
from drivetool.check.validation.freerun import drift_findings, low_fit_findings, noise_limit_findings
from drivetool.check.validation.replay import Replay, replay, resonances, start_state_findings
from drivetool.check.validation.result import ValidateOptions, Validation, named_pairs
from drivetool.check.validation.sections import CheckSection
from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance, PlotData, fit_percent, fit_text, only_rounding, record_picture
from drivetool.logs import Experiment

SimulatedModel = tuple[str, Drive, Mapping[str, float]]


def validate(experiments: Sequence[Experiment], models: Sequence[SimulatedModel], options: ValidateOptions,
             fitted_on: Sequence[Iterable[str]] = (), known: Sequence[Covariance | None] = ()) -> Validation:
    """Every model on every record: simulation, one-step prediction, residual.

    experiments  motor torque and any sensors; the start states of the free runs are fitted to
                 the motor's speed, or else angle, so that the other sensors stay unseen; in addition there are
                 free runs of the whole stretches from the state measured by the first samples
    models       (name, drive, noise of its file) each
    options      limits, length of the free runs, seed, what is known of the start
    fitted_on    per model, the sha256 of the recordings its fit has seen
    known        per model, the covariance of its parameters: the uncertainty of its fit
    returns      Validation; one check per model, record and measured output
    raises       BadParameters: a model that cannot be simulated; BadRecording, BadOption: see replay
    source       fit: Ostring et al. 2003; residual against input: Ljung 1999, sec. 16.6, and
                 correlation.py
    """
    files, named = named_pairs(experiments, [name for name, *_ in models], fitted_on)
    for _, drive, _ in models:
        drive.require(drive.missing(), "a simulation")
    checks: list[CheckSection] = []
    findings: list[Finding] = []
    limited: list[CheckSection] = []
    to_rounding: list[CheckSection] = []
    exhibits: list[PlotData] = []
    for (name, hashes), (_, drive, noise), covariance in zip(
            named, models, known or [None] * len(models), strict=True):
        for file, experiment in zip(files, experiments, strict=True):
            run = replay(experiment, drive, noise, options.segment, options.start, covariance)
            rounded = [only_rounding(run.measured[:, m], run.simulated[:, m], run.inputs)
                       for m in range(len(run.outputs))]
            found = [None if exact else _correlation(run, m, experiment, drive, options.seed)
                     for m, exact in enumerate(rounded)]
            mine = [_check(name, file, experiment, run, m, c, options) for m, c in enumerate(found)]
            sensor_std = noise.get(f"sensor_std.{run.outputs[0]}", 0.0)
            low = low_fit_findings(run, mine[0], options, sensor_std, covariance)
            mine[0] = mine[0].replace(passed=mine[0].passed and not low)
            checks += mine
            to_rounding += [check for check, exact in zip(mine, rounded, strict=True) if exact]
            findings += start_state_findings(drive, run)
            findings += remarks.record_findings(experiment, experiments, hashes, mine[0])
            findings += [] if run.segment else drift_findings(experiment, drive, run, mine[0])
            note = noise_limit_findings(run, mine[0], options.max_correlation, options.seed)
            findings += [*note, *low]
            limited += mine[:1] if note else []
            for m, (check, correlation) in enumerate(zip(mine, found, strict=True)):
                findings += remarks.residual_findings(check, correlation, options, check in to_rounding)
                exhibits += _plots(experiment, run, m, check, correlation, options)
    findings += remarks.ranking_findings(checks)
    unseen = [e.sha256 not in hashes for _, hashes in named for e in experiments]
    return Validation(
        tuple(checks), remarks.verdict(checks, options, any(unseen), limited, to_rounding), tuple(findings),
        tuple(e.source for e in experiments), {}, tuple(exhibits),
        any(remarks.depends_on_torque(check, options) for check in checks))


def _correlation(run: Replay, m: int, experiment: Experiment, drive: Drive, seed: int) -> Correlation | None:
    return correlate(run.stretches(run.innovations[:, m]), run.stretches(run.inputs), experiment.step,
                     resonances(drive, experiment.step), seed)


def _check(name: str, file: str, experiment: Experiment, run: Replay, m: int,
           correlation: Correlation | None, options: ValidateOptions) -> CheckSection:
    """The figures of one output."""
    y, simulated = run.measured[:, m], run.simulated[:, m]
    known = np.isfinite(y)
    y, e = y[known], (y - simulated)[known]
    rmse = float(np.sqrt(np.mean(e**2)))
    fit = fit_percent(y, y - e)
    one_step = fit_percent(run.measured[:, m], run.predicted[:, m])
    largest = np.nan if correlation is None else correlation.largest
    value_range, total = float(np.ptp(y)), float(np.sum((y - y.mean()) ** 2))
    return CheckSection(
        name, file, run.outputs[m], experiment.unit(run.outputs[m]), fit, one_step, rmse,
        rmse / value_range if value_range else np.nan,
        1.0 - float(e @ e) / total if value_range and total else np.nan, int(known.sum()), largest,
        np.nan if correlation is None else float(correlation.band.max()),
        np.nan if correlation is None else 100.0 * correlation.outside,
        np.nan if correlation is None else correlation.p, whiteness(run.stretches(run.innovations[:, m])),
        _meets_min_fit(fit, options) and not largest > options.max_correlation,
        *_from_measured(run, m), free_run_length=run.segment if run.segment > options.segment else UNSET)


def _from_measured(run: Replay, m: int) -> tuple[float | None, float | None]:
    """(fit [%], rmse) of the free runs from the measured start; None for segments, which begin in any motion."""
    if run.segment:
        return None, None
    y, simulated = run.measured[:, m], run.from_measured[:, m]
    return fit_percent(y, simulated), float(np.sqrt(np.nanmean((y - simulated) ** 2)))


def _meets_min_fit(fit: float, options: ValidateOptions) -> bool:
    """Whether the fit meets its limit; a fit that is NaN does not, where a limit was requested."""
    return not fit < 0.0 if options.min_fit is None else fit >= options.min_fit


def _plots(experiment: Experiment, run: Replay, m: int, check: CheckSection,
              correlation: Correlation | None, options: ValidateOptions) -> list[PlotData]:
    """Measured and simulated, and the correlation with its bands."""
    label, which = check.output.replace("_", " "), f"{check.file}, model {check.model}"
    runs = f"free runs of {run.segment:g} s" if run.segment else "free run"
    found = [record_picture(
        f"{which}: {runs}, fit {fit_text(check.simulation_fit_percent, '.1f')}", f"{label} [{check.unit}]",
        experiment.time[run.index], run.measured[:, m], run.simulated[:, m],
        {f"torque [{experiment.torque_unit}]": run.inputs[:, 0]})]
    if correlation is None:
        return found
    size = correlation.band.shape[1]
    after = correlation.lags[-size:]
    return [*found, PlotData(
        "correlation", f"{which}: residual and torque, p {check.correlation_p:.2g}",
        "lag [s]; left of zero only feedback, not judged", f"correlation with {label} residual", {
            "residual with torque": (correlation.lags, correlation.r[0]),
            "band 97 % for one lag": (after, correlation.band[0]),
            f"limit {options.max_correlation:g}": (after, np.full(size, options.max_correlation))})]
