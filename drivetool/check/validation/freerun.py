"""What limits a free run: a drift, or torque noise that decides when a gap closes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.check.validation.correlation import DEPENDENCE_SIGNIFICANCE
from drivetool.check.validation.replay import Replay, simulated
from drivetool.check.validation.sections import CheckSection
from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import fit_percent
from drivetool.identify.noise import with_torque_noise
from drivetool.logs import Experiment

FREE_RUN_DRAWS = 20  # runs with other torque noise. A choice: their lowest fit is about the 5 % quantile
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
    if contradicted or not noisy or not check.simulation_fit_percent < 95.0:
        return []
    rng, fits = np.random.default_rng(seed), []
    clean = np.concatenate([r[:, 0] for r in simulated(run.problem, run.starts)])
    for _ in range(FREE_RUN_DRAWS):
        traces = tuple(with_torque_noise(
            t, run.noise.over(run.problem.steps(t)), run.sigma, rng) for t in run.problem.traces)
        other = np.concatenate([r[:, 0] for r in simulated(replace(run.problem, traces=traces), run.starts)])
        fits.append(fit_percent(other + rng.normal(0.0, run.sigma, len(other)), clean))
    low, middle, fit = float(np.min(fits)), float(np.median(fits)), check.simulation_fit_percent
    if middle > 95.0 or fit < low:
        return []
    return [Finding(
        "note", "free-run-noise-limited",
        f"The torque noise of {check.model} limits a free run over {check.file}: a true model reaches a fit of "
        f"about {middle:.0f} %, {low:.0f} % at worst; this model reaches {fit:.0f} %.",
        {"simulation_fit_percent": fit, "attainable_fit_median": middle, "attainable_fit_low": low},
        "Assess the model by its residual, or by shorter free runs: --segment 1.")]


def _drift_torque_std(run: Replay, inertia: float, n: int, time: float) -> float:
    """Std of the missing torque that the slope of a true model's error suggests.

    Torque noise makes the error a random walk, whose fitted slope has 6/5 of the variance of its
    mean slope; the sensor adds the usual 12 / (n time^2).
    """
    memory = run.noise.memory or 0.0
    slow = np.sqrt((1.0 + memory) / (1.0 - memory)) if run.noise.slow is None else run.noise.slow
    wander = run.noise.ratio * run.sigma * np.sqrt(1.2 / n) * slow
    return float(np.hypot(wander, run.sigma * inertia * np.sqrt(12.0 / n) / time))
