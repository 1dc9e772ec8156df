"""Friction of each body separately, where the records identify more than a sum that is split by rule."""

from __future__ import annotations

from drivetool.check.fit.model import Masks, Model, fit
from drivetool.check.fit.structure import on_task
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
            start = on_task(model, task)
            normal = filtered_normal_equations(start.problem, start.point, model.noise)
            whole = model.fitted.drive.values[total]
            if parts_identifiable(task, start.problem, start.point, normal, parts, whole):
                trial = fit(start, masks)
                if trial.value < model.value + MAX_SPLIT_LOSS:
                    model = trial
                break
    return model
