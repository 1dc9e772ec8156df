"""Plot data: the logged torque and the required torque, with and without the causes found."""

from __future__ import annotations

import numpy as np

from drivetool.check.verdict import worst_interval
from drivetool.identify.estimate import PlotData
from drivetool.identify.inverse import InverseRegression
from drivetool.identify.motion import Equations


def torque_plots(before: InverseRegression, after: InverseRegression) -> tuple[PlotData, ...]:
    """A plot per record: both drives, their residual torque, and the speed."""
    found = []
    runs = [model.with_motion() for model in (before, after)]
    for k, (e, motion) in enumerate(zip(after.experiments, after.seen.each, strict=True)):
        base, best = (each[k] for each in runs)
        if not best.used.any():
            continue
        residuals = {"before": _used_residual(base), "after": _used_residual(best)}
        curves = {"measured": (e.time, best.torque)}
        curves |= {f"simulated {word}": (e.time, best.torque - v) for word, v in residuals.items()}
        curves |= {f"residual {word}": (e.time, v) for word, v in residuals.items()}
        curves[f"speed [{after.drive.motion_unit}/s]"] = (e.time, motion.speed)
        curves["close-up"] = (np.array(worst_interval(e.time, residuals, [slice(*s) for s in e.segments], e.step)),
                              np.zeros(2))
        found.append(PlotData("diagnosis-record", f"{e.name}: torque that the motion requires", "time [s]",
                             f"motor torque [{e.torque_unit}]", curves))
    return tuple(found)


def _used_residual(q: Equations) -> np.ndarray:
    return np.where(q.used, q.residual, np.nan)
