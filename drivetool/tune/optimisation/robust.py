"""Settings whose sensitivity limit holds for a share of the drives drawn from the covariance.

All draws are checked in every round, but only those near the quantile determine the optimum.
So the search uses these few, and is repeated until the limit holds for the share of all draws.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.tune.optimisation.scenarios import Draws
from drivetool.tune.optimisation.search import Optimum, TuningProblem, optimum, sensitivity_of
from drivetool.tune.speed_loop import Loop, Plant, Settings, build, plant

# Draws added as constraints per round, and rounds. A choice: the time of a search grows with the constraints, and
# one round with few of them misses the draws that become critical when the settings move.
DRAWS_PER_ROUND, MAX_ROBUST_ROUNDS = 10, 8


def robust_optimum(nominal: TuningProblem, draws: Draws, confidence: float) -> Optimum | None:
    """The best nominal criterion with Ms below the limit in at least a share `confidence` of the draws.

    nominal     the task without scenarios; its own drive keeps the limit as well
    confidence  between 0 and 1
    returns     None if no settings within the limit were found
    """
    loops = [build(drive, nominal.loop.wiring) for drive in draws.drives]
    all_draws = [(loop, plant(loop.drive, loop.wiring)) for loop in loops]
    limit, allowed_misses = nominal.limits.sensitivity, int((1.0 - confidence) * len(all_draws) + 1e-9)
    found, active, best = optimum(nominal), [], None
    for _ in range(MAX_ROBUST_ROUNDS):
        if found is None:
            return best
        order = _draws_by_sensitivity(all_draws, found.settings)
        if order[allowed_misses][0] <= limit * (1.0 + 1e-6):
            if best is None or found.value < best.value:
                best = found
            if not active or order[allowed_misses][0] >= limit * (1.0 - 1e-3):
                return best
            active = []  # more draws within the limit than required: choose again which may exceed it
        active += [k for _, k in order[allowed_misses:allowed_misses + DRAWS_PER_ROUND] if k not in active]
        found = optimum(replace(nominal, scenarios=(*nominal.scenarios, *(all_draws[k] for k in active))))
    return best


def _draws_by_sensitivity(all_draws: list[tuple[Loop, Plant]], settings: Settings) -> list[tuple[float, int]]:
    """(Ms, index) of the draws, highest first."""
    found = [(sensitivity_of(loop, own, settings), k) for k, (loop, own) in enumerate(all_draws)]
    return sorted(found, key=lambda each: (-each[0], each[1]))


def share_within_limit(draws: Draws, nominal: TuningProblem, settings: Settings) -> float:
    """Share of the draws in which the limit holds."""
    found = [sensitivity_of(loop, plant(loop.drive, loop.wiring), settings)
             for loop in (build(drive, nominal.loop.wiring) for drive in draws.drives)]
    return float(np.mean(np.array(found) <= nominal.limits.sensitivity * (1.0 + 1e-6)))
