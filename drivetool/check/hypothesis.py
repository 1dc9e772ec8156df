"""The fit of one cause on top of the base, and what the record could have shown of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.candidates import Candidate, Start, why_absent
from drivetool.check.diagnosis import State
from drivetool.check.model import Masks, Model, fit
from drivetool.check.structure import carried
from drivetool.errors import DriveToolError
from drivetool.identify.least_squares import schur
from drivetool.identify.noise import normal_under
from drivetool.identify.problem import Normal, Point, Problem
from drivetool.identify.setup import problem_of

TRIES = 3  # starts that are fitted to the end of a first round
TRIFLE = 2.0  # log likelihood gained on the records it was fitted to, below which a cause is not judged


@dataclass(frozen=True)
class Tried:
    """A cause after its fit to the whole record.

    model     None if there was nothing to fit, or every fit failed: `absent` says which, `reason` why
    smallest  standard deviation of each amplitude at the base: what the record resolves
    """

    candidate: Candidate
    model: Model | None
    smallest: dict[str, float]
    reason: str = ""
    absent: State | None = None


def attempt(candidate: Candidate, base: Model, masks: Masks) -> Tried:
    """Fit a cause from all its starts to the samples of a mask; a fit that fails is a result."""
    try:
        starts = candidate.starts(base)
    except (DriveToolError, np.linalg.LinAlgError, FloatingPointError) as error:
        return Tried(candidate, None, {}, f"its start could not be found: {error}", "failed")
    if not starts:
        state, reason = why_absent(candidate, base)
        return Tried(candidate, None, {}, reason, state)
    begun, resolved, reason = [], {}, "every fit failed"
    for start in starts:
        try:
            problem, point, std = begin(base, start)
            resolved = {n: min(v, resolved.get(n, np.inf)) for n, v in std.items()} | {
                n: v for n, v in resolved.items() if n not in std}
            begun.append(fit(candidate.code, start.task, problem, point, base.noise, masks, rounds=1,
                             renew=False, most=5))
        except (DriveToolError, np.linalg.LinAlgError, FloatingPointError) as error:
            reason = str(error)
    begun = sorted((m for m in begun if np.isfinite(m.value)), key=lambda m: m.value)[:TRIES]
    ends = []
    for model in begun[:1] if begun and begun[0].value < begun[-1].value - 50.0 else begun[:2]:
        try:
            ends.append(fit(model.code, model.task, model.problem, model.point, model.noise, masks))
        except (DriveToolError, np.linalg.LinAlgError, FloatingPointError) as error:
            reason = str(error)
    if not ends:
        return Tried(candidate, None, resolved, f"its fit failed: {reason}", "failed")
    return Tried(candidate, min(ends, key=lambda m: m.value), resolved)


def begin(base: Model, start: Start) -> tuple[Problem, Point, dict[str, float]]:
    """(problem, first point, std of the amplitudes at the base) of a start.

    Amplitudes begin where one linear step from the base puts them; from zero the limits of the
    usual steps would take many.
    """
    task = start.task
    problem = problem_of(task.drive, task.free, task.roles, base.problem.traces)
    problem = _without_angle(problem, task)
    point = carried(base, task, problem)
    if not start.amplitudes:
        return problem, point, {}
    normal = normal_under(problem, point, base.noise)
    moves = np.array([n in start.amplitudes or n in base.task.free for n in task.free])
    step, std = linear_step(problem, normal, moves)
    values = point.values.copy()
    for name in start.amplitudes:
        j = task.free.index(name)
        values[j] = np.clip(values[j] + step[j], problem.low[j], problem.high[j])
    return problem, Point(values, point.starts), {n: float(std[task.free.index(n)]) for n in start.amplitudes}


def linear_step(problem: Problem, normal: Normal, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(k,) Gauss-Newton step of the parameters that move, and their standard deviations."""
    matrix, slope, _ = schur(normal)
    i = np.flatnonzero(moves & (np.diag(matrix) > 0.0))
    step, std = np.zeros(len(slope)), np.full(len(slope), np.inf)
    size = np.sqrt(np.diag(matrix)[i])
    inverse = np.linalg.pinv(matrix[np.ix_(i, i)] / np.outer(size, size), rcond=1e-10, hermitian=True)
    step[i] = -(inverse @ (slope[i] / size)) / size
    variance = normal.cost / max(problem.count - problem.unknowns, 1)
    std[i] = np.sqrt(variance * np.maximum(np.diag(inverse), 0.0)) / size
    return step, std


def _without_angle(problem: Problem, task) -> Problem:
    """Where no angle is measured, that of one record is free to choose: the phase of a ripple goes with it."""
    if len(problem.traces) > 1 or any(role.endswith("angle") for role in task.roles.outputs):
        return problem
    from drivetool.check.structure import states_of

    names = states_of(task, problem.traces[0].step)
    keep = [j for j in problem.free_start if names[j] != "angle"]
    return replace(problem, free_start=np.array(keep))
