"""Friction of each body by itself, where the records tell it from a sum that is shared out by rule."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.check.model import Masks, Model, fit
from drivetool.check.structure import carried
from drivetool.drive.chain import TOTALS
from drivetool.identify.engine import Task
from drivetool.identify.least_squares import schur
from drivetool.identify.noise import normal_under

TOLD = 1.0 / 3.0  # of the sum, that the standard deviation of each part must be below
WORSE = 0.5  # log likelihood by which the parts may do worse than their sum


def with_parts(model: Model, masks: Masks) -> Model:
    """The base with its sums of friction split, where a further sensor, say, tells the parts apart.

    A base that was fitted without that sensor, or with its sign wrong, knows the sum only; sharing it out by
    rule would be a wrong model, and something would be found to make up for it.
    """
    for total, suffix in TOTALS.items():
        if total not in model.task.free:
            continue
        task, parts = _split(model.fitted, total, suffix)
        problem = task.problem()
        begun = replace(model, task=task, problem=problem, point=carried(model, task, problem))
        if _told(begun, parts, model.fitted.drive.values[total]):
            trial = fit(model.code, task, problem, begun.point, model.noise, masks)
            if trial.value < model.value + WORSE:
                model = trial
    return model


def _split(task: Task, total: str, suffix: str) -> tuple[Task, list[str]]:
    """The task with the parts of a sum free, as they are shared out, and their names."""
    drive = task.drive
    parts = {n: max(v, drive.quantity(n).bounds[0]) for n, v in drive.parts(total, drive.values[total]).items()}
    free = tuple(n for n in drive.quantities if n in {*task.free, *parts} - {total})
    return replace(task, drive=drive.with_values(parts), free=free), [f"{b}.{suffix}" for b in drive.bodies]


def _told(model: Model, parts: Sequence[str], whole: float) -> bool:
    """Whether each part has a predicted standard deviation well below the sum."""
    normal = normal_under(model.problem, model.point, model.noise)
    matrix, _, _ = schur(normal)
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(size, size)
    values, vectors = np.linalg.eigh(scaled)
    if values[0] < 1e-10:
        return False
    variance = normal.cost / max(model.problem.count - model.problem.unknowns, 1)
    std = np.sqrt(variance * np.sum(vectors**2 / values, axis=1)) / size
    at = [model.task.free.index(n) for n in parts]
    return bool(np.all(std[at] < TOLD * max(abs(whole), 1e-12)))
