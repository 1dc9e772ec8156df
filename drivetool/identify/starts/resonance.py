"""Grid search over the stiffness, for a fit that may have missed the resonance.

A weakly excited resonance is a narrow peak of the likelihood among others made by noise. A fit that starts a tenth
off ends at one of those, or at none. So each stiffness is scaled through a range, the other parameters take a few
steps at each value, and the fit continues from the likeliest points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.identify.noise import Fit, Noise, filtered, first_samples_of, fit_ratio, minus_log_likelihood_at
from drivetool.identify.problem import Point, Problem, take_steps
from drivetool.identify.starts.process_noise_continuation import SHAPE_QUANTITIES
from drivetool.quantity import quantity_of

STIFFNESS_FACTOR_RANGE = 2.5  # factor by which a start value of the stiffness may be wrong, a choice
STIFFNESS_GRID_SIZE = 31  # grid points: 3.1 % in frequency from one to the next, as narrow as the peak
STEPS_PER_GRID_POINT = 3  # of the other parameters at each point, a choice: enough to compare the points
MAX_GRID_SAMPLES = 50_000  # samples evaluated, a choice that bounds the time of the grid
MAX_RESONANCE_STARTS = 2  # points from which a fit continues, a choice: each costs a fit
SAME_LOG_STIFFNESS = 0.03  # of the logarithm of a stiffness, half a grid step: closer points are one
# Log likelihood that a point may lie below the fit and still be tried. A choice: its fit has not converged.
MAX_RESONANCE_START_LOSS = 20.0
# Log likelihood by which a point must exceed the fit; a smaller gain is incomplete convergence.
MIN_RESONANCE_START_GAIN = 1.0


def resonance_starts(problem: Problem, initial: Point, fit: Fit) -> list[tuple[Point, Noise]]:
    """The points, with their noise, from which a fit may end higher than one that may have missed the resonance.

    initial  a point whose stiffnesses are scaled, with the shares of the inertias and the shaft damping
    fit      whose sum of the inertias, friction and noise are better than those of the start
    returns  the likeliest first; none where no point may exceed the fit
    """
    stiff = [j for j, n in enumerate(problem.names) if quantity_of(n) == "stiffness" and initial.values[j] > 0.0]
    part, initial = first_samples_of(problem, MAX_GRID_SAMPLES), _with_totals_of(problem, initial, fit.point)
    fit_value = _value_or_inf(part, fit.point, fit.noise)
    found: list[tuple[float, Point]] = []
    for chosen in [stiff, *([[j] for j in stiff] if len(stiff) > 1 else [])]:  # all shafts at once, then one by one
        for factor in np.geomspace(1.0 / STIFFNESS_FACTOR_RANGE, STIFFNESS_FACTOR_RANGE, STIFFNESS_GRID_SIZE):
            values = initial.values.copy()
            values[chosen] = np.clip(values[chosen] * factor, problem.low[chosen], problem.high[chosen])
            found.append(_after_few_steps(part, Point(values, initial.starts), fit.noise))
    points = [point for value, point in _distinct_in_stiffness(found, stiff)
              if value < fit_value - MIN_RESONANCE_START_GAIN
              or (value < fit_value + MAX_RESONANCE_START_LOSS and not _same_stiffness(point, fit.point, stiff))]
    return [(point, fit_ratio(problem, point, Noise(1.0, None, fit.noise.scale), converged=True))
            for point in points]


def _with_totals_of(problem: Problem, initial: Point, known: Point) -> Point:
    """The shape and the start states of one point, the sum of the inertias and the friction of another."""
    values = known.values.copy()
    shape = [j for j, n in enumerate(problem.names) if quantity_of(n) in SHAPE_QUANTITIES]
    values[shape] = initial.values[shape]
    inertias = [j for j, n in enumerate(problem.names) if quantity_of(n) == "inertia"]
    if inertias:
        values[inertias] *= known.values[inertias].sum() / values[inertias].sum()
    return Point(values, initial.starts)


@np.errstate(over="ignore", invalid="ignore")
def _after_few_steps(problem: Problem, point: Point, noise: Noise) -> tuple[float, Point]:
    """(-log likelihood, point) after a few steps."""
    gains = [f.gains for f in filtered(problem, point, noise)]
    stepped, _ = take_steps(problem, point, gains, STEPS_PER_GRID_POINT, damping=0.1)
    return _value_or_inf(problem, stepped, noise), stepped


def _value_or_inf(problem: Problem, point: Point, noise: Noise) -> float:
    value = minus_log_likelihood_at(problem, point, noise)
    return value if np.isfinite(value) else np.inf


def _distinct_in_stiffness(found: Sequence[tuple[float, Point]], stiff: Sequence[int]) -> list[tuple[float, Point]]:
    """The best points that differ in a stiffness."""
    chosen: list[tuple[float, Point]] = []
    for value, point in sorted(found, key=lambda pair: pair[0]):
        if len(chosen) < MAX_RESONANCE_STARTS and not any(_same_stiffness(point, other, stiff)
                                                          for _, other in chosen):
            chosen.append((value, point))
    return chosen


def _same_stiffness(one: Point, other: Point, stiff: Sequence[int]) -> bool:
    """Whether two points have the same resonances."""
    least = np.finfo(float).tiny
    a, b = (np.log(np.maximum(p.values[list(stiff)], least)) for p in (one, other))
    return bool(np.abs(a - b).max(initial=0.0) < SAME_LOG_STIFFNESS)
