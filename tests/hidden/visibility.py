"""How detectable an effect is in the noise, once the plain parameters are fitted to it.

Computed from the truth: the record with the effect against the plain machine under the logged
torque, its parameters and start states fitted, the difference weighed by the noise.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from tests.hidden.case import Case, Record, add_effects, logged_values, sensors_of
from tests.hidden.effects import KINDS, HiddenEffect, Logger, nominal_speed_noise
from tests.hidden.profiles import STEP
from tests.hidden.whiten import Whitener, discrete, outputs
from tests.simulator.effects import BODY, SHAFT
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine, State

MAX_ITERATIONS = 60
DIFFERENCE_STEP = 1e-4  # of scaled values, for derivatives
REST_DAMPING = 1e-6  # of the step by which convergence is judged
MIN_RESIDUAL_NORM = 1e-3  # in units of the noise; below it the fit has converged
RETRY_NUMBER = 3.0  # visibility above which the fit also starts with a softer shaft
SLOW_DECREASE, MAX_SLOW_ITERATIONS = 0.001, 4  # relative decrease of the norm; iterations in a row below it
SOFTER_SHAFT_SHARE = 0.7  # of the stiffness


@dataclass(frozen=True)
class Visibility:
    """What remains of an effect in the measured outputs.

    number     noise-weighted size of what the other model cannot imitate; half its square is the
               log likelihood ratio that the effect is worth on these records
    before     the same before anything is fitted
    rms        role -> root mean square of what remains, in the role's unit
    converged  whether the fit of the other model came to rest; if not, number is too large
    """

    number: float
    before: float
    rms: dict[str, float]
    converged: bool


def visible(case: Case, known: tuple[HiddenEffect, ...] = (),
            records: tuple[Record, ...] | None = None) -> Visibility:
    """Visibility of the hidden effects that are not `known` against the plain machine.

    known    effects of the case that belong to the plain machine here, at their true values
    records  the case's own to work on if None; each has start states of its own
    """
    records = case.records if records is None else records
    machine, logger = _machine_with_effects(case, {h.code: h.size for h in known})
    if all(h.size == 0.0 for h in case.hidden if h not in known):
        return Visibility(0.0, 0.0, dict.fromkeys(case.noise.sensors, 0.0), True)

    def result(share: float) -> Visibility:
        machine_start = replace(machine, stiffness=tuple(share * k for k in machine.stiffness))
        return _result(_Model(case, machine_start, logger, plain_fields(machine, case.rig.machine.bodies), records))

    found = result(1.0)
    if machine.bodies == 1 or found.number < RETRY_NUMBER:
        return found
    # A gap looks like a softer shaft, to which no way leads downhill from the true one.
    softer = result(SOFTER_SHAFT_SHARE)
    return replace(softer, before=found.before) if softer.number < found.number else found


def separation(case: Case, rival: str, sizes: tuple[float, ...] = (0.3, 1.0, 3.0),
               records: tuple[Record, ...] | None = None) -> Visibility:
    """The same against the plain machine with another effect, its values fitted too.

    Where this is small the two effects are indistinguishable on these records.
    rival  code of a law of the machine; sizes: where its fit starts, over the usual size
    """
    records = case.records if records is None else records
    # Without the rival at all it is no worse, and the fits may end in a local optimum.
    found = [visible(case, (), records)]
    truth, _ = _machine_with_effects(case, {h.code: h.size for h in case.hidden})
    for size in sizes:
        drawn, logger = _machine_with_effects(case, {rival: size * KINDS[rival].usual})
        for machine in (*_with_ripple_as_imbalance(drawn, truth), *_with_other_lag_order(drawn),
                        *_with_wide_stribeck(drawn, case.rig.top)):
            fields = plain_fields(machine, case.rig.machine.bodies) + law_fields(machine)
            found.append(_result(_Model(case, machine, logger, fields, records)))
    return min(found, key=lambda v: v.number)


def _with_ripple_as_imbalance(machine: Machine, truth: Machine) -> list[Machine]:
    """The machine, its ripple starting as a true imbalance: from elsewhere no fit finds order, size and sign."""
    (amplitude, _, _), (weight, ratio, phase) = machine.effects.ripple, truth.effects.imbalance
    if amplitude == 0.0 or weight == 0.0:
        return [machine]
    return [replace(machine, effects=replace(machine.effects, ripple=(weight, 1.0 / ratio, phase + k * math.pi)))
            for k in (0.0, 0.5, 1.0, 1.5)]


def _with_other_lag_order(machine: Machine) -> list[Machine]:
    """The machine with a lag of first order for one of second and the other way round: which is drawn is chance."""
    bandwidth, zeta = machine.converter_bandwidth, machine.converter_damping
    if bandwidth is None:
        return []
    other = Machine.converter_damping if math.isinf(zeta) else math.inf
    return [replace(machine, converter_damping=other,
                    converter_bandwidth=bandwidth * 2.0 * other if math.isinf(zeta) else bandwidth / (2.0 * zeta))]


def _with_wide_stribeck(machine: Machine, top: float) -> list[Machine]:
    """The machine with breakaway friction that falls over all of its speeds: in one direction a drag is like it."""
    extra = machine.effects.stribeck
    if not any(extra):
        return []
    return [replace(machine, effects=replace(
        machine.effects, stribeck=tuple(more * each for each in extra),
        stribeck_speed=tuple(0.5 * top if each else v for each, v in zip(
            extra, machine.effects.stribeck_speed, strict=True)))) for more in (3.0, 10.0)]


def _machine_with_effects(case: Case, sizes: dict[str, float]):
    """(machine, logger) of the rig with effects of these sizes, drawn as those of the case are."""
    seed = int(case.arguments["machine_seed"]) + 1000003 * int(case.arguments["seed"])
    machine, logger, _ = add_effects(list(sizes), case.rig, sizes, seed)
    return machine, logger


def _result(model: _Model) -> Visibility:
    point, before, number, converged = _fitted(model)
    rows = np.concatenate(model.residual(point))
    rms = dict(zip(model.roles, np.sqrt(np.mean(rows**2, axis=0)).tolist(), strict=True))
    return Visibility(number, before, rms, converged)


def _fitted(model: _Model):
    """(point, norm at the start, norm there, whether at rest) by Levenberg's method.

    A unit of every scaled parameter is a large step, so that the damping needs no scaling.
    """
    point, damping, slow_iterations = np.zeros(model.size), 1e-3, 0
    residual = model.white(model.residual(point))
    before = float(np.linalg.norm(residual))
    for _ in range(MAX_ITERATIONS):
        if slow_iterations == MAX_SLOW_ITERATIONS:
            break
        if np.linalg.norm(residual) < MIN_RESIDUAL_NORM:
            return point, before, float(np.linalg.norm(residual)), True
        slope = model.sensitivity(point)
        # A strongly damped step predicts little gain anywhere: convergence is judged by a nearly undamped one.
        if _step(slope, residual, REST_DAMPING)[1] < (1e-3 if model.linear else 1e-2):
            return point, before, float(np.linalg.norm(residual)), True
        for _ in range(12):
            step, predicted = _step(slope, residual, damping)
            trial = model.white(model.residual(point - step)) if np.abs(step).max() < 30.0 else residual
            drop = 1.0 - np.linalg.norm(trial) / np.linalg.norm(residual)
            if drop > 0.0:
                point, residual = point - step, trial
                damping *= 0.05 if drop > 0.5 * predicted else 1.0
                slow_iterations = slow_iterations + 1 if drop < SLOW_DECREASE else 0
                break
            damping *= 30.0
        else:
            break
    return point, before, float(np.linalg.norm(residual)), False


def _step(slope: np.ndarray, residual: np.ndarray, damping: float) -> tuple[np.ndarray, float]:
    """(damped step, share of the norm that it should take away)."""
    normal_matrix = slope.T @ slope
    # In directions without information the damping alone must exceed rounding errors.
    damped = normal_matrix + (damping + 1e-14 * np.trace(normal_matrix)) * np.eye(len(normal_matrix))
    step = np.linalg.solve(damped, slope.T @ residual)
    return step, 1.0 - float(np.linalg.norm(residual - slope @ step) / np.linalg.norm(residual))


# (name, index) of a value of the machine, or ("effects", name, index); index None: no tuple.
Field = tuple


def plain_fields(machine: Machine, bodies: int) -> list[Field]:
    """What a plain fit frees: all values that are there, idle torques of the known bodies."""
    fields = [(name, i) for name in ("inertia", "stiffness", "damping", "viscous", "coulomb")
              for i, value in enumerate(getattr(machine, name)) if value > 0.0]
    return fields + [("idle_torque", i) for i in range(bodies)]


def law_fields(machine: Machine) -> list[Field]:
    """The values of all further laws that are not neutral."""
    fields = [("half_gap", k) for k, gap in enumerate(machine.half_gap) if gap > 0.0]
    fields += [("dead_time", None)] * (machine.dead_time > 0.0)
    fields += [("converter_bandwidth", None)] * (machine.converter_bandwidth is not None)
    for each in dataclasses.fields(machine.effects):
        value = getattr(machine.effects, each.name)
        if isinstance(value, float):
            fields += [("effects", each.name, None)] * (value != each.default)
        elif value != each.default:
            fields += [("effects", each.name, i) for i, v in enumerate(value)
                       if math.isfinite(v) and v != (BODY | SHAFT).get(each.name)]
    return fields


def _value(machine: Machine, field: Field) -> float:
    owner = machine.effects if field[0] == "effects" else machine
    values = getattr(owner, field[-2])
    return values if field[-1] is None else values[field[-1]]


def _with(machine: Machine, field: Field, value: float) -> Machine:
    owner = machine.effects if field[0] == "effects" else machine
    if field[-1] is not None:
        values = list(getattr(owner, field[-2]))
        values[field[-1]] = value
        value = tuple(values)
    changed = replace(owner, **{field[-2]: value})
    return replace(machine, effects=changed) if field[0] == "effects" else changed


class _Model:
    """A machine as a function of scaled values and the records' start states.

    A point counts most values as changes of the logarithm, idle torques in hundredths of the rated
    torque, phases in radians, start states in hundredths of their scale.
    """

    def __init__(self, case: Case, machine: Machine, logger: Logger, fields: list[Field],
                 records: tuple[Record, ...]):
        self.rig, self.records, rig = case.rig, records, case.rig
        self.machine, self.logger, self.fields = machine, logger, fields
        self.roles = tuple(case.noise.sensors)
        speed = nominal_speed_noise(rig)
        floor = {"speed": 1e-3 * speed, "angle": 1e-5 * speed, "torque": 1e-6 * rig.rated}
        self.white_one = Whitener(rig.machine, self.roles, case.noise,
                                  {role: floor[role.rpartition("_")[2]] for role in self.roles})
        n = machine.bodies
        self.linear = machine.is_linear and not (machine.dead_time or machine.converter_bandwidth)
        twist = rig.rated / min(machine.stiffness, default=1.0)
        scales = [rig.top] * n + [twist] * (n - 1) + [rig.top] * any(r.endswith("angle") for r in self.roles)
        self.scales = 0.01 * np.array(scales)
        self.size = len(self.fields) + len(records) * len(self.scales)

    def at(self, point: np.ndarray) -> Machine:
        """The machine with the values of a point."""
        machine = self.machine
        for field, change in zip(self.fields, point.tolist(), strict=False):
            before = _value(self.machine, field)
            if field[0] == "idle_torque":
                machine = _with(machine, field, before + 0.01 * self.rig.rated * change)
            elif field[-2:] in (("ripple", 2), ("imbalance", 2)):
                machine = _with(machine, field, before + change)
            else:
                machine = _with(machine, field, before * math.exp(min(max(change, -3.0), 3.0)))
        return machine

    def residual(self, point: np.ndarray, which: int | None = None) -> list[np.ndarray]:
        """(n, roles) per record: logged minus what the machine of the point would have logged.

        which  the only record that counts; others are zero
        """
        machine, first, found = self.at(point), len(self.fields), []
        for i, record in enumerate(self.records):
            shift = point[first:first + len(self.scales)] * self.scales
            first += len(self.scales)
            counts = which in (None, i)
            found.append(self._residual_of(machine, record, shift) if counts else np.zeros(
                (len(record.run.time), len(self.roles))))
        return found

    def _residual_of(self, machine: Machine, record: Record, shift: np.ndarray) -> np.ndarray:
        n, run = machine.bodies, record.run
        scale = self.logger.scale.get("motor_torque", 1.0)
        torque = record.logged["motor_torque"] / scale - self.logger.offset.get("motor_torque", 0.0)
        known = self.rig.machine.bodies
        speeds = [*run.speeds[0, :known], *[run.speeds[0, known - 1]] * (n - known)]
        twists = _initial_twists(run, self.rig.machine)[:n - 1]
        twists += [0.0] * (n - 1 - len(twists))
        speeds, twists = np.array(speeds) + shift[:n], np.array(twists) + shift[n:2 * n - 1]
        angle = float(run.angles[0, 0] + (shift[2 * n - 1] if len(shift) == 2 * n else 0.0))
        if self.linear:
            x = np.array([*speeds, *twists, angle])
            f, g = (np.ascontiguousarray(a) for a in discrete(machine))
            inputs = np.outer(torque, g[:, 0]) + np.outer(record.noise["torque"], g[:, 1]) + g[:, 3]
            rows = _state_recursion(f, inputs, x) @ outputs(machine, self.roles).T
            clean = dict(zip(self.roles, rows.T, strict=True))
        else:
            simulated = simulate_fast(machine, torque, STEP, State(tuple(speeds), tuple(twists), angle, torque[0]),
                                 None, record.noise["torque"])
            clean = {"motor_speed": simulated.measured, **sensors_of(simulated, known)}
        measured = {role: clean[role] + record.noise[role] for role in self.roles}
        if self.logger != Logger():
            rng = np.random.default_rng([*record.seed, 15485863]).spawn(3)[2]
            measured = logged_values(self.logger, measured, rng)
        return np.column_stack([record.logged[role] - measured[role] for role in self.roles])

    def white(self, residual: list[np.ndarray]) -> np.ndarray:
        """All records in one vector, in units of the noise."""
        return np.concatenate([self.white_one(r[:, :, None]).ravel() for r in residual])

    def sensitivity(self, point: np.ndarray) -> np.ndarray:
        """(values, size) derivative of `white(residual(point))`; of a switching machine one-sided."""
        shared, start_states, columns = len(self.fields), len(self.scales), []
        reference = None if self.linear else self.residual(point)
        for j in range(self.size):
            which = None if j < shared else (j - shared) // start_states
            ahead = self._moved(point, j, DIFFERENCE_STEP, which)
            behind = self._moved(point, j, -DIFFERENCE_STEP, which) if self.linear else reference
            width = 2.0 * DIFFERENCE_STEP if self.linear else DIFFERENCE_STEP
            columns.append([(a - b) / width if which in (None, i) else np.zeros_like(a)
                            for i, (a, b) in enumerate(zip(ahead, behind, strict=True))])
        stacked = [np.stack([column[i] for column in columns], axis=2) for i in range(len(self.records))]
        return np.concatenate([self.white_one(s).reshape(-1, self.size) for s in stacked])

    def _moved(self, point: np.ndarray, j: int, by: float, which: int | None) -> list[np.ndarray]:
        """Residuals with value j changed; those of other records than `which` do not count."""
        moved = point.copy()
        moved[j] += by
        return self.residual(moved, which)


def _initial_twists(run, machine: Machine) -> list[float]:
    """Twists of the known shafts at the first sample."""
    return [float(run.angles[0, k] / ratio - run.angles[0, k + 1]) for k, ratio in enumerate(machine.ratio)]


@njit(cache=True)
def _state_recursion(f, inputs, x):
    out = np.empty((inputs.shape[0], x.size))
    for i in range(inputs.shape[0]):
        out[i] = x
        x = f @ x + inputs[i]
    return out
