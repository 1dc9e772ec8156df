"""The best settings under a limit of the sensitivity, by a deterministic global search.

The surface of |error| integrals has kinks where a lobe appears, and the limit is a boundary with
corners. For every integral time the allowed gains are known as intervals (speed_loop/sensitivity.py); a
grid over them finds the basins. Inside a basin the gain is a position between the two ends of its
interval, so that the local search moves along the boundary as easily as away from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from drivetool.errors import BadParameters
from drivetool.tune.optimisation.criteria import Criterion, criterion_value, criterion_values
from drivetool.tune.speed_loop import (
    Loop,
    Plant,
    Settings,
    forbidden_gains,
    lag_time,
    max_sensitivity,
    plant,
    rate_range,
    with_fine_peaks,
)

# Points of the grid: integral times, K of a second controller, gains. A choice: a coarser grid may miss a basin,
# and the time of a search grows with their product.
GRID_TIMES, GRID_SECOND_GAINS, GRID_POSITIONS = 56, 14, 11
# Of K. A choice: beyond it the first or the second controller alone determines the response.
SECOND_GAIN_RANGE = (0.08, 4.0)
MAX_BASINS = 4  # A choice: each costs a local search; with few basins a local optimum may remain.
MAX_RESTARTS = 6  # A choice: the restarts end earlier when one improves the criterion by less than 1e-6.
# First simplex steps in log Ti, log K and position, about the spacing of the grid or a fraction of it.
COARSE_STEPS, MIDDLE_STEPS, FINE_STEPS = (0.06, 0.15, 0.1), (0.02, -0.04, 0.1), (3e-3, 3e-3, 0.03)
# Changes of log Ti and log K that a restart tries, from far below the grid spacing to above it.
LOG_NUDGES = (0.0, *(side * size for size in (1e-4, 5e-4, 2e-3, 1e-2, 0.05, 0.2) for side in (1, -1)))


@dataclass(frozen=True)
class TuneLimits:
    """The constraints of a design.

    sensitivity  largest Ms
    gain         largest Kp [torque/speed]; infinite: no limit
    """

    sensitivity: float = 2.0
    gain: float = np.inf


@dataclass(frozen=True)
class TuningProblem:
    """A drive in its loop, and possible other drives.

    scenarios  loops that share the sensitivity limit; the nominal one alone, or draws
    """

    loop: Loop
    plant: Plant
    scenarios: tuple[tuple[Loop, Plant], ...]
    criterion: Criterion
    limits: TuneLimits

    @property
    def has_second_gain(self) -> bool:
        """Whether K is optimised."""
        return self.loop.wiring.configuration == "miso"

    @cached_property
    def gains(self) -> tuple[float, float]:
        """The range of gains: a crossover from far below the resonance to far above the lags."""
        slow, fast = rate_range(self.loop.drive, self.loop.wiring)
        total = self.loop.drive.referred_inertia
        return 1e-3 * slow * total, min(1e3 * fast * total, self.limits.gain)

    @cached_property
    def times(self) -> tuple[float, float]:
        """The range of integral times [s]."""
        slow, fast = rate_range(self.loop.drive, self.loop.wiring)
        return 0.2 / fast, 300.0 / slow


@dataclass(frozen=True)
class Optimum:
    """The optimum: settings and the criterion's value."""

    settings: Settings
    value: float


def tuning_problem(loop: Loop, criterion: Criterion, limits: TuneLimits) -> TuningProblem:
    """The problem for `optimum` with the nominal drive as the only one."""
    own = plant(loop.drive, loop.wiring)
    return TuningProblem(loop, own, ((loop, own),), criterion, limits)


def optimum(task: TuningProblem) -> Optimum | None:
    """The best settings, or None if none is allowed.

    raises  BadParameters: without lag or dead time in the loop any gain is allowed
    """
    shapes = grid_shapes(task)
    basins = _find_basins(task, shapes)
    if not basins:
        return None
    best = min((_polish(task, start, COARSE_STEPS) for start in basins), key=lambda found: found.value)
    for _ in range(MAX_RESTARTS):  # a simplex may collapse along a kink; a new one can leave it
        retried = _polish(task, _restart_nearby(task, best.settings), MIDDLE_STEPS)
        improvement, best = best.value - retried.value, min(best, retried, key=lambda found: found.value)
        if improvement < 1e-6 * best.value:
            break
    return _refine_optimum(task, best)


def _refine_optimum(task: TuningProblem, best: Optimum) -> Optimum:
    """The optimum on a grid with its own sensitivity peaks, so that the limit holds exactly."""
    limit = working = task.limits.sensitivity
    for _ in range(5):
        task = replace(
            task, limits=replace(task.limits, sensitivity=working),
            scenarios=tuple((loop, with_fine_peaks(own, best.settings)) for loop, own in task.scenarios))
        best = _polish(task, _restart_nearby(task, best.settings), FINE_STEPS)
        found = max(sensitivity_of(loop, own, best.settings) for loop, own in task.scenarios)
        if found - limit <= 1e-9:
            break
        # Corrected as a distance from -1, which stays positive even for an unstable loop.
        working = 1.0 / (1.0 / working + (1.0 / limit - 1.0 / found) * (1.0 + 1e-3))
    return best


def sensitivity_of(loop: Loop, own: Plant, settings: Settings) -> float:
    """Ms, infinite if the loop is unstable."""
    stable = np.linalg.eigvals(loop.matrix(settings)).real.max() < 0.0
    return max_sensitivity(own, settings)[0] if stable else np.inf


def allowed_gains(task: TuningProblem, integral_time: float, second: float) -> np.ndarray:
    """(m, 2) gains that keep the limits, in rising order.

    Between two forbidden intervals no pole can cross the axis, so one check of stability covers all gains
    between them.
    """
    low, high = task.gains
    if low >= high:
        return np.zeros((0, 2))
    kept = np.array([[low, high]])
    for loop, own in task.scenarios:
        bad = forbidden_gains(own.shape(integral_time, second), own.w, task.limits.sensitivity)
        bad = bad[(bad[:, 1] > low) & (bad[:, 0] < high)]
        ends = np.clip(np.r_[low, bad.ravel(), high].reshape(-1, 2), low, high)
        ends = ends[ends[:, 1] > ends[:, 0] * (1.0 + 1e-9)]
        if len(ends):
            middle = np.sqrt(ends[:, 0] * ends[:, 1])
            many = np.ones_like(middle)
            poles = np.linalg.eigvals(loop.matrices(middle, integral_time * many, second * many))
            ends = ends[poles.real.max(axis=1) < 0.0]
        kept = ends if kept[0, 0] == low and kept[0, 1] == high else _intersect_intervals(kept, ends)
        if not len(kept):
            break
    return kept


def _intersect_intervals(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(m, 2) where two rising rows of intervals overlap."""
    low = np.maximum(first[:, None, 0], second[None, :, 0]).ravel()
    high = np.minimum(first[:, None, 1], second[None, :, 1]).ravel()
    not_empty = high > low * (1.0 + 1e-9)
    order = np.argsort(low[not_empty], kind="stable")
    return np.column_stack([low[not_empty], high[not_empty]])[order]


def grid_shapes(task: TuningProblem) -> np.ndarray:
    """(m, 2) integral time and K of the grid."""
    times = np.geomspace(*task.times, GRID_TIMES)
    seconds = np.geomspace(*SECOND_GAIN_RANGE, GRID_SECOND_GAINS) if task.has_second_gain else np.ones(1)
    return np.array([(ti, k) for ti in times for k in seconds])


@dataclass(frozen=True)
class _GridPoint:
    """A point of the grid: log Ti, log K, position in the interval, and the gain there."""

    point: np.ndarray
    gain: float
    value: float


def _find_basins(task: TuningProblem, shapes: np.ndarray) -> list[_GridPoint]:
    """The best points of the grid with a minimum distance from each other."""
    rows = [(*shape, *ends) for shape in shapes for ends in allowed_gains(task, *shape)]
    if not rows:
        return []
    shape, ends = np.hsplit(np.repeat(rows, GRID_POSITIONS, axis=0), 2)
    position = np.tile(np.linspace(0.0, 1.0, GRID_POSITIONS), len(rows))
    gain = _gain_at(ends[:, 0], ends[:, 1], position)
    cost = criterion_values(task.loop, task.criterion, gain, shape[:, 0], shape[:, 1])
    best = np.argmin(cost.reshape(-1, GRID_POSITIONS), axis=1) + GRID_POSITIONS * np.arange(len(rows))
    min_distance = 2.5 * np.log(np.divide(*task.times[::-1])) / GRID_TIMES
    found: list[_GridPoint] = []
    for k in best[np.argsort(cost[best], kind="stable")]:
        point = np.array([*np.log(shape[k]), position[k]])
        if np.isfinite(cost[k]) and all(
                np.abs(point[:2] - other.point[:2]).max() > min_distance or abs(np.log(gain[k] / other.gain)) > 1.0
                for other in found):
            found.append(_GridPoint(point, gain[k], cost[k]))
        if len(found) == MAX_BASINS:
            break
    return found


def _gain_at(low, high, position):
    """Gain at a position from 0 to 1 between the ends, on a logarithmic scale."""
    return low * (high / low) ** position


def _restart_nearby(task: TuningProblem, settings: Settings) -> _GridPoint:
    """A restart after a small change of the limit: the best allowed settings nearby.

    Where two peaks of the sensitivity meet, the interval of the optimum may end very close to it.
    """
    best = None
    for second in settings.second * np.exp(LOG_NUDGES if task.has_second_gain else (0.0,)):
        for ti in settings.integral_time * np.exp(LOG_NUDGES):
            ends = _nearest_interval(task, ti, second, settings.gain)
            if ends is None:
                continue
            gain = float(np.clip(settings.gain, *ends))
            cost = criterion_value(task.loop, task.criterion, Settings(gain, float(ti), float(second)))
            if best is None or cost < best.value:
                position = np.log(gain / ends[0]) / np.log(ends[1] / ends[0])
                best = _GridPoint(np.array([np.log(ti), np.log(second), position]), gain, cost)
    return best or _GridPoint(np.array([np.log(settings.integral_time), np.log(settings.second), 0.5]),
                          settings.gain, np.inf)


def _polish(task: TuningProblem, start: _GridPoint, step: Sequence[float]) -> Optimum:
    """Nelder-Mead over log Ti, log K and position, and along the nearer end of the interval."""
    shape = [0, 1] if task.has_second_gain else [0]
    inside = _nelder_mead(task, start, [*shape, 2], None, step)
    end = 1.0 if start.point[2] > 0.5 else 0.0
    return min(inside, _nelder_mead(task, start, shape, end, step), key=lambda found: found.value)


@dataclass
class _Objective:
    """The criterion over log Ti, log K and position, near a start; stores the best point evaluated."""

    task: TuningProblem
    start: _GridPoint
    free: list[int]
    end: float | None
    best: Optimum

    def __call__(self, x: np.ndarray) -> float:
        """x: the free coordinates; outside the allowed region a penalty above all values."""
        point = self.start.point.copy()
        point[self.free] = x
        if self.end is not None:
            point[2] = self.end
        ti, second = np.exp(point[:2])
        worst = 1e3 * self.start.value if np.isfinite(self.start.value) else 1e300
        ends = _nearest_interval(self.task, ti, second, self.start.gain)
        if ends is None:
            return worst * (1.0 + np.abs(x - self.start.point[self.free]).sum())
        gain = _gain_at(*ends, np.clip(point[2], 0.0, 1.0))
        settings = Settings(float(gain), float(ti), float(second))
        found = criterion_value(self.task.loop, self.task.criterion, settings)
        if found < self.best.value:
            self.best = Optimum(settings, found)
        return found if np.isfinite(found) else worst


def _nelder_mead(task: TuningProblem, start: _GridPoint, free: list[int], end: float | None,
                 step: Sequence[float]) -> Optimum:
    """One Nelder-Mead run over some of the three coordinates."""
    settings = Settings(float(start.gain), *(float(v) for v in np.exp(start.point[:2])))
    trial = _Objective(task, start, free, end, Optimum(settings, start.value))
    x0 = start.point[free]
    simplex = np.vstack([x0, x0 + np.diag([_first_step(x0[i], k, step[k]) for i, k in enumerate(free)])])
    scipy.optimize.minimize(trial, x0, method="Nelder-Mead", options={
        "initial_simplex": simplex, "xatol": 1e-7, "fatol": 1e-9 * start.value, "maxfev": 90 * len(free)})
    return trial.best


def _first_step(x: float, coordinate: int, step: float) -> float:
    """The first step of a position points into its interval."""
    return -step if coordinate == 2 and x > 0.5 else step


def _nearest_interval(task: TuningProblem, integral_time: float, second: float, gain: float) -> np.ndarray | None:
    """The allowed interval nearest to a gain."""
    ends = allowed_gains(task, integral_time, second)
    if not len(ends):
        return None
    distance = np.maximum(np.log(ends[:, 0] / gain), np.log(gain / ends[:, 1]))
    return ends[int(np.argmin(distance))]


def lowest_sensitivity(task: TuningProblem) -> float:
    """The lowest limit that can be kept, to 1 %; for the error message of a limit that cannot."""
    shapes = grid_shapes(task)
    low, high = 1.0, 64.0
    while high > low * 1.01:
        middle = np.sqrt(low * high) if low > 1.0 else 0.5 * (low + high)
        trial = replace(task, limits=replace(task.limits, sensitivity=middle))
        if any(len(allowed_gains(trial, *shape)) for shape in shapes):
            high = middle
        else:
            low = middle
    return high


def check_gain_is_limited(task: TuningProblem) -> None:
    """Reject a loop without a limit of the gain.

    raises  BadParameters: no lag, no dead time, no filter
    """
    if lag_time(task.loop.drive, task.loop.wiring) == 0.0:
        raise BadParameters(
            "a converter bandwidth or dead time, or a speed filter", "none of them",
            "Without a lag every gain is stable. Give --converter BANDWIDTH,DAMPING,DEAD_TIME.")
