"""Friction of each body separately, where the records identify more than a sum that is split by rule."""

from __future__ import annotations

from dataclasses import replace

from drivetool.check.fit.model import Masks, Model, fit
from drivetool.check.fit.structure import transferred_point
from drivetool.drive import TOTALS
from drivetool.identify.fit import parts_identifiable, tasks_with_parts
from drivetool.identify.noise import filtered_normal_equations

# Log likelihood by which the parts may be worse than their sum: tolerance of two fits that stop separately (a
# choice).
MAX_SPLIT_LOSS = 0.5


def with_parts(model: Model, masks: Masks) -> Model:
    """The base with its sums of friction split, where a further sensor, say, makes the parts identifiable.

    A base fitted without that sensor, or with its sign wrong, has the sum only. Splitting it by rule would be a
    wrong model, and the search would find a cause that compensates it.
    """
    for total in TOTALS:
        if total not in model.task.free:
            continue
        for task, parts in tasks_with_parts(model.fitted, total):
            problem = task.problem()
            start = replace(model, task=task, problem=problem, point=transferred_point(model, task, problem))
            normal = filtered_normal_equations(problem, start.point, model.noise)
            if parts_identifiable(task, problem, start.point, normal, parts, model.fitted.drive.values[total]):
                trial = fit(start, masks)
                if trial.value < model.value + MAX_SPLIT_LOSS:
                    model = trial
                break
    return model
