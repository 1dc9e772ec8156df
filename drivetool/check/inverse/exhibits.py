"""The torque that was logged, and what the motion asks for with and without the causes found."""

from __future__ import annotations

import numpy as np

from drivetool.check.verdict import worst
from drivetool.identify.estimate import Exhibit
from drivetool.identify.inverse import Inverse
from drivetool.identify.motion import Equations


def torque_exhibits(before: Inverse, after: Inverse) -> tuple[Exhibit, ...]:
    """A picture per record: both drives, what they leave of the torque, and the speed."""
    found = []
    runs = [model.with_motion() for model in (before, after)]
    for k, (e, motion) in enumerate(zip(after.experiments, after.seen.each, strict=True)):
        base, best = (each[k] for each in runs)
        if not best.used.any():
            continue
        left = {"before": _where_used(base), "after": _where_used(best)}
        curves = {"measured": (e.time, best.torque)}
        curves |= {f"simulated {word}": (e.time, best.torque - v) for word, v in left.items()}
        curves |= {f"residual {word}": (e.time, v) for word, v in left.items()}
        curves[f"speed [{after.drive.motion_unit}/s]"] = (e.time, motion.speed)
        curves["close-up"] = (np.array(worst(e.time, left, [slice(*s) for s in e.segments], e.step)), np.zeros(2))
        found.append(Exhibit("diagnosis-record", f"{e.name}: torque that the motion asks for", "time [s]",
                             f"motor torque [{e.torque_unit}]", curves))
    return tuple(found)


def _where_used(q: Equations) -> np.ndarray:
    return np.where(q.used, q.residual, np.nan)
