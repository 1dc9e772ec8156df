"""What limits a free run: a drift, or torque noise that decides when a gap closes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.check.validation.correlation import DEPENDENCE_SIGNIFICANCE
from drivetool.check.validation.replay import FREE_RUN_DRAWS, MIN_ATTAINABLE_FIT, Replay
from drivetool.check.validation.result import ValidateOptions
from drivetool.check.validation.sections import CheckSection
from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance
from drivetool.identify.fit import UNEXPLAINED_RUN_DRAWS, attainable_fits, unexplained_free_run
from drivetool.identify.laws import MIN_EXPLAINED_FIT
from drivetool.identify.setup import Roles
from drivetool.logs import Experiment

# Standard deviations of the drift that noise causes: 6 false alarms in 100 000 normal ones.
DRIFT_SIGNIFICANCE = 4.0


def drift_findings(experiment: Experiment, drive: Drive, run: Replay, check: CheckSection) -> list[Finding]:
    """A free run of a speed whose error is mostly a ramp, steeper than noise explains.

    run, check  of whole stretches, not segments; the first output
    """
    if not check.output.endswith("speed"):
        return []
    inertia = drive.referred_inertia
    for e in run.stretches(run.measured[:, 0] - run.simulated[:, 0]):
        good = np.isfinite(e)
        t, e = np.arange(len(e))[good] * experiment.step, e[good]
        if len(e) < 50 or np.var(e) == 0.0:
            continue
        slope, level = np.polyfit(t, e, 1)
        share = 1.0 - np.var(e - slope * t - level) / np.var(e)
        torque, time = float(-slope * inertia), float(np.ptp(t))
        if share > 0.5 and abs(torque) > DRIFT_SIGNIFICANCE * _drift_torque_std(run, inertia, len(e), time):
            return [Finding(
                "warning", "simulation-drifts",
                f"In a free run by {check.model} the {check.output.replace('_', ' ')} of {check.file} drifts "
                f"away by {abs(slope) * time:.3g} {check.unit} in {time:.3g} s. An idle torque that is "
                f"{abs(torque):.2g} {experiment.torque_unit} too {'low' if torque > 0.0 else 'high'} explains "
                "this; so does a wrong inertia if the torque does not change sign.",
                {"drift": float(slope) * time, "torque": torque, "share_of_residual": float(share)},
                "Check friction and idle torque (steady), and whether the load was the same as in the fitted "
                "recording.")]
    return []


def noise_limit_findings(run: Replay, check: CheckSection, limit: float, seed: int) -> list[Finding]:
    """How well the model would follow its own motion under other torque noise.

    A little noise decides when backlash closes: a long free run of a true model then diverges from the
    motion, and its fit says little about the model. Tested only where the noise came with the model and the
    residual agrees with it; anything else would excuse a wrong model.

    limit  of the correlation of residual and input
    """
    contradicted = check.correlation_p < DEPENDENCE_SIGNIFICANCE or check.max_correlation > limit
    noisy = run.known and run.noise.ratio * run.sigma > 0.0
    if contradicted or not noisy or not check.simulation_fit_percent < MIN_ATTAINABLE_FIT:
        return []
    fits = _attainable_fits(run, seed, FREE_RUN_DRAWS)
    low, middle, fit = float(np.min(fits)), float(np.median(fits)), check.simulation_fit_percent
    if middle > MIN_ATTAINABLE_FIT or fit < low:
        return []
    return [Finding(
        "note", "free-run-noise-limited",
        f"The torque noise of {check.model} limits a free run over {check.file}: a true model reaches a fit of "
        f"about {middle:.0f} %, {low:.0f} % at worst; this model reaches {fit:.0f} %.",
        {"simulation_fit_percent": fit, "attainable_fit_median": middle, "attainable_fit_low": low},
        "Assess the model by its residual, or by shorter free runs: --segment 1.")]


def low_fit_findings(run: Replay, check: CheckSection, options: ValidateOptions, sensor_std: float,
                     known: Covariance | None) -> list[Finding]:
    """A fit below a half for which neither the noise nor the uncertainty of the model is a reason.

    Only noise that came with the model, and with which the residual agrees, counts: any other would excuse a wrong
    model.

    sensor_std  of the first output, as the model's file states it
    """
    fit = check.simulation_fit_percent
    if options.min_fit is not None or not check.passed or not fit < MIN_EXPLAINED_FIT:
        return []
    agrees = run.known and not check.correlation_p < DEPENDENCE_SIGNIFICANCE
    stated = replace(run, sigma=sensor_std)
    fits = _attainable_fits(stated, options.seed, UNEXPLAINED_RUN_DRAWS, known) if agrees else ()
    where = f"the {check.output.replace('_', ' ')} in {check.file} (model {check.model})"
    return unexplained_free_run(fit, fits, where)


def _attainable_fits(run: Replay, seed: int, draws: int, known: Covariance | None = None) -> np.ndarray:
    roles = Roles(run.roles.inputs, run.roles.outputs[:1])
    return attainable_fits(run.drive, roles, run.problem.traces, run.starts, run.noise, run.sigma, seed, draws,
                           known)


def _drift_torque_std(run: Replay, inertia: float, n: int, time: float) -> float:
    """Std of the missing torque that the slope of a true model's error suggests.

    Torque noise makes the error a random walk, whose fitted slope has 6/5 of the variance of its
    mean slope; the sensor adds the usual 12 / (n time^2).
    """
    memory = run.noise.memory or 0.0
    slow = np.sqrt((1.0 + memory) / (1.0 - memory)) if run.noise.slow is None else run.noise.slow
    wander = run.noise.ratio * run.sigma * np.sqrt(1.2 / n) * slow
    return float(np.hypot(wander, run.sigma * inertia * np.sqrt(12.0 / n) / time))
