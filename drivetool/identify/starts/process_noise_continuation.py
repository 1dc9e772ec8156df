"""Continuation in process noise: a fit by observers whose gain is reduced step by step.

Across a gap a free run from wrong values closes its contacts at wrong times, and the cost has many
local optima. A model that the record corrects at every sample has few. So the fit begins with an
observer for a torque noise far above the true one, on every body. It takes a few steps, halves that
noise, and so on until the likelihood has passed its maximum. No stage converges: it need only be
near the optimum of the next observer.

Two observers are used. That of the drive without gap and friction corrects the load in the gap too,
and so tolerates a contact at the wrong time. The exact one weights the errors correctly. They fail
at different starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive.simulation import ObserverGains, Trace
from drivetool.identify.noise import Noise, filtered, unit_noise_ratio
from drivetool.identify.problem import Point, Problem, take_steps
from drivetool.quantity import quantity_of

SHAPE_QUANTITIES = ("inertia", "stiffness", "damping", "half_gap")  # positive parameters of known magnitude
# Factor by which a shape parameter may leave its start, a choice: beyond, an observer fits anything.
MAX_SHAPE_FACTOR = 3.0
# Factor of the noise from stage to stage, a choice: a larger one loses the optimum between two stages.
NOISE_RATIO_PER_STAGE = 2.0
STEPS_PER_STAGE = 3  # iterations of a stage, a choice: near the optimum of the next stage is near enough
UNDAMPED_STAGES = 4  # stages without shaft damping: it would damp away a resonance that lies a little off
SIDE_CHOICE_STAGES = 8  # stages after which the side of a gap on which a trace begins is fixed, a choice
MAX_WORSE_STAGES = 5  # stages in a row that may be worse than the best, a choice: a factor of 32 in the noise
MIN_NOISE_RATIO = 1e-5  # of the noise that a sample shows: practically a free run
GAIN_SETTLING_SAMPLES = 1000  # samples in which gains become stationary, a choice with margin
# Samples that identify the side of a gap on which a trace begins: a strongly corrected observer soon forgets it.
SIDE_CHOICE_SAMPLES = 250
MIN_SIDE_GAIN = 2.0  # log likelihood by which another side must be better, a choice: 7 to 1


def continue_in_process_noise(problem: Problem, linear: Problem | None, point: Point,
                              start_ratio: float) -> tuple[Point, float]:
    """Follow the optimum while the torque noise of the observer is reduced.

    linear       the problem whose observers are used; None: the exact one's
    start_ratio  initial torque noise, over that which moves the output by its sensor noise
    returns      (the point where the likelihood was best, torque noise over sensor noise there)
    """
    natural = unit_noise_ratio(problem, point)
    boxed, ratio, best, worse_stages, flat_stages = (
        with_bounded_inertias_and_stiffnesses(problem, point, MAX_SHAPE_FACTOR), start_ratio * natural, None, 0, 0)
    lowest, stage = np.inf, 0
    while ratio > MIN_NOISE_RATIO * natural and worse_stages < MAX_WORSE_STAGES and flat_stages < 2:
        noise = Noise(ratio, None, problem.scale, ratio)
        gains = frozen_observers(problem, linear, point, noise)
        turned = choose_gap_sides(problem, point, gains,
                                  SIDE_CHOICE_SAMPLES) if stage < SIDE_CHOICE_STAGES else point
        if turned is not point:
            point, gains = turned, frozen_observers(problem, linear, turned, noise)
        point, cost = take_steps(boxed, point, gains, STEPS_PER_STAGE,
                                 hold=problem.later if stage < UNDAMPED_STAGES else None)
        if linear is None:
            gains = frozen_observers(problem, None, point, noise)
            cost = problem.cost(point, gains)
        value = value_of_cost(problem, cost, gains)
        flat_stages = flat_stages + 1 if lowest - 2.0 < value < lowest else 0
        worse_stages = 0 if value < lowest else worse_stages + 1
        if value < lowest:
            lowest, best = value, (point, ratio)
        ratio /= NOISE_RATIO_PER_STAGE
        stage += 1
    return best or (point, ratio)


def frozen_observers(problem: Problem, linear: Problem | None, point: Point, noise: Noise) -> list[ObserverGains]:
    """A frozen observer per trace."""
    with np.errstate(over="ignore", invalid="ignore"):
        if linear is None or not all(np.isfinite(t.outputs).all() for t in problem.traces):
            return [f.gains for f in filtered(linear or problem, point, noise)]
        return _stationary_gains(linear, point, noise)


def _stationary_gains(linear: Problem, point: Point, noise: Noise) -> list[ObserverGains]:
    """The gains of a linear drive, which do not depend on the record: computed until they are stationary."""
    found = {}
    for step in dict.fromkeys(t.step for t in linear.traces):
        i = max((i for i, t in enumerate(linear.traces) if t.step == step), key=lambda i: linear.traces[i].size)
        one = replace(linear, traces=(_first_samples(linear.traces[i], GAIN_SETTLING_SAMPLES),))
        found[step] = filtered(one, Point(point.values, (point.starts[i],)), noise)[0].gains
    gains = []
    for t in linear.traces:
        stationary, more = found[t.step], max(t.size - GAIN_SETTLING_SAMPLES, 0)
        gains.append(ObserverGains(*(np.concatenate([a[:t.size], np.repeat(a[-1:], more, axis=0)])
                                     for a in (stationary.gain, stationary.weight))))
    return gains


def frozen_value(problem: Problem, point: Point, gains: Sequence[ObserverGains]) -> float:
    """-log likelihood of a point under frozen observers, up to a constant."""
    return value_of_cost(problem, problem.cost(point, gains), gains)


def value_of_cost(problem: Problem, cost: float, gains: Sequence[ObserverGains]) -> float:
    """The same from the cost."""
    n = problem.count
    if not np.isfinite(cost) or cost <= 0.0:
        return np.inf
    logs = sum(float(np.log(g.weight[np.isfinite(t.outputs)]).sum())
               for t, g in zip(problem.traces, gains, strict=True))
    return 0.5 * n * np.log(cost / n) - logs


def with_bounded_inertias_and_stiffnesses(problem: Problem, point: Point, share: float) -> Problem:
    """The problem with its shape parameters kept within a factor of where they are."""
    low, high = problem.low.copy(), problem.high.copy()
    for j, name in enumerate(problem.names):
        if quantity_of(name) in SHAPE_QUANTITIES and point.values[j] > 0.0:
            low[j] = max(low[j], point.values[j] / share)
            high[j] = min(high[j], point.values[j] * share)
    return replace(problem, low=low, high=high)


@np.errstate(over="ignore", invalid="ignore")
def choose_gap_sides(problem: Problem, point: Point, gains: Sequence[ObserverGains],
                     samples: int = GAIN_SETTLING_SAMPLES) -> Point:
    """The point, with traces begun on the other side of a gap or inside it where that fits better.

    The likelihood has no derivative from one side to the other.
    samples  of each trace that are evaluated
    """
    starts, turned = list(point.starts), False
    for i, (trace, plant) in enumerate(zip(problem.traces, problem.plants(point.values, False), strict=True)):
        system, head = plant.system, _first_samples(trace, samples)
        first = ObserverGains(gains[i].gain[:samples], gains[i].weight[:samples])

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
                if found < lowest - MIN_SIDE_GAIN:
                    lowest, starts[i], turned = found, trial, True
    return Point(point.values, tuple(starts)) if turned else point


def _first_samples(trace: Trace, samples: int) -> Trace:
    return replace(trace, inputs=trace.inputs[:samples], outputs=trace.outputs[:samples])
