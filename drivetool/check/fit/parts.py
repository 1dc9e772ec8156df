"""Friction of each body by itself, where the records tell it from a sum that is shared out by rule."""

from __future__ import annotations

from dataclasses import replace

from drivetool.check.fit.model import Masks, Model, fit
from drivetool.check.fit.structure import carried
from drivetool.drive import TOTALS
from drivetool.identify.fit import parted, told_apart
from drivetool.identify.noise import normal_under

WORSE = 0.5  # log likelihood by which the parts may do worse than their sum


def with_parts(model: Model, masks: Masks) -> Model:
    """The base with its sums of friction split, where a further sensor, say, tells the parts apart.

    A base that was fitted without that sensor, or with its sign wrong, knows the sum only; sharing it out by
    rule would be a wrong model, and something would be found to make up for it.
    """
    for total in TOTALS:
        if total not in model.task.free:
            continue
        for task, parts in parted(model.fitted, total):
            problem = task.problem()
            begun = replace(model, task=task, problem=problem, point=carried(model, task, problem))
            normal = normal_under(problem, begun.point, model.noise)
            if told_apart(task, problem, begun.point, normal, parts, model.fitted.drive.values[total]):
                trial = fit(begun, masks)
                if trial.value < model.value + WORSE:
                    model = trial
                break
    return model
