"""How much of an effect the noise lets through, once the plain parameters have imitated what they can.

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

MOST_ROUNDS = 60
SMALL = 1e-4
WEAK = 1e-6
NOTHING = 1e-3
FAINT = 3.0
SLOW, PATIENCE = 0.001, 4
SOFTER = 0.7


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
    machine, logger = _concealed(case, {h.code: h.size for h in known})
    if all(h.size == 0.0 for h in case.hidden if h not in known):
        return Visibility(0.0, 0.0, dict.fromkeys(case.noise.sensors, 0.0), True)

    def result(share: float) -> Visibility:
        machine_start = replace(machine, stiffness=tuple(share * k for k in machine.stiffness))
        return _result(_Model(case, machine_start, logger, plain_fields(machine, case.rig.machine.bodies), records))

    found = result(1.0)
    if machine.bodies == 1 or found.number < FAINT:
        return found
    # A gap looks like a softer shaft, to which no way leads downhill from the true one.
    softer = result(SOFTER)
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
    truth, _ = _concealed(case, {h.code: h.size for h in case.hidden})
    for size in sizes:
        drawn, logger = _concealed(case, {rival: size * KINDS[rival].usual})
        for machine in (*_in_step(drawn, truth), *_of_other_order(drawn), *_over_all_speeds(drawn, case.rig.top)):
            fields = plain_fields(machine, case.rig.machine.bodies) + law_fields(machine)
            found.append(_result(_Model(case, machine, logger, fields, records)))
    return min(found, key=lambda v: v.number)


def _in_step(machine: Machine, truth: Machine) -> list[Machine]:
    """The machine, its ripple starting as a true imbalance: no fit finds an order, a size or a sign from afar."""
    (amplitude, _, _), (weight, ratio, phase) = machine.effects.ripple, truth.effects.imbalance
    if amplitude == 0.0 or weight == 0.0:
        return [machine]
    return [replace(machine, effects=replace(machine.effects, ripple=(weight, 1.0 / ratio, phase + k * math.pi)))
            for k in (0.0, 0.5, 1.0, 1.5)]


def _of_other_order(machine: Machine) -> list[Machine]:
    """The machine with a lag of first order for one of second and the other way round: which is drawn is chance."""
    bandwidth, zeta = machine.converter_bandwidth, machine.converter_damping
    if bandwidth is None:
        return []
    other = Machine.converter_damping if math.isinf(zeta) else math.inf
    return [replace(machine, converter_damping=other,
                    converter_bandwidth=bandwidth * 2.0 * other if math.isinf(zeta) else bandwidth / (2.0 * zeta))]


def _over_all_speeds(machine: Machine, top: float) -> list[Machine]:
    """The machine with breakaway friction that falls over all of its speeds: in one direction a drag is like it."""
    extra = machine.effects.stribeck
    if not any(extra):
        return []
    return [replace(machine, effects=replace(
        machine.effects, stribeck=tuple(more * each for each in extra),
        stribeck_speed=tuple(0.5 * top if each else v for each, v in zip(
            extra, machine.effects.stribeck_speed, strict=True)))) for more in (3.0, 10.0)]


def _concealed(case: Case, sizes: dict[str, float]):
    """(machine, logger) of the rig with effects of these sizes, drawn as those of the case are."""
    seed = int(case.arguments["machine_seed"]) + 1000003 * int(case.arguments["seed"])
    machine, logger, _ = add_effects(list(sizes), case.rig, sizes, seed)
    return machine, logger


def _result(model: _Model) -> Visibility:
    point, before, left, converged = _fitted(model)
    rows = np.concatenate(model.residual(point))
    rms = dict(zip(model.roles, np.sqrt(np.mean(rows**2, axis=0)).tolist(), strict=True))
    return Visibility(left, before, rms, converged)


def _fitted(model: _Model):
    """(point, norm at the start, norm there, whether at rest) by Levenberg's method.

    A unit of every scaled parameter is a large step, so that the damping needs no scaling.
    """
    point, damping, slow = np.zeros(model.size), 1e-3, 0
    left = model.white(model.residual(point))
    before = float(np.linalg.norm(left))
    for _ in range(MOST_ROUNDS):
        if slow == PATIENCE:
            break
        if np.linalg.norm(left) < NOTHING:
            return point, before, float(np.linalg.norm(left)), True
        slope = model.sensitivity(point)
        # A step that is damped much promises little wherever it begins: rest is judged by one that hardly is.
        if _step(slope, left, WEAK)[1] < (1e-3 if model.linear else 1e-2):
            return point, before, float(np.linalg.norm(left)), True
        for _ in range(12):
            step, promised = _step(slope, left, damping)
            trial = model.white(model.residual(point - step)) if np.abs(step).max() < 30.0 else left
            drop = 1.0 - np.linalg.norm(trial) / np.linalg.norm(left)
            if drop > 0.0:
                point, left = point - step, trial
                damping *= 0.05 if drop > 0.5 * promised else 1.0
                slow = slow + 1 if drop < SLOW else 0
                break
            damping *= 30.0
        else:
            break
    return point, before, float(np.linalg.norm(left)), False


def _step(slope: np.ndarray, left: np.ndarray, damping: float) -> tuple[np.ndarray, float]:
    """(damped step, share of the norm that it should take away)."""
    square = slope.T @ slope
    # Of what nothing shows the damping alone must hold against rounding.
    step = np.linalg.solve(square + (damping + 1e-14 * np.trace(square)) * np.eye(len(square)), slope.T @ left)
    return step, 1.0 - float(np.linalg.norm(left - slope @ step) / np.linalg.norm(left))


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
        for field, by in zip(self.fields, point.tolist(), strict=False):
            before = _value(self.machine, field)
            if field[0] == "idle_torque":
                machine = _with(machine, field, before + 0.01 * self.rig.rated * by)
            elif field[-2:] in (("ripple", 2), ("imbalance", 2)):
                machine = _with(machine, field, before + by)
            else:
                machine = _with(machine, field, before * math.exp(min(max(by, -3.0), 3.0)))
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
            found.append(self._one(machine, record, shift) if counts else np.zeros(
                (len(record.run.time), len(self.roles))))
        return found

    def _one(self, machine: Machine, record: Record, shift: np.ndarray) -> np.ndarray:
        n, run = machine.bodies, record.run
        scale = self.logger.scale.get("motor_torque", 1.0)
        torque = record.logged["motor_torque"] / scale - self.logger.offset.get("motor_torque", 0.0)
        known = self.rig.machine.bodies
        speeds = [*run.speeds[0, :known], *[run.speeds[0, known - 1]] * (n - known)]
        twists = _twists(run, self.rig.machine)[:n - 1]
        twists += [0.0] * (n - 1 - len(twists))
        speeds, twists = np.array(speeds) + shift[:n], np.array(twists) + shift[n:2 * n - 1]
        angle = float(run.angles[0, 0] + (shift[2 * n - 1] if len(shift) == 2 * n else 0.0))
        if self.linear:
            x = np.array([*speeds, *twists, angle])
            f, g = (np.ascontiguousarray(a) for a in discrete(machine))
            drive = np.outer(torque, g[:, 0]) + np.outer(record.noise["torque"], g[:, 1]) + g[:, 3]
            rows = _recursion(f, drive, x) @ outputs(machine, self.roles).T
            clean = dict(zip(self.roles, rows.T, strict=True))
        else:
            made = simulate_fast(machine, torque, STEP, State(tuple(speeds), tuple(twists), angle, torque[0]),
                                 None, record.noise["torque"])
            clean = {"motor_speed": made.measured, **sensors_of(made, known)}
        seen = {role: clean[role] + record.noise[role] for role in self.roles}
        if self.logger != Logger():
            seen = logged_values(self.logger, seen, np.random.default_rng([*record.seed, 15485863]).spawn(3)[2])
        return np.column_stack([record.logged[role] - seen[role] for role in self.roles])

    def white(self, residual: list[np.ndarray]) -> np.ndarray:
        """All records in one vector, in units of the noise."""
        return np.concatenate([self.white_one(r[:, :, None]).ravel() for r in residual])

    def sensitivity(self, point: np.ndarray) -> np.ndarray:
        """(values, size) derivative of `white(residual(point))`; of a switching machine one-sided."""
        shared, each, columns = len(self.fields), len(self.scales), []
        middle = None if self.linear else self.residual(point)
        for j in range(self.size):
            which = None if j < shared else (j - shared) // each
            ahead = self._moved(point, j, SMALL, which)
            behind = self._moved(point, j, -SMALL, which) if self.linear else middle
            width = 2.0 * SMALL if self.linear else SMALL
            columns.append([(a - b) / width if which in (None, i) else np.zeros_like(a)
                            for i, (a, b) in enumerate(zip(ahead, behind, strict=True))])
        stacked = [np.stack([column[i] for column in columns], axis=2) for i in range(len(self.records))]
        return np.concatenate([self.white_one(s).reshape(-1, self.size) for s in stacked])

    def _moved(self, point: np.ndarray, j: int, by: float, which: int | None) -> list[np.ndarray]:
        """Residuals with value j changed; those of other records than `which` do not count."""
        moved = point.copy()
        moved[j] += by
        return self.residual(moved, which)


def _twists(run, machine: Machine) -> list[float]:
    """Twists of the known shafts at the first sample."""
    return [float(run.angles[0, k] / ratio - run.angles[0, k + 1]) for k, ratio in enumerate(machine.ratio)]


@njit(cache=True)
def _recursion(f, drive, x):
    out = np.empty((drive.shape[0], x.size))
    for i in range(drive.shape[0]):
        out[i] = x
        x = f @ x + drive[i]
    return out
