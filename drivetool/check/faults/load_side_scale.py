"""The scale of a load's channel, fitted together with the drive.

Held against the motion of the motor it comes out to half a per cent, for the shaft twists between. What that leaves
in a record tells as much as a missing law. A load that reads s times its motion is one behind another gear: its
ratio is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from drivetool.check.faults.record_faults import Fault, load_fault, load_over
from drivetool.check.fit import BROKEN, Model, from_start, linear_step
from drivetool.drive import Drive
from drivetool.identify.noise import normal_under
from drivetool.identify.setup import Task, roles_of
from drivetool.logs import Experiment

BETTER = 10.0  # log likelihood that another scale must bring
FAR = 0.1  # relative change of the scale that is no matter of a twisting shaft any more


def load_scale(records: Sequence[Experiment], drive: Drive, free: Sequence[str], faults: Sequence[Fault],
               begun: Mapping[str, float]) -> tuple[tuple[Experiment, ...], list[Fault]]:
    """(records, faults) with the scale that was found for the load fitted better, where there is one.

    records  with the scale undone
    begun    values that the fit of the drive started from: a wrong channel may have led it far astray
    """
    blamed = [f for f in faults if f.gear is not None]
    name = f"{drive.shafts[-1]}.ratio" if drive.shafts else ""
    if not blamed or name in free:
        return tuple(records), list(faults)
    plain = _fitted(records, drive, free, begun)
    model = _fitted(records, drive, (*free, name), begun)
    if model is None or plain is None or model.value > plain.value - BETTER:
        return tuple(records), list(faults)
    at = model.task.free.index(name)
    ratio = float(model.point.values[at])
    change = drive.value(name) / ratio
    if abs(change - 1.0) > FAR:
        return tuple(records), list(faults)
    _, std, _ = linear_step(model.problem, normal_under(model.problem, model.point, model.noise),
                            np.ones(len(model.task.free), bool))
    found = []
    for f in faults:
        if f in blamed:
            e = next(e for e in records if e.name == f.record)
            factor = f.factor * change
            f = load_fault(e, f.code, factor, abs(factor) * float(std[at]) / ratio, f.gear or 1.0)
        found.append(f)
    told = {f.record for f in blamed}
    return tuple(load_over(e, change) if e.name in told else e for e in records), found


def _fitted(records: Sequence[Experiment], drive: Drive, free: Sequence[str],
            begun: Mapping[str, float]) -> Model | None:
    """The likelier fit of those from the drive's values and from those that it was started from."""
    task = Task(drive, tuple(n for n in drive.quantities if n in free), roles_of(records, drive), tuple(records))
    models = []
    for values in ({}, {n: begun[n] for n in task.free if n in begun}):
        with suppress(*BROKEN), np.errstate(all="ignore"):
            models.append(from_start(task.at(values)))
    return min(models, key=lambda m: m.value, default=None)
