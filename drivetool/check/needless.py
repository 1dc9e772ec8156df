"""Causes of earlier rounds that later ones have made needless, or a special case of what they were."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from drivetool.check.causes import FITTED
from drivetool.check.diagnosis import Round
from drivetool.check.found import Found
from drivetool.check.heldout import unlikely
from drivetool.check.hypothesis import TRIFLE
from drivetool.check.model import BROKEN, Masks, Model, fit
from drivetool.check.structure import carried, third_of, without_third
from drivetool.drive.chain import Drive
from drivetool.identify.third_mass import tip_names

NESTED = {c.code: c.special for c in FITTED if c.special}  # code -> its special cases


def spared(model: Model, found: Found, first: Drive, asked: Collection[str], masks: Masks, budget: float,
           ) -> tuple[Model, dict[str, str]]:
    """(the model without what it does not need, codes of causes that turned out their special case -> that).

    found  is told what goes
    first  the drive that the first round began with
    """
    names: dict[str, str] = {}
    for code in found.causes[:-1]:
        added = found.added[code]
        longer = model.task.drive.bodies != first.bodies
        if not added or (longer and tip_names(first, third_of(model.task.drive))[0] not in added):
            continue
        less = as_good_without(model, added, first, masks, budget)
        if less is not None:
            model = less
            found.drop(code)
            continue
        surplus = tuple(n for n in added if not n.endswith(".coulomb"))
        for simple in {*asked} & {*NESTED.get(code, ())}:
            less = as_good_without(model, surplus, first, masks) if len(surplus) < len(added) else None
            if less is not None:
                model, names[code] = less, simple
                found.rename(code, simple, [n for n in added if n not in surplus])
    return model, names


def as_good_without(model: Model, names: Sequence[str], first: Drive, masks: Masks, budget: float | None = None,
                    ) -> Model | None:
    """The model without these parameters, None if it is worse.

    budget  share of records without a cause on which these would be found beside the others: it is no worse where
            they would not be; None: it must be as likely
    """
    try:
        less = without_them(model, names, first, masks)
    except BROKEN:  # what cannot be fitted without them needs them
        return None
    lead = less.value - model.value
    chance = budget is not None and unlikely(lead, len(names)) < np.log(1.0 / budget)
    return less if lead <= TRIFLE * len(names) or chance else None


def without_them(model: Model, names: Sequence[str], first: Drive, masks: Masks) -> Model:
    """The model without these parameters, fitted again."""
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
    return fit(model.code, less, problem, carried(model, less, problem), model.noise, masks)


def renamed(one: Round, names: dict[str, str]) -> Round:
    """A round whose cause turned out a special case of what it was called."""
    if one.cause not in names:
        return one
    simple = names[one.cause]
    state = {one.cause: "worse", simple: "named"}
    return replace(one, cause=simple, candidates=tuple(
        replace(c, state=state.get(c.code, c.state)) for c in one.candidates))
