"""Equivalence of two causes by their noise-free responses, whatever their noise models say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.check.fit import FIT_ERRORS, Model, all_samples, sensor_variance
from drivetool.check.heldout import Score
from drivetool.check.search.decision import CLEAR_LEAD
from drivetool.identify.noise import filtered, with_disturbance_state
from drivetool.identify.problem import solve

EQUIVALENCE_LIMIT = CLEAR_LEAD  # log likelihood of the difference of two responses. A choice


def responses_equivalent(one: Score, best: Score) -> bool:
    """Whether the noise-free response with the best cause can be reproduced with another one.

    The two then differ only in where noise enters, before a lag or behind it, which is not known.
    """
    try:
        return response_difference(one.model, best.model) < EQUIVALENCE_LIMIT
    except FIT_ERRORS:
        return False


def response_difference(one: Model, other: Model) -> float:
    """Log likelihood of the residual when a model is fitted to the noise-free response of another."""
    passes = filtered(one.problem, one.point, one.noise)
    traces = []
    for trace, start, plant in zip(other.problem.traces, other.point.starts,
                                   other.problem.plants(other.point.values, False), strict=True):
        clean = plant.outputs(trace, start)
        traces.append(replace(trace, outputs=np.where(np.isfinite(trace.outputs), clean, np.nan)))
    problem = replace(one.problem, traces=tuple(traces)).with_memory(one.noise.memory)
    found = solve(problem, with_disturbance_state(one.point, one.noise), [p.gains for p in passes], relative=1e-6,
                  max_iterations=12)
    return 0.5 * found.cost / sensor_variance(passes, all_samples(one.problem))
