"""The best settings under a limit of the sensitivity, found globally and the same every time.

The surface of |error| integrals has kinks where a lobe appears, and the limit is a boundary with
corners. So: for every integral time the allowed gains are known as intervals (speed_loop/sensitivity.py); a
grid over them finds the basins; inside a basin the gain is a position between the two ends of its
interval, so that the polish runs along the boundary as easily as away from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from drivetool.errors import BadParameters
from drivetool.tune.optimisation.criteria import Criterion, values
from drivetool.tune.speed_loop import (
    Loop,
    Plant,
    Settings,
    forbidden,
    lag_time,
    max_sensitivity,
    plant,
    refined,
    speeds_of,
)

TIMES, SECONDS, POSITIONS = 56, 14, 11  # grid: integral times, K of a second controller, gains
SPREAD = (0.08, 4.0)  # of K
BASINS = 4  # polished
ROUNDS = 6
# First steps in log Ti, log K and position.
COARSE, MIDDLE, FINE = (0.06, 0.15, 0.1), (0.02, -0.04, 0.1), (3e-3, 3e-3, 0.03)
NUDGES = (0.0, *(side * size for size in (1e-4, 5e-4, 2e-3, 1e-2, 0.05, 0.2) for side in (1, -1)))


@dataclass(frozen=True)
class Limits:
    """What a design must keep.

    sensitivity  largest Ms
    gain         largest Kp [torque/speed]; infinite: no limit
    """

    sensitivity: float = 2.0
    gain: float = np.inf


@dataclass(frozen=True)
class Task:
    """A drive in its loop, and the drives it might be as well.

    scenarios  loops that share the sensitivity limit; the nominal one alone, or draws
    """

    loop: Loop
    plant: Plant
    scenarios: tuple[tuple[Loop, Plant], ...]
    criterion: Criterion
    limits: Limits

    @property
    def two(self) -> bool:
        """Whether K is looked for."""
        return self.loop.wiring.configuration == "miso"

    @cached_property
    def gains(self) -> tuple[float, float]:
        """Gains that are looked at: a crossover from far below the resonance to far above the lags."""
        slow, fast = speeds_of(self.loop.drive, self.loop.wiring)
        total = self.loop.drive.referred_inertia
        return 1e-3 * slow * total, min(1e3 * fast * total, self.limits.gain)

    @cached_property
    def times(self) -> tuple[float, float]:
        """Integral times that are looked at [s]."""
        slow, fast = speeds_of(self.loop.drive, self.loop.wiring)
        return 0.2 / fast, 300.0 / slow


@dataclass(frozen=True)
class Found:
    """The optimum: settings and the criterion's value."""

    settings: Settings
    value: float


def task(loop: Loop, criterion: Criterion, limits: Limits, scenarios: Sequence[Loop] = ()) -> Task:
    """What `optimum` needs; without scenarios the nominal drive is the only one."""
    own = plant(loop.drive, loop.wiring)
    others = tuple((other, plant(other.drive, other.wiring)) for other in scenarios)
    return Task(loop, own, others or ((loop, own),), criterion, limits)


def optimum(task: Task) -> Found | None:
    """The best settings, or None if none is allowed.

    raises  BadParameters: without lag or dead time in the loop any gain is allowed
    """
    shapes = shapes_of(task)
    basins = _basins(task, shapes)
    if not basins:
        return None
    best = min((_polish(task, start, COARSE) for start in basins), key=lambda found: found.value)
    for _ in range(ROUNDS):  # a simplex may lie down along a kink; a fresh one gets up again
        again = _polish(task, _nudged(task, best.settings), MIDDLE)
        gained, best = best.value - again.value, min(best, again, key=lambda found: found.value)
        if gained < 1e-6 * best.value:
            break
    return _settled(task, best)


def _settled(task: Task, best: Found) -> Found:
    """The optimum with the frequencies of its own peaks in the grid, and so that the limit holds exactly."""
    limit = working = task.limits.sensitivity
    for _ in range(5):
        task = replace(
            task, limits=replace(task.limits, sensitivity=working),
            scenarios=tuple((loop, refined(own, best.settings)) for loop, own in task.scenarios))
        best = _polish(task, _nudged(task, best.settings), FINE)
        found = reached(task, best.settings)
        if found - limit <= 1e-9:
            break
        # As distances from -1, which no excess turns negative, not even that of an unstable loop.
        working = 1.0 / (1.0 / working + (1.0 / limit - 1.0 / found) * (1.0 + 1e-3))
    return best


def reached(task: Task, settings: Settings) -> float:
    """The least limit that all scenarios keep."""
    return max(sensitivity_of(loop, own, settings) for loop, own in task.scenarios)


def sensitivity_of(loop: Loop, own: Plant, settings: Settings) -> float:
    """Ms, infinite if the loop is unstable."""
    stable = np.linalg.eigvals(loop.matrix(settings)).real.max() < 0.0
    return max_sensitivity(own, settings)[0] if stable else np.inf


def allowed(task: Task, integral_time: float, second: float) -> np.ndarray:
    """(m, 2) gains that keep the limits, in rising order.

    Between two forbidden intervals no pole can cross the axis, so one look tells whether they are
    stable.
    """
    low, high = task.gains
    if low >= high:
        return np.zeros((0, 2))
    common = np.array([[low, high]])
    for loop, own in task.scenarios:
        bad = forbidden(own.shape(integral_time, second), own.w, task.limits.sensitivity)
        bad = bad[(bad[:, 1] > low) & (bad[:, 0] < high)]
        ends = np.clip(np.r_[low, bad.ravel(), high].reshape(-1, 2), low, high)
        ends = ends[ends[:, 1] > ends[:, 0] * (1.0 + 1e-9)]
        if len(ends):
            middle = np.sqrt(ends[:, 0] * ends[:, 1])
            many = np.ones_like(middle)
            poles = np.linalg.eigvals(loop.matrices(middle, integral_time * many, second * many))
            ends = ends[poles.real.max(axis=1) < 0.0]
        common = ends if common[0, 0] == low and common[0, 1] == high else _both(common, ends)
        if not len(common):
            break
    return common


def _both(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(m, 2) where two rising rows of intervals overlap."""
    low = np.maximum(first[:, None, 0], second[None, :, 0]).ravel()
    high = np.minimum(first[:, None, 1], second[None, :, 1]).ravel()
    keep = high > low * (1.0 + 1e-9)
    order = np.argsort(low[keep], kind="stable")
    return np.column_stack([low[keep], high[keep]])[order]


def shapes_of(task: Task) -> np.ndarray:
    """(m, 2) integral time and K of the grid."""
    times = np.geomspace(*task.times, TIMES)
    seconds = np.geomspace(*SPREAD, SECONDS) if task.two else np.ones(1)
    return np.array([(ti, k) for ti in times for k in seconds])


@dataclass(frozen=True)
class _Start:
    """A point of the grid: log Ti, log K, position in the interval, and the gain there."""

    point: np.ndarray
    gain: float
    value: float


def _basins(task: Task, shapes: np.ndarray) -> list[_Start]:
    """The best points of the grid that are apart from each other."""
    rows, low_high = [], []
    for ti, second in shapes:
        for low, high in allowed(task, ti, second):
            rows.append((ti, second))
            low_high.append((low, high))
    if not rows:
        return []
    shape, ends = np.repeat(rows, POSITIONS, axis=0), np.repeat(low_high, POSITIONS, axis=0)
    position = np.tile(np.linspace(0.0, 1.0, POSITIONS), len(rows))
    gain = _gain(ends[:, 0], ends[:, 1], position)
    cost = values(task.loop, task.criterion, gain, shape[:, 0], shape[:, 1])
    best = np.argmin(cost.reshape(-1, POSITIONS), axis=1) + POSITIONS * np.arange(len(rows))
    apart = 2.5 * np.log(np.divide(*task.times[::-1])) / TIMES
    found: list[_Start] = []
    for k in best[np.argsort(cost[best], kind="stable")]:
        point = np.array([*np.log(shape[k]), position[k]])
        if np.isfinite(cost[k]) and all(
                np.abs(point[:2] - other.point[:2]).max() > apart or abs(np.log(gain[k] / other.gain)) > 1.0
                for other in found):
            found.append(_Start(point, gain[k], cost[k]))
        if len(found) == BASINS:
            break
    return found


def _gain(low, high, position):
    """Gain at a position from 0 to 1 between the ends, in equal ratios."""
    return low * (high / low) ** position


def _nudged(task: Task, settings: Settings) -> _Start:
    """Where to start again once the limit has moved a little: the best allowed settings nearby.

    Where two peaks of the sensitivity meet, the interval of the optimum may end a hair away from it.
    """
    best = None
    for second in settings.second * np.exp(NUDGES if task.two else (0.0,)):
        for ti in settings.integral_time * np.exp(NUDGES):
            ends = _interval(task, ti, second, settings.gain)
            if ends is None:
                continue
            gain = float(np.clip(settings.gain, *ends))
            cost = float(values(task.loop, task.criterion, *np.array([[gain], [ti], [second]]))[0])
            if best is None or cost < best.value:
                position = np.log(gain / ends[0]) / np.log(ends[1] / ends[0])
                best = _Start(np.array([np.log(ti), np.log(second), position]), gain, cost)
    return best or _Start(np.array([np.log(settings.integral_time), np.log(settings.second), 0.5]),
                          settings.gain, np.inf)


def _polish(task: Task, start: _Start, step: Sequence[float]) -> Found:
    """Nelder-Mead over log Ti, log K and position, and along the nearer end of the interval."""
    shape = [0, 1] if task.two else [0]
    inside = _simplex(task, start, [*shape, 2], None, step)
    end = 1.0 if start.point[2] > 0.5 else 0.0
    return min(inside, _simplex(task, start, shape, end, step), key=lambda found: found.value)


@dataclass
class _Trial:
    """The criterion over log Ti, log K and position, near a start; keeps the best it has met."""

    task: Task
    start: _Start
    free: list[int]
    end: float | None
    best: Found

    def __call__(self, x: np.ndarray) -> float:
        """x: the free coordinates; where nothing is allowed, more than anywhere else."""
        point = self.start.point.copy()
        point[self.free] = x
        if self.end is not None:
            point[2] = self.end
        ti, second = np.exp(point[:2])
        worst = 1e3 * self.start.value if np.isfinite(self.start.value) else 1e300
        ends = _interval(self.task, ti, second, self.start.gain)
        if ends is None:
            return worst * (1.0 + np.abs(x - self.start.point[self.free]).sum())
        gain = _gain(*ends, np.clip(point[2], 0.0, 1.0))
        found = float(values(self.task.loop, self.task.criterion, *np.array([[gain], [ti], [second]]))[0])
        if found < self.best.value:
            self.best = Found(Settings(float(gain), float(ti), float(second)), found)
        return found if np.isfinite(found) else worst


def _trial(task: Task, start: _Start, free: list[int], end: float | None = None) -> _Trial:
    return _Trial(task, start, free, end, Found(_settings(start), start.value))


def _simplex(task: Task, start: _Start, free: list[int], end: float | None, step: Sequence[float]) -> Found:
    """One Nelder-Mead run over some of the three coordinates."""
    trial, x0 = _trial(task, start, free, end), start.point[free]
    simplex = np.vstack([x0, x0 + np.diag([_inward(x0[i], k, step[k]) for i, k in enumerate(free)])])
    minimize(trial, x0, method="Nelder-Mead", options={
        "initial_simplex": simplex, "xatol": 1e-7, "fatol": 1e-9 * start.value, "maxfev": 90 * len(free)})
    return trial.best


def _inward(x: float, coordinate: int, step: float) -> float:
    """The first step of a position goes into its interval."""
    return -step if coordinate == 2 and x > 0.5 else step


def _settings(start: _Start) -> Settings:
    return Settings(float(start.gain), *(float(v) for v in np.exp(start.point[:2])))


def _interval(task: Task, integral_time: float, second: float, gain: float) -> np.ndarray | None:
    """The allowed interval nearest to a gain."""
    ends = allowed(task, integral_time, second)
    if not len(ends):
        return None
    away = np.maximum(np.log(ends[:, 0] / gain), np.log(gain / ends[:, 1]))
    return ends[int(np.argmin(away))]


def lowest_sensitivity(task: Task) -> float:
    """The least limit that some settings keep, to 1 %; for a person whose limit none keeps."""
    shapes = shapes_of(task)
    low, high = 1.0, 64.0
    while high > low * 1.01:
        middle = np.sqrt(low * high) if low > 1.0 else 0.5 * (low + high)
        trial = replace(task, limits=replace(task.limits, sensitivity=middle))
        if any(len(allowed(trial, *shape)) for shape in shapes):
            high = middle
        else:
            low = middle
    return high


def check_finite(task: Task) -> None:
    """Refuse a loop in which nothing limits the gain.

    raises  BadParameters: no lag, no dead time, no filter
    """
    if lag_time(task.loop.drive, task.loop.wiring) == 0.0:
        raise BadParameters(
            "a converter bandwidth or dead time, or a speed filter", "none of them",
            "Without one any gain would be stable. Give --converter BANDWIDTH,DAMPING,DEAD_TIME.")
