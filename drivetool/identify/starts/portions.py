"""Another way from peak to peak of a likelihood across a gap: over the first part of the record.

Behind a light load with dry friction such a likelihood has peaks a per cent apart with walls of thousands
between them, and descents of different origin can agree on one that is not the highest. Over a part of the record
the peaks lie elsewhere: what is the best there leads past a wall. Only parts from the beginning do, since their
start states are those of the whole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from drivetool.errors import DriveToolError
from drivetool.identify.noise import Fit, Noise
from drivetool.identify.setup import Outcome, Task
from drivetool.identify.starts.search import CONFIRMED, Descent

SHARES = (0.7, 0.5, 0.85)  # of each record


def by_portions(task: Task, best: Fit, again: Callable[[Task, Noise], Outcome]) -> list[Descent[Fit]]:
    """Fits of the whole from where parts of it ended, if one of them is better than where all began.

    Otherwise none: to come back to where it began confirms nothing.
    """
    task, found = task.at_point(best.point), []
    for share in SHARES:
        part = replace(task, experiments=tuple(e.between(0.0, share * e.size * e.step) for e in task.experiments))
        try:
            first = again(part, best.noise)
            end = again(task.at_point(first.solution.point), first.fit.noise).fit
        except (DriveToolError, np.linalg.LinAlgError):  # too short a part, say: what was found without stands
            continue
        start = dict(zip(task.free, first.solution.point.values.tolist(), strict=True))
        found.append(Descent(start, f"first {100 * share:.0f} % and exact", end.value, end))
    return found if min((d.value for d in found), default=np.inf) < best.value - CONFIRMED else []
