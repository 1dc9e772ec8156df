"""Simulation of a record: one method per pass that an estimator or a check needs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from drivetool.drive.arrays import (
    SIZED_STATE_COUNTS,
    Cache,
    FilterBuffers,
    Laws,
    SimulationBuffers,
    System,
    address_of,
    empty_cache,
    packed,
)
from drivetool.drive.compile import address, function

# Samples whose sensitivities are in memory at a time. A choice: a few MB, and few calls per record.
CHUNK_SAMPLES = 8192


@dataclass(frozen=True)
class Trace:
    """A stretch of a record with a start state of its own.

    inputs   (n, nu) held torques; outputs (n, ny) measured, NaN where there is none
    step     sample interval [s]
    name     of the recording
    origin   time of its first sample after the start of the recording [s]
    record   number of its recording
    lead     (m, nu) torques before its first sample, the latest last, as far as they are known
    start    known part of its start state: state -> value, the states named as in `Assembly`
    """

    inputs: np.ndarray
    outputs: np.ndarray
    step: float
    name: str = ""
    origin: float = 0.0
    record: int = 0
    lead: np.ndarray | None = None
    start: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self):
        for name in ("inputs", "outputs"):  # the kernel reads row by row
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), float))

    @property
    def size(self) -> int:
        """Number of samples."""
        return len(self.inputs)


@dataclass(frozen=True)
class ObserverGains:
    """A frozen observer: gain (n, ny, nx), weight (n, ny) = 1/std of the innovations."""

    gain: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class Filtered:
    """What a Kalman pass gives: gains, innovations (n, ny), their variance, filtered states."""

    gains: ObserverGains
    innovations: np.ndarray
    variance: np.ndarray
    states: np.ndarray


@dataclass(frozen=True)
class Plant:
    """A system ready to run: the arrays, its smooth laws, the cache of its modes, the whole-sample delay.

    interpolation  weight of linear interpolation between samples of the motor torque; the rest is held constant
    """

    system: System
    laws: Laws | None = None
    delay_samples: int = 0
    interpolation: float = 0.0
    cache: Cache = field(init=False)
    tables: tuple[np.ndarray, ...] = field(init=False)

    def __post_init__(self):
        exact, late = (
            self.laws is None, self.system.parts_before_switch > 0 and self.system.dead_time_gradient.any())
        address(self._unit_name("run"))  # before its units, which are compiled in parallel
        cache = empty_cache(self.system, self.laws, (
            address("compute_mode"), address("step_through_events") if exact else 0,
            address("switch_late") if late else 0))
        object.__setattr__(self, "cache", cache)
        object.__setattr__(self, "tables", tuple(
            packed(t) for t in (self.system, cache, self.laws) if t is not None))

    @property
    def nx(self) -> int:
        """Number of states, without those that the smooth laws add."""
        return self.system.plain

    def _call(self, name: str, record: SimulationBuffers | FilterBuffers, *numbers: float) -> int:
        """Run a unit of the kernel over a record."""
        tables = (*self.tables, packed(record))
        return function(self._unit_name(name))(*map(address_of, tables), *numbers)

    def _unit_name(self, name: str) -> str:
        """Name of the kernel's unit that is compiled for this system's size."""
        if self.laws is not None:
            return f"{name}_laws"
        return f"{name}_{self.nx}" if self.system.nu == 1 and self.nx in SIZED_STATE_COUNTS else name

    def _full_state(self, start: np.ndarray) -> np.ndarray:
        x = np.zeros(self.system.nx)
        x[:len(start)] = start
        return x

    def held(self, trace: Trace) -> tuple[np.ndarray, np.ndarray]:
        """(inputs of a sample, those before the dead time switches), each (n, nu).

        Only the first input, the motor torque, is delayed and interpolated. Before the first known torque it is
        constant.
        """
        inputs = trace.inputs
        if self.interpolation > 0.0:
            inputs = inputs.copy()
            inputs[:-1, 0] += 0.5 * self.interpolation * np.diff(inputs[:, 0])
        if self.system.parts_before_switch == 0:
            return inputs, inputs
        now, late, k = inputs.copy(), inputs.copy(), self.delay_samples
        torques = inputs[:, 0] if trace.lead is None else np.concatenate([trace.lead[-k - 1:, 0], inputs[:, 0]])
        index = np.arange(len(inputs)) + len(torques) - len(inputs)
        now[:, 0], late[:, 0] = torques[np.maximum(index - k, 0)], torques[np.maximum(index - k - 1, 0)]
        return now, late

    def outputs(self, trace: Trace, start: np.ndarray, gains: ObserverGains | None = None) -> np.ndarray:
        """(n, ny) simulated outputs from the start state (nx,), with or without an observer."""
        return self.simulate(trace, start, gains)[0]

    def simulate(self, trace: Trace, start: np.ndarray, gains: ObserverGains | None = None,
                 keep: bool = False) -> tuple[np.ndarray, np.ndarray, int]:
        """(outputs (n, ny), states (n, nx) or (0, nx), samples with events)."""
        s, n = self.system, trace.size
        u, late = self.held(trace)
        out = np.empty((n, s.ny))
        states = np.empty((n if keep else 0, s.nx))
        events = self._call("run", SimulationBuffers(
            u, late, trace.outputs, *_observer(s, gains, slice(None)), self._full_state(start), np.zeros((s.nx, 0)),
            np.ones(s.elements, np.int64), True, out, np.empty((0, s.ny, s.ns)), states), trace.origin)
        return out, states[:, :self.nx], events

    def _initial_sensitivities(self) -> np.ndarray:
        """(nx, ns) sensitivities at the start: the identity for the start states."""
        s, n = self.system, self.nx
        sens = np.zeros((s.nx, s.ns))
        sens[np.arange(n), s.nq + np.arange(n)] = 1.0
        return sens

    def normal_equations(self, trace: Trace, start: np.ndarray, gains: ObserverGains | None = None,
                         weight: np.ndarray | None = None) -> np.ndarray:
        """(ns, ns) sum over samples of j' j, j = [parameters, start states, ..., residual].

        weight (ny,) holds 1/std per output where there is no observer. Sensitivities are
        summed up a chunk at a time: memory does not grow with the record.
        """
        total = np.zeros((self.system.ns, self.system.ns))
        for _, rows in self.sensitivities(trace, start, gains, weight):
            flat = rows.reshape(-1, self.system.ns)
            total += flat.T @ flat
        return total

    def sensitivities(self, trace: Trace, start: np.ndarray, gains: ObserverGains | None = None,
                      weight: np.ndarray | None = None) -> Iterator[tuple[slice, np.ndarray]]:
        """(samples, their weighted sensitivities (m, ny, ns)) a chunk at a time; the next overwrites the last."""
        s, n = self.system, trace.size
        u, late = self.held(trace)
        x, mode = self._full_state(start), np.ones(s.elements, np.int64)
        sens = self._initial_sensitivities()
        jac = np.empty((min(n, CHUNK_SAMPLES), s.ny, s.ns))
        for a in range(0, n, CHUNK_SAMPLES):
            part = slice(a, min(n, a + CHUNK_SAMPLES))
            rows = jac[:part.stop - a]
            gain, scale = _observer(s, gains, part)
            if gains is None and weight is not None:
                scale = np.broadcast_to(weight, (len(rows), s.ny)).copy()
            self._call("run", SimulationBuffers(u[part], late[part], trace.outputs[part], gain, scale, x, sens,
                                                mode, a == 0,
                           np.empty((len(rows), s.ny)), rows, np.empty((0, s.nx))), trace.origin + a * trace.step)
            yield part, rows

    def jacobian(self, trace: Trace, start: np.ndarray,
                 gains: ObserverGains | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(outputs (n, ny), weighted sensitivities (n, ny, ns)), all in memory."""
        s, n = self.system, trace.size
        u, late = self.held(trace)
        sens = self._initial_sensitivities()
        out, jac = np.empty((n, s.ny)), np.empty((n, s.ny, s.ns))
        self._call("run", SimulationBuffers(
            u, late, trace.outputs, *_observer(s, gains, slice(None)), self._full_state(start), sens,
            np.ones(s.elements, np.int64), True, out, jac, np.empty((0, s.nx))), trace.origin)
        return out, jac

    def filter(self, trace: Trace, start: np.ndarray, sensor: np.ndarray, torque: float,
               added_variance: np.ndarray, covariance: np.ndarray | None = None,
               keep: bool = True, noise_input: np.ndarray | None = None) -> Filtered:
        """Extended Kalman pass from the start state.

        sensor      (ny,) sensor variances; torque: torque noise variance per sample
        added_variance (nx,)  per state and sample
        covariance  (nx, nx) of the start state; None: known exactly
        keep        whether gains and states are returned
        noise_input (nx,) change of each state by a unit torque noise, after its sample; None: zero
        """
        s, n = self.system, trace.size
        u, late = self.held(trace)
        p = np.zeros((self.nx, self.nx)) if covariance is None else np.array(covariance, float, order="C")
        gain = np.zeros((n if keep else 0, s.ny, s.nx))
        states = np.empty((n if keep else 0, s.nx))
        var, innov = np.empty((n, s.ny)), np.empty((n, s.ny))
        self._call("kalman", FilterBuffers(
            u, late, trace.outputs, sensor, added_variance,
            np.zeros(self.nx) if noise_input is None else noise_input, p,
            self._full_state(start), np.ones(s.elements, np.int64), gain, var, innov, states),
                   torque, trace.origin)
        # A covariance below its rounding errors: an infinite variance makes this point's likelihood the lowest.
        var[var <= 0.0] = np.inf
        return Filtered(ObserverGains(gain, 1.0 / np.sqrt(var)), innov, var, states[:, :self.nx])


def _observer(s: System, gains: ObserverGains | None, part: slice) -> tuple[np.ndarray, np.ndarray]:
    if gains is None:
        return np.empty((0, s.ny, s.nx)), np.empty((0, s.ny))
    return gains.gain[part], gains.weight[part]
