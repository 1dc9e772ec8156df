"""A way into the optimum from far off: an observer that follows the record less and less.

Across a gap a model that runs freely from wrong values closes its contacts at wrong times, and the
cost is a field of valleys. A model that is pulled to the record at every sample has few. So the
fit begins with an observer for a torque noise far above the true one, on every body, takes a few
steps, halves that noise, and so on until the likelihood has passed its peak. No step waits for
convergence: what counts is to be near when the next observer takes over.

Two observers are of use. That of the drive without gap and friction corrects the load in the gap
too and so forgives a contact at the wrong time; the exact one weighs what it sees rightly. They
fail at different starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive.simulation import Gains, Trace
from drivetool.identify.noise import Noise, filtered, natural_ratio
from drivetool.identify.problem import Point, Problem, approach

SHAPE = (".inertia", ".stiffness", ".damping", ".half_gap")  # parameters whose sign and size are sure
BOX = 3.0  # by which a shape parameter may leave its start while the observer is hot
COOL = 2.0  # by which the noise falls from stage to stage
STEPS = 3  # iterations of a stage
QUIET = 4  # stages without shaft damping: it would damp away a resonance that lies a little off
DECIDED = 8  # stages after which the side of a gap on which a trace begins is settled
PATIENCE = 5  # stages that may be worse than the best
COLDEST = 1e-5  # of the noise that a sample shows; as good as none
HEAD = 1000  # samples in which gains settle
FIRST = 250  # samples that show on which side of a gap a trace begins while the observer is hot: it soon forgets
SURE = 2.0  # log likelihood by which another side must be better


def cooled(problem: Problem, linear: Problem | None, point: Point, hot: float,
           steps: int = STEPS) -> tuple[Point, float]:
    """Follow the optimum while the observer cools.

    linear   the problem whose observers are used; None: the exact one's
    hot      torque noise to begin with, over that which moves the output by its sensor noise
    returns  (the point where the likelihood was best, torque noise over sensor noise there)
    """
    natural = natural_ratio(problem, point)
    boxed, ratio, best, worse, flat = within(problem, point, BOX), hot * natural, None, 0, 0
    lowest, stage = np.inf, 0
    while ratio > COLDEST * natural and worse < PATIENCE and flat < 2:
        noise = Noise(ratio, None, problem.scale, ratio)
        gains = observers(problem, linear, point, noise)
        turned = sides(problem, point, gains, FIRST) if stage < DECIDED else point
        if turned is not point:
            point, gains = turned, observers(problem, linear, turned, noise)
        point, cost = approach(boxed, point, gains, steps, hold=problem.later if stage < QUIET else None)
        if linear is None:
            gains = observers(problem, None, point, noise)
            cost = problem.cost(point, gains)
        value = value_of(problem, cost, gains)
        flat = flat + 1 if lowest - 2.0 < value < lowest else 0
        worse = 0 if value < lowest else worse + 1
        if value < lowest:
            lowest, best = value, (point, ratio)
        ratio /= COOL
        stage += 1
    return best or (point, ratio)


def observers(problem: Problem, linear: Problem | None, point: Point, noise: Noise) -> list[Gains]:
    """A frozen observer per trace."""
    with np.errstate(over="ignore", invalid="ignore"):
        if linear is None or not all(np.isfinite(t.outputs).all() for t in problem.traces):
            return [f.gains for f in filtered(linear or problem, point, noise)]
        return _steady(linear, point, noise)


def _steady(linear: Problem, point: Point, noise: Noise) -> list[Gains]:
    """The gains of a linear drive, which do not depend on the record: worked out until they stand still."""
    longest = {}
    for i, t in enumerate(linear.traces):
        if t.step not in longest or t.size > linear.traces[longest[t.step]].size:
            longest[t.step] = i
    found = {}
    for step, i in longest.items():
        one = replace(linear, traces=(_head(linear.traces[i], HEAD),))
        found[step] = filtered(one, Point(point.values, (point.starts[i],)), noise)[0].gains
    gains = []
    for t in linear.traces:
        begun, more = found[t.step], max(t.size - HEAD, 0)
        gains.append(Gains(*(np.concatenate([a[:t.size], np.repeat(a[-1:], more, axis=0)])
                             for a in (begun.gain, begun.weight))))
    return gains


def frozen_value(problem: Problem, point: Point, gains: Sequence[Gains]) -> float:
    """-log likelihood of a point under frozen observers, up to a constant."""
    return value_of(problem, problem.cost(point, gains), gains)


def value_of(problem: Problem, cost: float, gains: Sequence[Gains]) -> float:
    """The same from the cost."""
    n = problem.count
    if not np.isfinite(cost) or cost <= 0.0:
        return np.inf
    logs = sum(float(np.log(g.weight[np.isfinite(t.outputs)]).sum())
               for t, g in zip(problem.traces, gains, strict=True))
    return 0.5 * n * np.log(cost / n) - logs


def within(problem: Problem, point: Point, share: float) -> Problem:
    """The problem with its shape parameters kept within a factor of where they are."""
    low, high = problem.low.copy(), problem.high.copy()
    for j, name in enumerate(problem.names):
        if name.endswith(SHAPE) and point.values[j] > 0.0:
            low[j] = max(low[j], point.values[j] / share)
            high[j] = min(high[j], point.values[j] * share)
    return replace(problem, low=low, high=high)


@np.errstate(over="ignore", invalid="ignore")
def sides(problem: Problem, point: Point, gains: Sequence[Gains], samples: int = HEAD) -> Point:
    """The point, with traces begun on the other side of a gap or inside it where that fits better.

    No derivative leads from one side to the other.
    samples  of each trace that are looked at
    """
    starts, turned = list(point.starts), False
    for i, (trace, plant) in enumerate(zip(problem.traces, problem.plants(point.values, False), strict=True)):
        system, head = plant.system, _head(trace, samples)
        first = Gains(gains[i].gain[:samples], gains[i].weight[:samples])

        def value(start: np.ndarray, plant=plant, head=head, first=first) -> float:
            error = ((plant.outputs(head, start, first) - head.outputs) * first.weight).ravel()
            error = error[np.isfinite(head.outputs).ravel()]
            cost = float(error @ error)
            return 0.5 * len(error) * float(np.log(cost)) if 0.0 < cost < np.inf else np.inf

        lowest = value(starts[i]) if system.ng else 0.0
        # A drive with smooth laws has further columns, for the kernel alone.
        for spring, reach in zip(system.spring[:, :plant.nx, 0], system.reach[:, 0], strict=True):
            twist = np.flatnonzero(spring)[-1]
            if twist in problem.known(i):
                continue
            for torque in (0.0, 1.01 * reach, -1.01 * reach):
                trial = starts[i].copy()
                trial[twist] += (torque - spring @ trial) / spring[twist]
                found = value(trial)
                if found < lowest - SURE:
                    lowest, starts[i], turned = found, trial, True
    return Point(point.values, tuple(starts)) if turned else point


def _head(trace: Trace, samples: int) -> Trace:
    return replace(trace, inputs=trace.inputs[:samples], outputs=trace.outputs[:samples])
