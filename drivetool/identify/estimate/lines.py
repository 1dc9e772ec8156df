"""The table of an estimate: a line from a value of the drive, all lines in order, and those with an interval."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from drivetool.drive import Drive
from drivetool.identify.estimate.estimate import Covariance, Parameter


def line_of(drive: Drive, name: str, value: float | None) -> Parameter:
    """A fitted value with the unit and the start value of the drive; it has no interval yet."""
    return Parameter(name=name, value=value, unit=drive.unit(name), start=drive.values.get(name))


def held_line(drive: Drive, name: str, reason: str) -> Parameter:
    """The drive's own value, held for a reason."""
    return line_of(drive, name, drive.value(name)).replace(status="held", reason=reason)


def as_given(name: str) -> str:
    """Why a value is held that a step does not fit at all."""
    return "as given; not fitted in this step"


def whole_table(lines: Iterable[Parameter], drive: Drive, why_held: Callable[[str], str] = as_given,
                replaced: Sequence[str] = ()) -> tuple[Parameter, ...]:
    """The lines, and every further value of the drive as held, in the order of the drive.

    why_held  name -> reason; replaced: names whose value others take the place of
    """
    held = {n: Parameter(name=n, value=float(v), unit=drive.unit(n), start=float(v), status="held",
                         reason=why_held(n)) for n, v in drive.values.items() if n not in replaced}
    return in_order((held | {p.name: p for p in lines}).values(), drive)


def in_order(lines: Iterable[Parameter], drive: Drive) -> tuple[Parameter, ...]:
    """The lines in the order of the drive."""
    by_name = {p.name: p for p in lines}
    return tuple(by_name[n] for n in drive.quantities if n in by_name)


def with_intervals_only(covariance: Covariance | None, lines: Iterable[Parameter]) -> Covariance | None:
    """The covariance of the parameters that have an interval."""
    known = {p.name for p in lines if p.std is not None}
    return covariance and covariance.part(n for n in covariance.names if n in known)
