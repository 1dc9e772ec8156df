"""Settings whose sensitivity limit holds for a share of the drives that the covariance allows.

All draws take part in every check, but only those near the quantile decide where the optimum lies.
So the search works with these few, and is repeated until the limit holds over all of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.tune.optimisation.scenarios import Draws
from drivetool.tune.optimisation.search import Found, Task, optimum, sensitivity_of
from drivetool.tune.speed_loop import Loop, Plant, Settings, build, plant

ACTIVE, ROUNDS = 10, 8


def robust_optimum(nominal: Task, draws: Draws, confidence: float) -> Found | None:
    """The best nominal criterion with Ms below the limit in at least a share `confidence` of the draws.

    nominal     the task without scenarios; its own drive keeps the limit as well
    confidence  between 0 and 1
    returns     None if no settings were found that keep it
    """
    loops = [build(drive, nominal.loop.wiring) for drive in draws.drives]
    every = [(loop, plant(loop.drive, loop.wiring)) for loop in loops]
    limit, misses = nominal.limits.sensitivity, int((1.0 - confidence) * len(every) + 1e-9)
    found, active, best = optimum(nominal), [], None
    for _ in range(ROUNDS):
        if found is None:
            return best
        order = _ranking(every, found.settings)
        if order[misses][0] <= limit * (1.0 + 1e-6):
            if best is None or found.value < best.value:
                best = found
            if not active or order[misses][0] >= limit * (1.0 - 1e-3):
                return best
            active = []  # held more than was asked: choose anew who may miss
        active += [k for _, k in order[misses:misses + ACTIVE] if k not in active]
        found = optimum(replace(nominal, scenarios=(*nominal.scenarios, *(every[k] for k in active))))
    return best


def _ranking(every: list[tuple[Loop, Plant]], settings: Settings) -> list[tuple[float, int]]:
    """(Ms, index) of the draws, highest first."""
    found = [(sensitivity_of(loop, own, settings), k) for k, (loop, own) in enumerate(every)]
    return sorted(found, key=lambda each: (-each[0], each[1]))


def share_kept(draws: Draws, nominal: Task, settings: Settings) -> float:
    """Share of the draws in which the limit holds."""
    found = [sensitivity_of(loop, plant(loop.drive, loop.wiring), settings)
             for loop in (build(drive, nominal.loop.wiring) for drive in draws.drives)]
    return float(np.mean(np.array(found) <= nominal.limits.sensitivity * (1.0 + 1e-6)))
