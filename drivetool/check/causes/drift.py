"""Friction that falls while the drive warms up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Bounds, Start, added, motion, outer_bodies, present, torque_size

if TYPE_CHECKING:
    from drivetool.check.fit import Model
    from drivetool.identify.setup import Task

SMALL = 1e-6  # of the torque's spread, to start from
WARM = (0.15, 0.4, 1.0)  # time constants to start from, over the length of the record
# The same: what takes longer is a constant by another name, what takes less a start.
QUICKEST, SLOWEST = 0.05, 3.0
TIME = ".drift_time"


def _starts(base: Model) -> list[Start]:
    """Of the motor's friction, or of all alike; with a sensor behind the shaft also of both ends by themselves."""
    drive, size, found = base.task.drive, torque_size(base), []
    dry = any(n.endswith(".coulomb") and present(base, n) for n in drive.quantities)
    owners = (*drive.bodies, "friction")
    if any(present(base, f"{owner}.drift_{kind}") for owner in owners for kind in ("viscous", "coulomb")):
        return []
    apart = any(not role.startswith("motor") for role in base.task.roles.outputs)
    for bodies in [drive.bodies[:1], *([outer_bodies(base)] if apart and len(drive.bodies) > 1 else [])]:
        names = [f"{body}.drift_viscous" for body in bodies] + [
            f"{body}.drift_coulomb" for body in bodies
            if (dry and body == drive.bodies[0]) or present(base, f"{body}.coulomb")]
        for share in WARM:
            values = {n: (SMALL * size if n.endswith("coulomb") else 0.0) for n in names}
            times = {f"{body}{TIME}": share * motion(base)[1] for body in bodies}
            found.append(added(base, {**values, **times}, names))
    if len(drive.bodies) > 1:
        names = ["friction.drift_viscous", *["friction.drift_coulomb"] * dry]
        for share in WARM:
            time = share * motion(base)[1]
            found.append(added(base, {**dict.fromkeys(names, 0.0), f"friction{TIME}": time}, names))
    return found


def _bounds(base: Model, task: Task) -> Bounds:
    low, high = (share * motion(base)[1] for share in (QUICKEST, SLOWEST))
    return {n: (low, high) for n in task.free if n.endswith(TIME)}


def _endless(model: Model, _: Model) -> str:
    """Whether a time constant lies on a bound."""
    values = zip(model.task.free, model.point.values, model.problem.low, model.problem.high, strict=True)
    at_bound = any(n.endswith(TIME) and not 1.01 * low < value < 0.99 * high for n, value, low, high in values)
    return "it would take longer than the record to show, or no time" if at_bound else ""


CAUSES = (Cause(
    "friction-drift", "friction that falls while warming up",
    "Friction was higher at the start of the record and fell as the drive warmed up.",
    "Warm up first, or record until nothing changes.", "friction-drift", starts=_starts, imposed=_starts,
    sizes=("drift_coulomb", "drift_viscous", "drift_time"), further=("warm-up",), bounds=_bounds,
    implausible=_endless, located=(TIME,), searched=(TIME,), event=True,
    alike={"load-step": "Repeat the record warm: a drift is gone, a load step is not where it was.",
           "quadratic-drag": "Repeat the record warm and at several speeds."}),)
