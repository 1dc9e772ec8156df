"""Innovations fits with the laws that the motion foretells, from wherever the right optimum may be near."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.identify.laws.foretold import MOST, foretold, with_laws
from drivetool.identify.laws.influence import influence_of, sandwich
from drivetool.identify.laws.laws import Law
from drivetool.identify.laws.regression import Regression, regress
from drivetool.identify.motion import Motions
from drivetool.identify.noise import Noise, fit_innovations, fit_ratio, settle
from drivetool.identify.problem import Point
from drivetool.identify.setup import Outcome, Task, first_point

ROUNDS = 4  # of looking for laws: those that are taken out show others
QUICK = 6  # rounds of a fit on the way
ELSEWHERE = 3.0  # standard deviations between a fit and the regression from which another start is worth its time


def with_found_laws(plain: Outcome, every: Sequence[Law], seen: Motions, linear: bool,
                    ) -> tuple[tuple[Law, ...], Outcome]:
    """(the laws that the motion foretells, the fit with them); where one is a parameter, that alone and no fit.

    plain   the likeliest fit without laws: its errors are the whitest, so that their likelihood counts
    seen    the motion of the motor
    linear  whether a regression can be made
    """
    laws: tuple[Law, ...] = ()
    best = plain
    for _ in range(ROUNDS):
        more, factors = foretold(best.task, best.solution.point, best.fit.noise,
                                 [law for law in every if law not in laws], MOST - len(laws))
        if freed := tuple(law for law in more if law.parameter):
            return freed, plain
        if not more:
            break
        laws += tuple(more)
        best = near(with_laws(best.task.at_point(best.solution.point), more, factors), best, QUICK)
        best = likelier(best, regress(plain.task, seen, laws)) if linear else best
    return laws, best if best.converged else near(best.task.at_point(best.solution.point), best)


def likelier(fit: Outcome, by: Regression) -> Outcome:
    """A fit, or a likelier one from where the regression is, if that is elsewhere."""
    covariance, _ = influence_of(fit)
    std = np.sqrt(np.diag(sandwich(by.influence)) + np.diag(covariance))
    if np.all(np.abs(fit.solution.point.values - by.values) < ELSEWHERE * std):
        return fit
    values = np.clip(by.values, fit.problem.low, fit.problem.high)
    task, noise = fit.task.at(dict(zip(by.names, values, strict=True))), fit.fit.noise
    # A fit that went astray has a noise that hides what is right here, so it is also sought everywhere.
    point = first_point(task.drive, fit.problem, task.roles)
    fresh = replace(noise, ratio=fit_ratio(fit.problem, point, Noise(1.0, None, noise.scale)).ratio)
    return min((fit, near(task, fit, QUICK), _fitted(task, fit, point, fresh, QUICK)), key=lambda o: o.fit.value)


def near(task: Task, before: Outcome, most: int = 12) -> Outcome:
    """Innovations fit from the values of a task and the noise of an earlier fit, of so many rounds at most."""
    point = first_point(task.drive, task.problem(), task.roles)
    return _fitted(task, before, replace(point, starts=before.solution.point.starts), before.fit.noise, most)


def _fitted(task: Task, before: Outcome, point: Point, noise: Noise, most: int) -> Outcome:
    problem = task.problem()
    fit = fit_innovations(problem, point, noise, arrived=True, most=most)
    fit = settle(problem, fit) if fit.converged else fit
    return Outcome(task, problem, fit.solution, fit, before.starts, fit.converged)
