"""A model beside its base: what it adds, and the model without some of that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.check.fit.model import MOST, Masks, Model, fit
from drivetool.check.fit.structure import carried, third_of, without_third
from drivetool.drive import Drive
from drivetool.identify.estimate import Parameter, parameters_of
from drivetool.identify.laws import tip_names
from drivetool.identify.noise import normal_under
from drivetool.identify.problem import Solution

TOLD = 2.5  # standard deviations by which one amplitude of a cause must differ from zero


def values_of(model: Model, base: Model) -> tuple[Parameter, ...]:
    """What the cause adds to the base, with intervals where there are any."""
    normal = normal_under(model.problem, model.point, model.noise)
    lines, _, _ = parameters_of(model.problem, Solution(model.point, normal, 0, True), model.task.drive,
                                model.fitted.drive)
    return tuple(p for p in lines if p.name in model.task.free and p.name not in base.task.free)


def without_them(model: Model, names: Sequence[str], first: Drive, masks: Masks, most: int = MOST) -> Model:
    """The model without these parameters, fitted again.

    first  the drive that the search began with; most: rounds of the fit
    """
    task = model.fitted
    if tip_names(first, third_of(task.drive))[0] in names:
        task = without_third(task, first)
    orders = {n.replace(".bandwidth", ".order") for n in names if n.endswith(".bandwidth")}  # of no lag any more
    values = {n: v for n, v in task.drive.values.items() if n not in {*names, *orders}}
    for n in [n for n in names if n.endswith(".stribeck")]:  # without its surplus friction is what it was
        dry = n.replace(".stribeck", ".coulomb")
        values |= {dry: values[dry] + task.drive.value(n)} if dry in values else {}
    drive = replace(task.drive, values=values)
    less = replace(task, drive=drive, free=tuple(n for n in drive.quantities if n in {*task.free} - {*names}))
    problem = less.problem()
    return fit(replace(model, task=less, problem=problem, point=carried(model, less, problem)), masks, most=most)
