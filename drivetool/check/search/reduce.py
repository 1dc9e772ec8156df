"""A model without some of what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.check.fit.model import MOST, Masks, Model, fit
from drivetool.check.fit.structure import carried, third_of, without_third
from drivetool.drive.chain import Drive
from drivetool.identify.third_mass import tip_names


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
