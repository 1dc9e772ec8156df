"""Where the resonance may lie: a look along the stiffness, for a fit that began beside it.

A resonance that the record shows but weakly is a narrow peak of the likelihood among others made by noise, and a
fit that begins a tenth off ends at one of those, or without any. So every stiffness is scaled through a range, at
each value the rest takes a few steps, and the fit goes on from where that has led furthest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.identify.noise import Fit, Noise, excerpt, filtered, fit_ratio, minus_log_likelihood
from drivetool.identify.problem import Point, Problem, approach
from drivetool.identify.starts.cooling import SHAPE

REACH = 2.5  # factor by which a stiffness may be wrong
LOOKS = 31  # values of it: 3.1 % in frequency apart
STEPS = 3  # that the rest takes at each
MOST = 50_000  # samples looked at
BEST = 2  # places from which a fit goes on
SAME = 0.03  # of the logarithm of a stiffness, within which two places are one
HOPEFUL = 20.0  # log likelihood behind a fit from which a place may still turn out the better one
BETTER = 1.0  # log likelihood by which a place is better than the fit beside it


def resonances(problem: Problem, begun: Point, fit: Fit) -> list[tuple[Point, Noise]]:
    """The points, with their noise, from which a fit may end higher than one that may have missed the resonance.

    begun    a point whose stiffnesses are looked about, with the shares of the inertias and the shaft damping
    fit      whose sum of the inertias, friction and noise are better than those of the start
    returns  the likeliest first; none where nothing promises more than the fit has
    """
    stiff = [j for j, n in enumerate(problem.names) if n.endswith(".stiffness") and begun.values[j] > 0.0]
    small, begun = excerpt(problem, MOST), _mixed(problem, begun, fit.point)
    so_far = _value(small, fit.point, fit.noise)
    found: list[tuple[float, Point]] = []
    for chosen in _together(stiff):
        for factor in np.geomspace(1.0 / REACH, REACH, LOOKS):
            values = begun.values.copy()
            values[chosen] = np.clip(values[chosen] * factor, problem.low[chosen], problem.high[chosen])
            found.append(_looked(small, Point(values, begun.starts), fit.noise))
    points = [point for value, point in _distinct(found, stiff)
              if value < so_far - BETTER or (value < so_far + HOPEFUL and not _same(point, fit.point, stiff))]
    return [(point, fit_ratio(problem, point, Noise(1.0, None, fit.noise.scale), settled=True)) for point in points]


def _mixed(problem: Problem, begun: Point, known: Point) -> Point:
    """The shape and the start states of one point, the sum of the inertias and the friction of another."""
    values = known.values.copy()
    shape = [j for j, n in enumerate(problem.names) if n.endswith(SHAPE)]
    values[shape] = begun.values[shape]
    inertias = [j for j, n in enumerate(problem.names) if n.endswith(".inertia")]
    if inertias:
        values[inertias] *= known.values[inertias].sum() / values[inertias].sum()
    return Point(values, begun.starts)


def _together(stiff: Sequence[int]) -> list[list[int]]:
    """All shafts at once, then one by one."""
    return [list(stiff)] + ([[j] for j in stiff] if len(stiff) > 1 else [])


@np.errstate(over="ignore", invalid="ignore")
def _looked(problem: Problem, point: Point, noise: Noise) -> tuple[float, Point]:
    """(-log likelihood, point) after a few steps."""
    gains = [f.gains for f in filtered(problem, point, noise)]
    there, _ = approach(problem, point, gains, STEPS, damping=0.1)
    return _value(problem, there, noise), there


def _value(problem: Problem, point: Point, noise: Noise) -> float:
    value = minus_log_likelihood(filtered(problem, point, noise, keep=False))
    return value if np.isfinite(value) else np.inf


def _distinct(found: Sequence[tuple[float, Point]], stiff: Sequence[int]) -> list[tuple[float, Point]]:
    """The best places that differ in a stiffness."""
    chosen: list[tuple[float, Point]] = []
    for value, point in sorted(found, key=lambda pair: pair[0]):
        if len(chosen) < BEST and not any(_same(point, other, stiff) for _, other in chosen):
            chosen.append((value, point))
    return chosen


def _same(one: Point, other: Point, stiff: Sequence[int]) -> bool:
    """Whether two points have the same resonances."""
    least = np.finfo(float).tiny
    a, b = (np.log(np.maximum(p.values[list(stiff)], least)) for p in (one, other))
    return bool(np.abs(a - b).max(initial=0.0) < SAME)
