"""The least-squares problem: free parameters, traces with their start states, and the model."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive.simulation import ObserverGains, Plant, Trace

# The plants that each thread used last, with and without sensitivities: a search for a noise makes pass after pass
# with the same plants, whose modes are then computed already.
_plants_by_thread = threading.local()
# Samples beyond the number of unknowns. A choice: fewer leave no estimate of the noise.
MIN_SPARE_SAMPLES = 20


@dataclass(frozen=True)
class Point:
    """Values of the unknowns: free parameters (k,) and one start state (nx,) per trace."""

    values: np.ndarray
    starts: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Normal:
    """Normal equations of a point, block arrow: shared parameters and start states per trace.

    shared  (k, k); cross: per trace (k, m); own: per trace (m, m)
    slope   (k,) gradient of half the cost; own_slope: per trace (m,)
    cost    sum of squared weighted residuals
    """

    shared: np.ndarray
    cross: tuple[np.ndarray, ...]
    own: tuple[np.ndarray, ...]
    slope: np.ndarray
    own_slope: tuple[np.ndarray, ...]
    cost: float


@dataclass(frozen=True)
class Problem:
    """A least-squares problem over traces.

    build      (values (k,), trace, gradient, memory) -> Plant
    names      of the k free parameters; low, high, size: bounds and typical size of each
    traces     stretches of record
    free_start index of the states whose start value is estimated
    scale      (ny,) sensor standard deviations relative to the first output, which is sensor_std
    memory     correlation of the torque disturbance state over a `step`, or None
    step       sampling interval of the memory [s]; 0: of every trace its own
    later      (k,) parameters that are fixed in the first round of a fit
    bodies     number of bodies, whose speeds are the first states
    by_record  whether the plant differs between recordings
    anchored   index of the free start states that stay where they are in the first stretch
    lag        samples over which a free run's errors are differenced: those of an angle are then errors of a speed;
               0: not at all
    states     names of the states, for the known start states of a stretch
    counts     per trace (n,) whether a sample is fitted; the filter knows the others too. None: all are fitted
    """

    build: Callable[[np.ndarray, Trace, bool, float | None], Plant]
    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    size: np.ndarray
    traces: tuple[Trace, ...]
    free_start: np.ndarray
    scale: np.ndarray
    memory: float | None = None
    later: np.ndarray | None = None
    bodies: int = 1
    by_record: bool = False
    anchored: tuple[int, ...] = ()
    lag: int = 0
    states: tuple[str, ...] = ()
    sensor_std: float = 1.0
    step: float = 0.0
    counts: tuple[np.ndarray, ...] | None = None

    @property
    def count(self) -> int:
        """Number of measured values that count."""
        known = [np.isfinite(t.outputs) for t in self.traces]
        return int(sum((k if self.counts is None else k[self.counts[i]]).sum() for i, k in enumerate(known)))

    @property
    def unknowns(self) -> int:
        """Number of estimated values, start states included."""
        known = sum(len(self.known(i)) for i in range(len(self.traces)))
        return len(self.names) + len(self.traces) * len(self.free_start) - known

    def variance(self, cost: float) -> float:
        """Variance of a weighted residual by the sum of their squares at a solution."""
        return cost / max(self.count - self.unknowns, 1)

    def known(self, i: int) -> list[int]:
        """Index of the start states of a stretch that are known and not estimated."""
        stated = {j for j, name in enumerate(self.states) if name in self.traces[i].start}
        return sorted(stated.union(self.anchored if i == 0 else ()))

    def plants(self, values: np.ndarray, gradient: bool) -> list[Plant]:
        """A plant per trace; traces with one step share theirs, and one record where records differ."""
        keys = [(t.step, t.record if self.by_record else 0) for t in self.traces]
        trace_by_key = dict(zip(keys, self.traces, strict=True))
        mark, name = ((values.tobytes(), self.memory, self.step, tuple(trace_by_key)),
                      "full" if gradient else "plain")
        build, known, made = getattr(_plants_by_thread, name, (None, None, {}))
        if build is not self.build or known != mark:
            made = {key: self.build(values, t, gradient, self.memory and self.memory ** self.steps(t))
                    for key, t in trace_by_key.items()}
            setattr(_plants_by_thread, name, (self.build, mark, made))
        return [made[key] for key in keys]

    def steps(self, trace: Trace) -> float:
        """The sampling interval of a trace, over that of the memory."""
        return trace.step / self.step if self.step else 1.0

    def normal(self, point: Point, gains: Sequence[ObserverGains] | None = None) -> Normal:
        """Normal equations at a point."""
        k, own_columns = len(self.names), None
        shared, slope, cost = np.zeros((k, k)), np.zeros(k), 0.0
        cross, own, own_slope = [], [], []
        for i, (t, plant) in enumerate(zip(self.traces, self.plants(point.values, True), strict=True)):
            if self.lag:
                rows = self.differenced(plant.sensitivities(t, point.starts[i], None, 1.0 / self.scale), t)
                g = rows.T @ rows
            else:
                g = plant.normal_equations(t, point.starts[i], gains[i] if gains else None, 1.0 / self.scale)
            own_columns = plant.system.nq + self.free_start
            if known := self.known(i):
                known_columns = plant.system.nq + np.array(known)
                g[known_columns], g[:, known_columns] = 0.0, 0.0
            shared += g[:k, :k]
            slope += g[:k, -1]
            cost += g[-1, -1]
            cross.append(g[:k, own_columns])
            own.append(g[own_columns[:, None], own_columns])
            own_slope.append(g[own_columns, -1])
        return Normal(shared, tuple(cross), tuple(own), slope, tuple(own_slope), float(cost))

    def differenced(self, parts: Iterable[tuple[slice, np.ndarray]], trace: Trace) -> np.ndarray:
        """(m, ns) differences over the lag of a trace's sensitivities, zero where a value was not measured."""
        rows = np.concatenate([part.copy() for _, part in parts])
        known = np.isfinite(trace.outputs)
        both = (known[self.lag:] & known[:len(known) - self.lag])[..., None]
        return ((rows[self.lag:] - rows[:len(rows) - self.lag]) * both).reshape(-1, rows.shape[2])

    def cost(self, point: Point, gains: Sequence[ObserverGains] | None = None) -> float:
        """Sum of squared weighted residuals at a point; infinite if the model diverges."""
        return float(self.costs(point, gains).sum())

    def costs(self, point: Point, gains: Sequence[ObserverGains] | None = None) -> np.ndarray:
        """(traces,) the share of each in the cost."""
        found = np.empty(len(self.traces))
        for i, (t, plant) in enumerate(zip(self.traces, self.plants(point.values, False), strict=True)):
            g = gains[i] if gains else None
            r = plant.outputs(t, point.starts[i], g) - t.outputs
            r *= g.weight if g else 1.0 / self.scale
            r = r[self.lag:] - r[:len(r) - self.lag] if self.lag else r
            r = r[np.isfinite(r)]
            with np.errstate(over="ignore", invalid="ignore"):  # a trial may make the observer unstable
                found[i] = float(r @ r)
        return np.where(np.isfinite(found), found, np.inf)

    def moved(self, point: Point, step: np.ndarray, own: Sequence[np.ndarray]) -> Point:
        """The point after a step, inside the bounds."""
        values = np.clip(point.values + step, self.low, self.high)
        starts = []
        for start, change in zip(point.starts, own, strict=True):
            new = start.copy()
            new[self.free_start] += change
            starts.append(new)
        return Point(values, tuple(starts))

    def with_constant_torque(self) -> Problem:
        """The same with a torque of its own on the motor in each trace, as a further start state."""
        return replace(self.with_memory(1.0), free_start=np.append(self.free_start, self.free_start[-1] + 1))

    def with_memory(self, memory: float | None) -> Problem:
        """The same problem with another torque disturbance memory."""
        return replace(self, memory=memory)
