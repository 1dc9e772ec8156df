"""How much of an effect the noise lets through, once the plain parameters have imitated what they can.

Computed from the truth: the record with the effect against the plain machine under the logged
torque, its parameters and start states fitted, the difference weighed by the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from tests.hidden.case import Case, Record, conceal, sensors_of, through
from tests.hidden.effects import Hiding, Logger, nominal_speed_noise
from tests.hidden.profiles import STEP
from tests.hidden.whiten import Whitener, discrete, outputs
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine, State

MOST_ROUNDS, FEW_ROUNDS = 40, 5
SMALL = 1e-4


@dataclass(frozen=True)
class Visibility:
    """What remains of an effect in the measured outputs.

    number     noise-weighted size of what the plain parameters cannot imitate; half its square is
               the log likelihood ratio that the effect is worth on these records
    before     the same before anything is fitted
    rms        role -> root mean square of what remains, in the role's unit
    converged  whether the fit of the plain parameters came to rest; if not, number is too large
    """

    number: float
    before: float
    rms: dict[str, float]
    converged: bool


def visible(case: Case, known: tuple[Hiding, ...] = (), records: tuple[Record, ...] | None = None) -> Visibility:
    """Visibility of the hidden effects that are not `known`.

    known    effects of the case that belong to the plain machine here, at their true values
    records  the case's own to work on if None; each has start states of its own
    """
    plain = _Plain(case, known, case.records if records is None else records)
    if all(h.size == 0.0 for h in case.hidden if h not in known):
        return Visibility(0.0, 0.0, dict.fromkeys(plain.roles, 0.0), True)
    point, before, left, converged = _fitted(plain)
    rows = np.concatenate(plain.residual(point))
    rms = dict(zip(plain.roles, np.sqrt(np.mean(rows**2, axis=0)).tolist(), strict=True))
    return Visibility(left, before, rms, converged)


def _fitted(plain: _Plain):
    """(point, norm at the start, norm there, whether at rest) by Levenberg's method.

    A unit of every scaled parameter is a large step, so that the damping needs no scaling.
    """
    point, damping = np.zeros(plain.size), 1e-3
    left = plain.white(plain.residual(point))
    before = float(np.linalg.norm(left))
    for _ in range(MOST_ROUNDS if plain.linear else FEW_ROUNDS):
        slope = plain.sensitivity(point)
        square, pull = slope.T @ slope, slope.T @ left
        for _ in range(12):
            step = np.linalg.solve(square + damping * np.eye(plain.size), pull)
            promised = 1.0 - np.linalg.norm(left - slope @ step) / np.linalg.norm(left)
            if promised < 1e-3:
                return point, before, float(np.linalg.norm(left)), True
            trial = plain.white(plain.residual(point - step)) if np.abs(step).max() < 30.0 else left
            drop = 1.0 - np.linalg.norm(trial) / np.linalg.norm(left)
            if drop > 0.0:
                point, left = point - step, trial
                damping *= 0.05 if drop > 0.5 * promised else 1.0
                break
            damping *= 30.0
        else:
            break
    return point, before, float(np.linalg.norm(left)), False


class _Plain:
    """The plain machine as a function of its scaled parameters and the records' start states.

    A point counts inertias, stiffness, damping, friction as changes of the logarithm, idle torques
    in hundredths of the rated torque, start states in hundredths of their scale.
    """

    def __init__(self, case: Case, known: tuple[Hiding, ...], records: tuple[Record, ...]):
        self.rig, self.records, rig = case.rig, records, case.rig
        sizes = {h.code: h.size for h in known}
        seed = int(case.asked["machine_seed"]) + 1000003 * int(case.asked["seed"])
        self.machine, self.logger, _ = conceal(list(sizes), rig, sizes, seed)
        self.roles = tuple(case.noise.sensors)
        speed = nominal_speed_noise(rig)
        floor = {"speed": 1e-3 * speed, "angle": 1e-5 * speed, "torque": 1e-6 * rig.rated}
        self.white_one = Whitener(rig.machine, self.roles, case.noise,
                                  {role: floor[role.rpartition("_")[2]] for role in self.roles})
        n, many = self.machine.bodies, self.machine
        self.linear = many.is_linear and not (many.dead_time or many.converter_bandwidth)
        self.fields = [(name, i) for name in ("inertia", "stiffness", "damping", "viscous", "coulomb")
                       for i, value in enumerate(getattr(many, name)) if value > 0.0]
        self.fields += [("idle_torque", i) for i in range(rig.machine.bodies)]
        twist = rig.rated / min(many.stiffness, default=1.0)
        scales = [rig.top] * n + [twist] * (n - 1) + [rig.top] * any(r.endswith("angle") for r in self.roles)
        self.scales = 0.01 * np.array(scales)
        self.size = len(self.fields) + len(records) * len(self.scales)

    def at(self, point: np.ndarray) -> Machine:
        """The machine with the values of a point."""
        changed = {}
        for (name, i), value in zip(self.fields, point, strict=False):
            values = list(changed.get(name, getattr(self.machine, name)))
            values[i] = (values[i] + 0.01 * self.rig.rated * value if name == "idle_torque"
                         else values[i] * float(np.exp(np.clip(value, -3.0, 3.0))))
            changed[name] = tuple(values)
        return replace(self.machine, **changed)

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
            seen = through(self.logger, seen, np.random.default_rng([*record.seed, 15485863]).spawn(3)[2])
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
