"""Simulation of a record: one call for every pass that an estimator or a check needs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from drivetool.drive.arrays import MADE_FOR, Cache, Filtering, Laws, Pass, System, empty_cache, packed, place_of
from drivetool.drive.compile import address, function

CHUNK = 8192  # samples whose sensitivities are in memory at a time


@dataclass(frozen=True)
class Trace:
    """A stretch of a record with a start state of its own.

    inputs   (n, nu) held torques; outputs (n, ny) measured, NaN where there is none
    step     sample interval [s]
    name     of the recording
    origin   time of its first sample after the start of the recording [s]
    record   number by which its recording is known
    lead     (m, nu) torques before its first sample, the latest last, as far as they are known
    start    what is known of its start state: state -> value, the states named as in `Assembly`
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
        for name in ("inputs", "outputs"):  # the kernel walks along the rows
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), float))

    @property
    def size(self) -> int:
        """Number of samples."""
        return len(self.inputs)


@dataclass(frozen=True)
class Gains:
    """A frozen observer: gain (n, ny, nx), weight (n, ny) = 1/std of the innovations."""

    gain: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class Filtered:
    """What a Kalman pass gives: gains, innovations (n, ny), their variance, filtered states."""

    gains: Gains
    innovations: np.ndarray
    variance: np.ndarray
    states: np.ndarray


@dataclass(frozen=True)
class Plant:
    """A system ready to run: the arrays, its smooth laws, the cache of its modes, the whole-sample delay.

    interpolation  share of a straight line between the samples of the motor torque, the rest held
    """

    system: System
    delay_samples: int = 0
    laws: Laws | None = None
    interpolation: float = 0.0
    cache: Cache = field(init=False)
    tables: tuple[np.ndarray, ...] = field(init=False)

    def __post_init__(self):
        exact, late = self.laws is None, self.system.early > 0 and self.system.delay.any()
        address(self._part("run"))  # before its units, which are compiled beside it
        cache = empty_cache(self.system, self.laws, (
            address("work_out"), address("rough_step") if exact else 0, address("switch_late") if late else 0))
        object.__setattr__(self, "cache", cache)
        object.__setattr__(self, "tables", tuple(
            packed(t) for t in (self.system, cache, self.laws) if t is not None))

    @property
    def nx(self) -> int:
        """Number of states, without those that the smooth laws add."""
        return self.system.plain

    def _call(self, name: str, record: Pass | Filtering, *numbers: float) -> int:
        """Let a part of the kernel go over a record."""
        tables = (*self.tables, packed(record))
        return function(self._part(name))(*map(place_of, tables), *numbers)

    def _part(self, name: str) -> str:
        """The part of the kernel that is made for this system."""
        if self.laws is not None:
            return f"{name}_laws"
        return f"{name}_{self.nx}" if self.system.nu == 1 and self.nx in MADE_FOR else name

    def _start(self, start: np.ndarray) -> np.ndarray:
        x = np.zeros(self.system.nx)
        x[:len(start)] = start
        return x

    def held(self, trace: Trace) -> tuple[np.ndarray, np.ndarray]:
        """(inputs of a sample, those before the dead time switches), each (n, nu).

        Only the first input, the motor torque, is delayed and interpolated. Before the first torque that is
        known it is taken as constant.
        """
        inputs = trace.inputs
        if self.interpolation > 0.0:
            inputs = inputs.copy()
            inputs[:-1, 0] += 0.5 * self.interpolation * np.diff(inputs[:, 0])
        if self.system.early == 0:
            return inputs, inputs
        now, late, k = inputs.copy(), inputs.copy(), self.delay_samples
        known = inputs[:, 0] if trace.lead is None else np.concatenate([trace.lead[-k - 1:, 0], inputs[:, 0]])
        index = np.arange(len(inputs)) + len(known) - len(inputs)
        now[:, 0], late[:, 0] = known[np.maximum(index - k, 0)], known[np.maximum(index - k - 1, 0)]
        return now, late

    def outputs(self, trace: Trace, start: np.ndarray, gains: Gains | None = None) -> np.ndarray:
        """(n, ny) simulated outputs from the start state (nx,), with or without an observer."""
        return self.simulate(trace, start, gains)[0]

    def simulate(self, trace: Trace, start: np.ndarray, gains: Gains | None = None,
                 keep: bool = False) -> tuple[np.ndarray, np.ndarray, int]:
        """(outputs (n, ny), states (n, nx) or (0, nx), samples with events)."""
        s, n = self.system, trace.size
        u, late = self.held(trace)
        out = np.empty((n, s.ny))
        states = np.empty((n if keep else 0, s.nx))
        events = self._call("run", Pass(
            u, late, trace.outputs, *_observer(s, gains, slice(None)), self._start(start), np.zeros((s.nx, 0)),
            np.ones(s.ng + s.nf, np.int64), True, out, np.empty((0, s.ny, s.ns)), states), trace.origin)
        return out, states[:, :self.nx], events

    def _first_columns(self) -> np.ndarray:
        """(nx, ns) sensitivities at the start: those to the start states."""
        s, n = self.system, self.nx
        big = np.zeros((s.nx, s.ns))
        big[np.arange(n), s.nq + np.arange(n)] = 1.0
        return big

    def normal_equations(self, trace: Trace, start: np.ndarray, gains: Gains | None = None,
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

    def sensitivities(self, trace: Trace, start: np.ndarray, gains: Gains | None = None,
                      weight: np.ndarray | None = None) -> Iterator[tuple[slice, np.ndarray]]:
        """(samples, their weighted sensitivities (m, ny, ns)) a chunk at a time; the next overwrites the last."""
        s, n = self.system, trace.size
        u, late = self.held(trace)
        x, mode = self._start(start), np.ones(s.ng + s.nf, np.int64)
        big = self._first_columns()
        jac = np.empty((min(n, CHUNK), s.ny, s.ns))
        for a in range(0, n, CHUNK):
            part = slice(a, min(n, a + CHUNK))
            rows = jac[:part.stop - a]
            gain, scale = _observer(s, gains, part)
            if gains is None and weight is not None:
                scale = np.broadcast_to(weight, (len(rows), s.ny)).copy()
            self._call("run", Pass(u[part], late[part], trace.outputs[part], gain, scale, x, big, mode, a == 0,
                           np.empty((len(rows), s.ny)), rows, np.empty((0, s.nx))), trace.origin + a * trace.step)
            yield part, rows

    def jacobian(self, trace: Trace, start: np.ndarray,
                 gains: Gains | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(outputs (n, ny), weighted sensitivities (n, ny, ns)), all in memory."""
        s, n = self.system, trace.size
        u, late = self.held(trace)
        big = self._first_columns()
        out, jac = np.empty((n, s.ny)), np.empty((n, s.ny, s.ns))
        self._call("run", Pass(u, late, trace.outputs, *_observer(s, gains, slice(None)), self._start(start), big,
                       np.ones(s.ng + s.nf, np.int64), True, out, jac, np.empty((0, s.nx))), trace.origin)
        return out, jac

    def filter(self, trace: Trace, start: np.ndarray, sensor: np.ndarray, torque: float,
               extra: np.ndarray, covariance: np.ndarray | None = None,
               keep: bool = True, kick: np.ndarray | None = None) -> Filtered:
        """Extended Kalman pass from the start state.

        sensor      (ny,) sensor variances; torque: torque noise variance per sample
        extra       (nx,) variance added to each state per sample
        covariance  (nx, nx) of the start state; None: known exactly
        keep        whether gains and states are wanted
        kick        (nx,) what a torque noise of one leaves in each state after its sample; None: nothing
        """
        s, n = self.system, trace.size
        u, late = self.held(trace)
        p = np.zeros((self.nx, self.nx)) if covariance is None else np.array(covariance, float, order="C")
        gain = np.zeros((n if keep else 0, s.ny, s.nx))
        states = np.empty((n if keep else 0, s.nx))
        var, innov = np.empty((n, s.ny)), np.empty((n, s.ny))
        self._call("kalman", Filtering(
            u, late, trace.outputs, sensor, extra, np.zeros(self.nx) if kick is None else kick, p,
            self._start(start), np.ones(s.ng + s.nf, np.int64), gain, var, innov, states), torque, trace.origin)
        # A covariance that is smaller than its rounding errors: nothing is foretold, and no point is less likely.
        var[var <= 0.0] = np.inf
        return Filtered(Gains(gain, 1.0 / np.sqrt(var)), innov, var, states[:, :self.nx])


def _observer(s: System, gains: Gains | None, part: slice) -> tuple[np.ndarray, np.ndarray]:
    if gains is None:
        return np.empty((0, s.ny, s.nx)), np.empty((0, s.ny))
    return gains.gain[part], gains.weight[part]
