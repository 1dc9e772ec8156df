"""Which body has a law that any of them may have: often the record does not tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.check.causes import CAUSES
from drivetool.check.fit import BROKEN, Masks, Model, carried, everything, fit
from drivetool.check.starts import turns
from drivetool.errors import Finding

if TYPE_CHECKING:
    from drivetool.check.search import Searched

ALIKE = 4.0  # log likelihood within which the record does not tell


def untold_bodies(search: Searched) -> list[Finding]:
    """What to say of laws that would explain the records as well on another body of the drive."""
    bodies, found = search.model.task.drive.bodies, []
    for code in search.found.causes:
        if not CAUSES[code].power:
            continue
        names = [f"{b}.{CAUSES[code].sizes[0]}" for b in bodies]
        for name in [n for n in names if n in search.found.added.get(code, ())]:
            found += _elsewhere(search, name, [n for n in names if n != name], CAUSES[code].power)
    return found


def _elsewhere(search: Searched, name: str, others: Sequence[str], power: int) -> list[Finding]:
    """The likeliest of the other bodies, where the record does not tell it from the one that has the law."""
    alike = []
    for other in others:
        try:
            there = moved(search.model, name, other, power, everything(search.model.problem))
        except BROKEN:  # then nothing is said of it
            continue
        if there.value < search.model.value + ALIKE:
            alike.append((there.value, other, there))
    return [_finding(search, name, other, there) for _, other, there in sorted(alike, key=lambda a: a[0])[:1]]


def moved(model: Model, name: str, other: str, power: int, masks: Masks) -> Model:
    """The model with a parameter of one body made that of another, fitted again."""
    task = model.fitted
    here, there = (turns(model, n.partition(".")[0]) for n in (name, other))
    values = {n: v for n, v in task.drive.values.items() if n != name}
    drive = replace(task.drive, values=values | {other: task.drive.value(name) * (there / here) ** power})
    task = replace(task, drive=drive, free=tuple(n for n in drive.quantities if n in {*task.free, other} - {name}))
    problem = task.problem()
    return fit(replace(model, task=task, problem=problem, point=carried(model, task, problem)), masks)


def _finding(search: Searched, name: str, other: str, there: Model) -> Finding:
    value, lead = there.fitted.drive.value(other), there.value - search.model.value
    both, logged = "look at both ends of the drive.", search.model.task.roles.outputs
    return Finding(
        "note", "body-not-told",
        f"The drive has {name}; the record does not tell it from {other} {value:.4g} "
        f"{there.task.drive.unit(other)} ({abs(lead):.2g} of log likelihood between them).",
        {other: float(value), "log_likelihood": float(lead)},
        # Speeds hardly differ by it: what the shaft carries does.
        both.capitalize() if "shaft_torque" in logged else f"Log the shaft torque too, or {both}")
