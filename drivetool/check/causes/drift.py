"""Friction that falls while the drive warms up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import (
    NEGLIGIBLE_FRICTION_SHARE,
    Bounds,
    Start,
    is_present,
    outer_bodies,
    speed_and_duration,
    start_with,
    torque_size,
)
from drivetool.quantity import name_of, names_of, quantity_of

if TYPE_CHECKING:
    from drivetool.check.fit import Model
    from drivetool.identify.setup import Task

TIME_CONSTANT_STARTS = (0.15, 0.4, 1.0)  # over the length of the record, as starts (a choice within the bounds)
# Over the length of the record: a longer drift is a constant, a shorter one is the initial transient.
MIN_TIME_CONSTANT, MAX_TIME_CONSTANT = 0.05, 3.0
TIME_CONSTANT = "drift_time"


def _starts(base: Model) -> list[Start]:
    """Of the motor's friction, or of all by one factor; with a sensor behind the shaft also of each end."""
    drive, size, found = base.task.drive, torque_size(base), []
    dry = any(quantity_of(n) == "coulomb" and is_present(base, n) for n in drive.quantities)
    owners = (*drive.bodies, "friction")
    if any(is_present(base, name_of(owner, f"drift_{kind}"))
           for owner in owners for kind in ("viscous", "coulomb")):
        return []
    separable = any(not role.startswith("motor") for role in base.task.roles.outputs)
    for bodies in [drive.bodies[:1], *([outer_bodies(base)] if separable and len(drive.bodies) > 1 else [])]:
        names = names_of(bodies, "drift_viscous") + [
            name_of(body, "drift_coulomb") for body in bodies
            if (dry and body == drive.bodies[0]) or is_present(base, name_of(body, "coulomb"))]
        for share in TIME_CONSTANT_STARTS:
            values = {n: (NEGLIGIBLE_FRICTION_SHARE * size if quantity_of(n) == "drift_coulomb" else 0.0)
                      for n in names}
            times = {name_of(body, TIME_CONSTANT): share * speed_and_duration(base)[1] for body in bodies}
            found.append(start_with(base, {**values, **times}, names))
    if len(drive.bodies) > 1:
        names = ["friction.drift_viscous", *["friction.drift_coulomb"] * dry]
        for share in TIME_CONSTANT_STARTS:
            time = share * speed_and_duration(base)[1]
            values = {**dict.fromkeys(names, 0.0), name_of("friction", TIME_CONSTANT): time}
            found.append(start_with(base, values, names))
    return found


def _bounds(base: Model, task: Task) -> Bounds:
    low, high = (share * speed_and_duration(base)[1] for share in (MIN_TIME_CONSTANT, MAX_TIME_CONSTANT))
    return {n: (low, high) for n in task.free if quantity_of(n) == TIME_CONSTANT}


def _time_constant_at_bound(model: Model, _: Model) -> str:
    """Whether a time constant lies on a bound."""
    values = zip(model.task.free, model.point.values, model.problem.low, model.problem.high, strict=True)
    at_bound = any(quantity_of(n) == TIME_CONSTANT and not 1.01 * low < value < 0.99 * high
                   for n, value, low, high in values)
    return "its time constant would be too long or too short for the record" if at_bound else ""


CAUSES = (Cause(
    "friction-drift", "friction that falls while warming up",
    "Friction was higher at the start of the record and fell as the drive warmed up.",
    "Warm up first, or record until nothing changes.", "friction-drift", starts=_starts, imposed=_starts,
    sizes=("drift_coulomb", "drift_viscous", "drift_time"), further=("warm-up",), bounds=_bounds,
    implausible=_time_constant_at_bound, located=(TIME_CONSTANT,), searched=(TIME_CONSTANT,), event=True,
    alike={"load-step": "Repeat the record warm: a warm-up drift then disappears, and a load step occurs at "
                        "another time.",
           "quadratic-drag": "Repeat the record warm and at several speeds."}),)
