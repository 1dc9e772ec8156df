"""Whether one cause could have made the motion that another one makes, whatever the noise says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.check.fit import BROKEN, Model, everything, spread
from drivetool.check.heldout import Score
from drivetool.identify.noise import filtered, with_state
from drivetool.identify.problem import solve

TOLD = 20.0  # log likelihood by which a motion must stand out to tell two causes apart


def imitates(one: Score, best: Score) -> bool:
    """Whether the noise-free response with the best cause leaves nothing over that tells it from another one.

    What is left then is where noise enters, before a lag or behind it, and of that nothing is known.
    """
    try:
        return left_over(one.model, best.model) < TOLD
    except BROKEN:
        return False


def left_over(one: Model, other: Model) -> float:
    """Log likelihood by which the noise-free response of another model stands out from one that is fitted to it."""
    passes = filtered(one.problem, one.point, one.noise)
    traces = []
    for trace, start, plant in zip(other.problem.traces, other.point.starts,
                                   other.problem.plants(other.point.values, False), strict=True):
        clean = plant.outputs(trace, start)
        traces.append(replace(trace, outputs=np.where(np.isfinite(trace.outputs), clean, np.nan)))
    problem = replace(one.problem, traces=tuple(traces)).with_memory(one.noise.memory)
    found = solve(problem, with_state(one.point, one.noise), [p.gains for p in passes], relative=1e-6, most=12)
    return 0.5 * found.cost / spread(passes, everything(one.problem))
