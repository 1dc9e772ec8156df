"""The torque of a shaft as rows over the state: in contact, and independent of contact."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.drive.dual import Dual

if TYPE_CHECKING:
    from drivetool.drive.assemble import Assembly


def damping_of(assembly: Assembly, shaft: int) -> Dual:
    """Damping of a shaft in contact."""
    own, always = assembly.shafts[shaft][1], assembly.open_damping.get(shaft)
    return own if always is None else own + always


def closed_shaft(assembly: Assembly, shaft: int) -> dict[int, Dual]:
    """Torque of a shaft in contact."""
    return {assembly.n + shaft: assembly.shafts[shaft][0]} | _damper(assembly, shaft, damping_of(assembly, shaft))


def always_transmitted(assembly: Assembly, shaft: int) -> dict[int, Dual]:
    """Torque of a shaft independent of contact; all of it where there is no gap."""
    if shaft not in assembly.gaps:
        return closed_shaft(assembly, shaft)
    if assembly.drive.damping_law == "always":
        return _damper(assembly, shaft, damping_of(assembly, shaft))
    always = assembly.open_damping.get(shaft)
    return {} if always is None else _damper(assembly, shaft, always)


def in_contact(assembly: Assembly, shaft: int, damped: bool) -> dict[int, Dual]:
    """Torque of a shaft in contact only: its spring, and its own damping if that is part of the contact."""
    found = {assembly.n + shaft: assembly.shafts[shaft][0]}
    return found | _damper(assembly, shaft, assembly.shafts[shaft][1]) if damped else found


def _damper(assembly: Assembly, shaft: int, damping: Dual) -> dict[int, Dual]:
    return {shaft: damping / assembly.shafts[shaft][2], shaft + 1: -damping}
