"""How far the values of a cause may go while it is looked for."""

from __future__ import annotations

from dataclasses import replace

from drivetool.check.causes import FITTED
from drivetool.check.model import Model
from drivetool.identify.engine import Task
from drivetool.identify.problem import Problem


def bounded(problem: Problem, base: Model, task: Task) -> Problem:
    """The problem of a task within the bounds that the causes set, see their files.

    base  that lacks what the task has
    """
    low, high = problem.low.copy(), problem.high.copy()
    for cause in (c for c in FITTED if c.bounds is not None):
        for name, (least, most) in cause.bounds(base, task).items():
            j = task.free.index(name)
            low[j], high[j] = max(low[j], least), min(high[j], most)
    return replace(problem, low=low, high=high)
