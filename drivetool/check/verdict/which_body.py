"""Which body has a law that any of them may have: often the record does not identify it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.check.causes import CAUSES
from drivetool.check.fit import FIT_ERRORS, Masks, Model, all_samples, fit, on_task
from drivetool.check.search import SearchResult
from drivetool.check.starts import gear_ratio
from drivetool.finding import Finding
from drivetool.quantity import names_of, owner_of

MIN_BODY_LEAD = 4.0  # log likelihood: a ratio below exp(4), about 55, does not distinguish two bodies. A choice


def unidentified_body_findings(search: SearchResult) -> list[Finding]:
    """Findings on laws that would explain the records as well on another body of the drive."""
    bodies, found = search.model.task.drive.bodies, []
    for code in search.found.causes:
        if not CAUSES[code].power:
            continue
        names = names_of(bodies, CAUSES[code].sizes[0])
        for name in [n for n in names if n in search.found.added.get(code, ())]:
            found += _other_body_findings(search, name, [n for n in names if n != name], CAUSES[code].power)
    return found


def _other_body_findings(search: SearchResult, name: str, others: Sequence[str], power: int) -> list[Finding]:
    """The likeliest of the other bodies, where the record does not distinguish it from the one with the law."""
    alike = []
    for other in others:
        try:
            there = refit_on_body(search.model, name, other, power, all_samples(search.model.problem))
        except FIT_ERRORS:  # then no finding
            continue
        if there.value < search.model.value + MIN_BODY_LEAD:
            alike.append((there.value, other, there))
    return [_finding(search, name, other, there) for _, other, there in sorted(alike, key=lambda a: a[0])[:1]]


def refit_on_body(model: Model, name: str, other: str, power: int, masks: Masks) -> Model:
    """The model with a parameter of one body made that of another, fitted again."""
    task = model.fitted
    here, there = (gear_ratio(model, owner_of(n)) for n in (name, other))
    values = {n: v for n, v in task.drive.values.items() if n != name}
    drive = replace(task.drive, values=values | {other: task.drive.value(name) * (there / here) ** power})
    task = replace(task, drive=drive).with_free({*task.free, other} - {name})
    return fit(on_task(model, task), masks)


def _finding(search: SearchResult, name: str, other: str, there: Model) -> Finding:
    value, lead = there.fitted.drive.value(other), there.value - search.model.value
    both, logged = "look at both ends of the drive.", search.model.task.roles.outputs
    return Finding(
        "note", "location-not-identifiable",
        f"The model has {name}; {other} {value:.4g} {there.task.drive.unit(other)} explains the record equally "
        f"well (log likelihoods differ by {abs(lead):.2g}).",
        {other: float(value), "log_likelihood": float(lead)},
        # The body hardly changes the speeds; it changes the shaft torque.
        both.capitalize() if "shaft_torque" in logged else f"Log the shaft torque too, or {both}")
