"""Why a cause is not searched in a record."""

from __future__ import annotations

from drivetool.check.causes import Cause
from drivetool.check.fit import Model
from drivetool.check.outcome import State
from drivetool.check.starts import is_present
from drivetool.drive.effects import EFFECTS, Effect
from drivetool.quantity import owner_of, quantity_of


def why_absent(cause: Cause, base: Model) -> tuple[State, str]:
    """Why a cause has no starts: the model has it, or it is not identifiable here."""
    if cause.absent is not None:
        return cause.absent
    effect, drive = _effect(cause), base.task.drive
    owners = {"motor": drive.bodies[:1], "load": drive.bodies[1:]}.get(cause.end)
    names = [n for n in drive.quantities if effect is not None and quantity_of(n) in effect.present
             and (owners is None or owner_of(n) in owners)]
    if any(is_present(base, n) for n in names):
        return "in-the-model", "it is part of the model already"
    return "not-shown", needed(cause)


def needed(cause: Cause) -> str:
    """What a record must contain to identify a cause, after one that does not."""
    return f"it is not identifiable from this drive or record; needed: {needs_of(cause)}"


def needs_of(cause: Cause) -> str:
    """What a record must contain to identify a cause."""
    return (_effect(cause) or cause).needs


def law_of(cause: Cause) -> str:
    """The equation of a cause."""
    return (_effect(cause) or cause).law


def _effect(cause: Cause) -> Effect | None:
    return next((e for e in EFFECTS if e.code == cause.effect), None)
