"""The scale of a load's channel, fitted together with the drive.

The motion of the motor identifies it to half a per cent only, because the shaft twists between. The remaining error
is as large as the effect of a missing law. A channel that reads s times its motion equals another gear ratio: the
ratio is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from drivetool.check.faults.record_faults import Fault, load_divided, load_fault
from drivetool.check.fit import FIT_ERRORS, Model, fit_from_start, linear_step
from drivetool.drive import Drive
from drivetool.identify.noise import filtered_normal_equations
from drivetool.identify.setup import Task, roles_of
from drivetool.logs import Experiment
from drivetool.quantity import name_of

MIN_SCALE_GAIN = 10.0  # log likelihood of another scale. A choice: e^10, clear of any error of the fits
MAX_SCALE_CHANGE = 0.1  # relative. A choice: a larger change is no effect of a twisting shaft


def load_scale(records: Sequence[Experiment], drive: Drive, free: Sequence[str], faults: Sequence[Fault],
               initial_fit: Mapping[str, float]) -> tuple[tuple[Experiment, ...], list[Fault]]:
    """(records, faults) with the scale that was found for the load fitted better, where there is one.

    records      corrected by the scale
    initial_fit  start values of the drive's fit: with a wrong channel it may have diverged from them
    """
    blamed = [f for f in faults if f.gear is not None]
    name = name_of(drive.shafts[-1], "ratio") if drive.shafts else ""
    if not blamed or name in free:
        return tuple(records), list(faults)
    unscaled = _likelier_fit(records, drive, free, initial_fit)
    model = _likelier_fit(records, drive, (*free, name), initial_fit)
    if model is None or unscaled is None or model.value > unscaled.value - MIN_SCALE_GAIN:
        return tuple(records), list(faults)
    at = model.task.free.index(name)
    ratio = float(model.point.values[at])
    change = drive.value(name) / ratio
    if abs(change - 1.0) > MAX_SCALE_CHANGE:
        return tuple(records), list(faults)
    _, std, _ = linear_step(model.problem, filtered_normal_equations(model.problem, model.point, model.noise),
                            np.ones(len(model.task.free), bool))
    found = []
    for f in faults:
        if f in blamed:
            e = next(e for e in records if e.name == f.record)
            factor = f.factor * change
            f = load_fault(e, f.code, factor, abs(factor) * float(std[at]) / ratio, f.gear or 1.0)
        found.append(f)
    corrected = {f.record for f in blamed}
    return tuple(load_divided(e, change) if e.name in corrected else e for e in records), found


def _likelier_fit(records: Sequence[Experiment], drive: Drive, free: Sequence[str],
            initial_fit: Mapping[str, float]) -> Model | None:
    """The likelier of two fits, from the drive's values and from its start values."""
    task = Task(drive, tuple(n for n in drive.quantities if n in free), roles_of(records, drive), tuple(records))
    models = []
    for values in ({}, {n: initial_fit[n] for n in task.free if n in initial_fit}):
        with suppress(*FIT_ERRORS), np.errstate(all="ignore"):
            models.append(fit_from_start(task.at(values)))
    return min(models, key=lambda m: m.value, default=None)
