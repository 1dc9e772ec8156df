"""How well a true model follows a record in free runs, by its noise and the uncertainty of its values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive import Drive
from drivetool.drive.simulation import Trace
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance, fit_percent, fit_text
from drivetool.identify.noise import Noise, with_torque_noise
from drivetool.identify.problem import Point
from drivetool.identify.setup import Outcome, Roles, Task, has_gap, problem_of

UNEXPLAINED_RUN_DRAWS = 100  # a true model has the lowest fit of all once in a hundred records


def attainable_fits(drive: Drive, roles: Roles, traces: Sequence[Trace], starts: Sequence[np.ndarray], noise: Noise,
                    sensor_std: float, seed: int, draws: int, known: Covariance | None = None) -> np.ndarray:
    """(draws,) fits [%] of free runs of a drive to its own motion under other torque and sensor noise.

    starts      state at the start of each trace
    sensor_std  of the first output, which is compared
    known       covariance of the values, which are drawn, too; None: they are exact
    """
    rng, fits = np.random.default_rng(seed), []
    known = known and known.part(n for n in known.names if n in drive.values and n in drive.quantities)
    problem = problem_of(drive, known.names if known else (), roles, traces)
    values = np.array([drive.value(n) for n in problem.names])

    def first_output(driven: Sequence[Trace], values: np.ndarray) -> np.ndarray:
        return np.concatenate([plant.outputs(t, start)[:, 0] for plant, t, start in zip(
            problem.plants(values, False), driven, starts, strict=True)])

    clean = first_output(problem.traces, values)
    for _ in range(draws):
        driven = [with_torque_noise(t, noise.over(problem.steps(t)), sensor_std, rng) for t in problem.traces]
        drawn = values if known is None else np.clip(
            rng.multivariate_normal(values, known.matrix, method="eigh", check_valid="ignore"), problem.low,
            problem.high)
        other = first_output(driven, drawn)
        fits.append(fit_percent(other + rng.normal(0.0, sensor_std, len(other)), clean))
    return np.array(fits)


def unexplained_free_run(fit: float, attainable: Sequence[float], where: str) -> list[Finding]:
    """The finding on a free run with a lower fit [%] than all that noise leaves a true model.

    attainable  by `attainable_fits`; none: no noise is known
    """
    low = min(attainable, default=None)
    if low is not None and fit >= low:
        return []
    true = ("and no noise that the record confirms explains the rest" if low is None else
            f"while its noise and the uncertainty of its parameters leave a true model {low:.3g} % or more")
    return [Finding(
        "warning", "free-run-not-explained",
        f"The fit of a free run to {where} is {fit_text(fit)}, {true}.",
        {"simulation_fit_percent": fit, "attainable_fit_low": low},
        "Run diagnose: the model lacks a law, or a load torque that was not logged acts.")]


def whole_run_findings(own: Task, outcome: Outcome, begun: Point, fit: float, seed: int,
                       known: Covariance | None) -> list[Finding]:
    """The same of a speed that a free run over the whole record fits worse than its mean; not across a gap.

    own    the task at the reported values, whose free run has the start states of `begun` and this fit [%]
    known  covariance of these values
    """
    if outcome.fit is None or has_gap(own) or not own.roles.outputs[0].endswith("speed") or not fit < 0.0:
        return []
    fits = attainable_fits(own.drive, own.roles, own.traces(), begun.starts, outcome.fit.noise, outcome.sensor_std,
                           seed, UNEXPLAINED_RUN_DRAWS, known)
    return unexplained_free_run(fit, fits, "the whole record")
