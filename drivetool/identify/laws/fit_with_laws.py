"""Innovations fits with the laws that predict held-out data, from every start that may be near the optimum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.identify.laws.influence import influence_of, sandwich_covariance
from drivetool.identify.laws.law_selection import MAX_LAWS, select_laws, with_laws
from drivetool.identify.laws.laws import Law
from drivetool.identify.laws.regression import Regression, regress
from drivetool.identify.motion import Motions
from drivetool.identify.noise import Noise, fit_innovations, fit_ratio, refit_with_tight_tolerance
from drivetool.identify.problem import Point
from drivetool.identify.setup import Outcome, Task, first_point

MAX_LAW_SELECTIONS = 4  # of law selection, a choice: laws that are removed reveal others
# Iterations of an intermediate fit, a choice: enough to compare, convergence follows for the last alone.
MAX_QUICK_ITERATIONS = 6
# Standard deviations between fit and regression, 1 of 370 by chance: beyond, another start is tried.
MAX_REGRESSION_DISTANCE = 3.0


def fit_with_selected_laws(plain: Outcome, every: Sequence[Law], seen: Motions, linear: bool,
                    ) -> tuple[tuple[Law, ...], Outcome]:
    """(the selected laws, the fit with them); laws that are parameters come alone, without a fit.

    plain   the likeliest fit without laws: its innovations are the whitest, so that their likelihood is valid
    seen    the motion of the motor
    linear  whether a regression can be made
    """
    laws: tuple[Law, ...] = ()
    best = plain
    for _ in range(MAX_LAW_SELECTIONS):
        more, factors = select_laws(best.task, best.solution.point, best.fit.noise,
                                 [law for law in every if law not in laws], MAX_LAWS - len(laws))
        if freed := tuple(law for law in more if law.parameter):
            return freed, plain
        if not more:
            break
        laws += tuple(more)
        best = near(with_laws(best.fitted, more, factors), best, MAX_QUICK_ITERATIONS)
        best = likelier_of_regression_start(best, regress(plain.task, seen, laws)) if linear else best
    return laws, best if best.converged else near(best.fitted, best)


def likelier_of_regression_start(fit: Outcome, regression: Regression) -> Outcome:
    """A fit, or a likelier one started from the regression, if the two differ."""
    covariance, _ = influence_of(fit)
    std = np.sqrt(np.diag(sandwich_covariance(regression.influence)) + np.diag(covariance))
    if np.all(np.abs(fit.solution.point.values - regression.values) < MAX_REGRESSION_DISTANCE * std):
        return fit
    values = np.clip(regression.values, fit.problem.low, fit.problem.high)
    task, noise = fit.task.at(dict(zip(regression.names, values, strict=True))), fit.fit.noise
    # The noise of a fit in a local optimum may hide the right one, so the noise ratio is also estimated anew.
    point = first_point(task.drive, fit.problem, task.roles)
    fresh = replace(noise, ratio=fit_ratio(fit.problem, point, Noise(1.0, None, noise.scale)).ratio)
    return min((fit, near(task, fit, MAX_QUICK_ITERATIONS),
                _fit_innovations_from(task, fit, point, fresh, MAX_QUICK_ITERATIONS)),
               key=lambda o: o.fit.value)


def near(task: Task, before: Outcome, max_rounds: int = 12) -> Outcome:
    """Innovations fit from a task's values and the noise of an earlier fit, in at most max_rounds iterations."""
    point = first_point(task.drive, task.problem(), task.roles)
    return _fit_innovations_from(task, before, replace(point, starts=before.solution.point.starts),
                                 before.fit.noise, max_rounds)


def _fit_innovations_from(task: Task, before: Outcome, point: Point, noise: Noise, max_rounds: int) -> Outcome:
    problem = task.problem()
    fit = fit_innovations(problem, point, noise, near_optimum=True, max_rounds=max_rounds)
    fit = refit_with_tight_tolerance(problem, fit) if fit.converged else fit
    return Outcome.of_fit(task, problem, fit, before.starts)
