"""Whether a drive and its laws explain held-out parts of the record.

Where the motion hardly repeats, laws explain any torque that they are fitted to, that of another axis too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.errors import NotEnoughData
from drivetool.identify.laws.candidates import CandidateSet
from drivetool.identify.laws.fit_with_laws import MAX_QUICK_ITERATIONS
from drivetool.identify.noise import fit_innovations
from drivetool.identify.setup import HELD_OUT_SHARE, Outcome, Task, first_point

REFITTED_CANDIDATES = ("white", "coloured", "white, laws", "coloured, laws")
HELD_OUT_RUN_LENGTH = 4.0  # s of a free run: over one second a straight line approximates any slow motion


def held_out_errors(field: CandidateSet) -> tuple[float, float]:
    """(free-run error of the best fit on the held-out parts, error of straight lines of the speed there).

    Held out are the end and the start in turn, so that no single stretch decides. Each candidate is refitted to the
    rest of the record, with the laws found on the whole record. Both are zero
    where the parts are too short, or straight lines leave noise alone.
    """
    errors: dict[int, list[float]] = {}
    length = max(HELD_OUT_RUN_LENGTH, field.judge.length)
    straight = []
    fits = {id(o): o for name in REFITTED_CANDIDATES if (o := field.candidates[name].outcome) is not None
            and o.fit is not None}
    try:
        for late in (True, False):
            straight.append(field.judge.straight_line_error(_part_of_record(field.task, late, held=True), length))
            for key, fit in fits.items():
                errors.setdefault(key, []).append(field.judge.error(_refit_without(fit, late), length))
    except NotEnoughData:
        return 0.0, 0.0
    found = [float(np.hypot(*each)) for each in errors.values()]
    return min(found, default=0.0), float(np.hypot(*straight))


def _refit_without(before: Outcome, late: bool) -> Task:
    """The held-out part, with the drive fitted to the rest."""
    whole = before.fitted
    other = _part_of_record(whole, late, held=False)
    problem = other.problem()
    fit = fit_innovations(problem, first_point(other.drive, problem, other.roles), before.fit.noise,
                          near_optimum=True,
                          max_rounds=MAX_QUICK_ITERATIONS)
    return _part_of_record(whole.at_point(fit.point), late, held=True)


def _part_of_record(task: Task, late: bool, held: bool) -> Task:
    """The last or first part of every recording, or the rest."""
    share = (1.0 - HELD_OUT_SHARE, 1.0) if late else (0.0, HELD_OUT_SHARE)
    first, last = share if held else (0.0, share[0]) if late else (share[1], 1.0)
    ends = [e.size * e.step for e in task.experiments]
    cut = tuple(e.between(first * end, last * end) for e, end in zip(task.experiments, ends, strict=True))
    return replace(task, experiments=cut, start=task.start if first == 0.0 else {})
