"""Restarts of a fit across a gap from its optima on the first part of the record.

For a low load inertia with dry friction the likelihood has local optima that differ by a per cent, separated by
thousands in log likelihood. Descents from different starts can agree on one that is not the global optimum. On a
part of the record the optima lie elsewhere, so its best one is a new start for the whole. Parts begin where the
record begins, since only their start states are those of the whole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from drivetool.errors import DriveToolError
from drivetool.identify.noise import Fit, Noise
from drivetool.identify.setup import Outcome, Task
from drivetool.identify.starts.search import MAX_AGREEING_LOSS, Descent

# Of each record. A choice: long enough to identify all parameters, short enough to move the local optima.
PARTIAL_RECORD_SHARES = (0.7, 0.5, 0.85)


def restart_from_partial_records(task: Task, best: Fit,
                                 refit: Callable[[Task, Noise], Outcome]) -> list[Descent[Fit]]:
    """Fits of the whole record started from the optima of its parts, if one is better than the fit before.

    Otherwise none: a return to the fit before is no independent confirmation.
    """
    task, found = task.at_point(best.point), []
    for share in PARTIAL_RECORD_SHARES:
        part = replace(task, experiments=tuple(e.between(0.0, share * e.size * e.step) for e in task.experiments))
        try:
            first = refit(part, best.noise)
            end = refit(task.at_point(first.solution.point), first.fit.noise).fit
        except (DriveToolError, np.linalg.LinAlgError):  # too short a part, for example: the fit before stands
            continue
        start = dict(zip(task.free, first.solution.point.values.tolist(), strict=True))
        found.append(Descent(start, f"first {100 * share:.0f} % and exact", end.value, end))
    return found if min((d.value for d in found), default=np.inf) < best.value - MAX_AGREEING_LOSS else []
