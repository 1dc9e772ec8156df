"""Whether a drive and its laws explain a part of the record that they were not fitted to.

Laws over a motion that hardly repeats explain any torque where they are fitted, that of another axis too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.errors import NotEnoughData
from drivetool.identify.laws.candidates import Field
from drivetool.identify.laws.fit_with_laws import QUICK
from drivetool.identify.noise import fit_innovations
from drivetool.identify.setup import Outcome, Task, first_point

FITTED = ("white", "coloured", "white, laws", "coloured, laws")
PART = 0.3  # of every recording: its last and its first in turn, so that no single stretch decides
LENGTH = 4.0  # s of a free run: in one second a straight line comes near any slow motion


def held_out_errors(field: Field) -> tuple[float, float]:
    """(error of the best fit's free runs over the parts held out, error of straight lines of the speed there).

    Each fit is made again on the rest of the record, with the laws that the whole record has shown. Both zero where
    the parts are too short, or straight lines leave noise alone.
    """
    errors: dict[int, list[float]] = {}
    straight = []
    fits = {id(o): o for name in FITTED if (o := field.candidates[name].outcome) is not None and o.fit is not None}
    try:
        for late in (True, False):
            straight.append(field.judge.straight(_part(field.task, late, held=True), LENGTH))
            for key, fit in fits.items():
                errors.setdefault(key, []).append(field.judge.error(_refitted(fit, late), LENGTH))
    except NotEnoughData:
        return 0.0, 0.0
    found = [float(np.hypot(*each)) for each in errors.values()]
    return min(found, default=0.0), float(np.hypot(*straight))


def _refitted(before: Outcome, late: bool) -> Task:
    """The part held out, with the drive fitted to the other."""
    whole = before.task.at_point(before.solution.point)
    other = _part(whole, late, held=False)
    problem = other.problem()
    fit = fit_innovations(problem, first_point(other.drive, problem, other.roles), before.fit.noise, arrived=True,
                          most=QUICK)
    return _part(whole.at_point(fit.point), late, held=True)


def _part(task: Task, late: bool, held: bool) -> Task:
    """The last or first part of every recording, or all but that."""
    share = (1.0 - PART, 1.0) if late else (0.0, PART)
    first, last = share if held else (0.0, share[0]) if late else (share[1], 1.0)
    ends = [e.size * e.step for e in task.experiments]
    cut = tuple(e.between(first * end, last * end) for e, end in zip(task.experiments, ends, strict=True))
    return replace(task, experiments=cut, start=task.start if first == 0.0 else {})
