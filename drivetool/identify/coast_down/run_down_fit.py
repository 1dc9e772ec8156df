"""Least squares of a simulated run-down and of what was measured of it, each value with its own weight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from drivetool.drive import Drive
from drivetool.drive.effects import FLUXES, VOLTAGES
from drivetool.drive.simulation import Trace
from drivetool.errors import BadRecording
from drivetool.identify.coast_down.readings import Reading, placed, reading_of, with_error
from drivetool.identify.coast_down.stretches import Stretch
from drivetool.identify.problem import Problem
from drivetool.identify.setup import Roles, fed_by_voltages, first_states, problem_of
from drivetool.logs import Experiment

ROUNDS = 12  # at most, in which counts are placed by the speed of the fit before
SETTLED = 0.01  # of a standard deviation, by which the values may still move; of a count, the error of its edges
BLOCKS = 30  # parts of the residuals, by whose sums their correlation is judged
MOST = 60  # steps of the solver
RANK = 1e-13  # of the largest eigenvalue, below which a direction is rounding
# Of an angle or a speed by the start state. Where friction brakes it is below the duration in seconds; where smooth
# friction is far too steep near standstill it runs away, and is left out: the motion counts.
RUNAWAY = 1e6
LEAST = 0.9  # of the motion of a run that a fit follows: without a law it leaves a hundredth, by a wrong sign all
PART = 1e-3  # of a direction that is rounding: what has more of a share in it is not known
GROUPS = 40  # of residuals over the speed, by whose means the law of the friction is judged


@dataclass(frozen=True)
class Run:
    """A stretch to fit: what was measured, inputs (n, nu) that acted, number and name of the recording.

    inputs of what is driven: motor torque, and the voltages of an induction motor; none where it is switched off
    start  what is known of the state in which it begins
    """

    reading: Reading
    inputs: np.ndarray
    record: int
    name: str
    origin: float
    start: Mapping[str, float]

    @property
    def roles(self) -> Roles:
        """What acts, and what was measured."""
        fed = self.inputs.shape[1] > 1
        return Roles(("motor_torque", *(VOLTAGES if fed else ())), (self.reading.role,))

    def driven(self, drive: Drive) -> Drive:
        """The drive as it is here: an open stator has no torque."""
        if self.inputs.shape[1] > 1 or not fed_by_voltages(drive):
            return drive
        return drive.with_values({"motor.magnetizing_inductance": 0.0})


def run_of(experiment: Experiment, stretch: Stretch) -> Run:
    """A stretch as it is fitted; raises BadRecording: too few counts."""
    a, b = stretch.first, stretch.last
    inputs, start = np.zeros((b - a, 1)), {}
    if not stretch.off:
        roles = ("motor_torque", *(r for r in VOLTAGES if r in experiment.signals))
        inputs = np.column_stack([experiment.signal(r, "the inertia")[a:b] for r in roles])
        if len(roles) > 1 and any(first < a < last for first, last in experiment.segments):
            start = dict.fromkeys(FLUXES, 0.0)  # it was just switched on
    return Run(reading_of(experiment, a, b), inputs, experiment.number, experiment.name,
               experiment.offset + a * experiment.step, start)


@dataclass(frozen=True)
class Prior:
    """What is known of parameters beforehand: names, values (p,), covariance (p, p)."""

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray

    def of(self, free: Sequence[str]) -> Prior:
        """The part of it that concerns what is fitted."""
        at = [i for i, n in enumerate(self.names) if n in free]
        return Prior(tuple(self.names[i] for i in at), self.values[at], self.covariance[np.ix_(at, at)])


NOTHING = Prior((), np.empty(0), np.empty((0, 0)))


@dataclass(frozen=True)
class Fitted:
    """Where a fit ended.

    values      (k,) of the free parameters, with their covariance (k, k); white: by the weights alone
    starts      start states per run; readings: with the placement of their counts
    left        residuals over their standard deviation (m,), all runs; speed (m,) of the motor there
    chi_square  of m - unknowns degrees of freedom
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    white: np.ndarray
    starts: tuple[np.ndarray, ...]
    readings: tuple[Reading, ...]
    left: np.ndarray
    speed: np.ndarray
    chi_square: float
    dof: int

    @property
    def found(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, map(float, self.values), strict=True))

    @property
    def misfit(self) -> float:
        """Probability that chance makes the means of the residuals over the speed as large.

        By the steps of counters alone: the noise of another sensor is not known to be white.
        """
        if not all(r.count for r in self.readings):
            return 1.0
        groups = np.array_split(self.left[np.argsort(self.speed, kind="stable")], GROUPS)
        square = sum(len(g) * float(g.mean()) ** 2 for g in groups if len(g))
        return float(chi2.sf(square, GROUPS))

    @property
    def by_run(self) -> list[np.ndarray]:
        """The residuals of each run."""
        return np.split(self.left, np.cumsum([len(r.known) for r in self.readings])[:-1])

    @property
    def speeds(self) -> list[np.ndarray]:
        """The speeds at the readings of each run."""
        return np.split(self.speed, np.cumsum([len(r.known) for r in self.readings])[:-1])

    @property
    def unlikely(self) -> float:
        """Minus twice the logarithm of the likelihood, but for a constant."""
        return self.chi_square + 2.0 * float(sum(np.log(r.std[r.known]).sum() for r in self.readings))

    def std(self, name: str) -> float:
        """Standard deviation of a free parameter."""
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))


def fit(drive: Drive, free: Sequence[str], runs: Sequence[Run],
        prior: Prior, rounds: int = ROUNDS) -> Fitted:
    """Fit parameters and the start states of all runs.

    drive  at its start values; free: names of the parameters that are fitted
    prior  what is known of them beforehand
    rounds at most, in which counts are placed anew
    """
    values = np.array([drive.value(n) for n in free], float)
    starts, readings = None, [r.reading for r in runs]
    for _ in range(rounds):
        used, before = readings, values
        problems = [problem(drive, free, run, r) for run, r in zip(runs, used, strict=True)]
        starts = starts or [first_states(run.driven(drive), run.roles, p.traces, free)[0]
                            for p, run in zip(problems, runs, strict=True)]
        values, starts, rows, left = _solved(problems, used, values, starts, prior)
        passes = [p.plants(values, False)[0].simulate(p.traces[0], s, keep=True)
                  for p, s in zip(problems, starts, strict=True)]
        for run, one in zip(runs, passes, strict=True):
            _refuse_another(run, one[0][:, 0])
        speeds = [one[1][:, 0] for one in passes]
        residuals = np.concatenate(left)
        covariance, white = _covariances(rows, residuals, len(free))
        std = np.sqrt(np.maximum(np.diag(white), 1e-300))
        if not any(r.count for r in used):
            break
        readings = [placed(with_error(r, e * r.std[r.known]), w) if r.count else r
                    for r, e, w in zip(used, left, speeds, strict=True)]
        blurs = [abs(r.error - u.error) for r, u in zip(readings, used, strict=True)]
        if np.all(np.abs(values - before) < SETTLED * std) and all(
                b <= SETTLED * r.count for b, r in zip(blurs, readings, strict=True)):
            break
    return Fitted(tuple(free), values, covariance, white, tuple(starts), tuple(used),
                  residuals, np.concatenate([w[r.known] for r, w in zip(used, speeds, strict=True)]),
                  float(residuals @ residuals), max(len(residuals) - rows.shape[1], 1))


def simulated(drive: Drive, run: Run, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(what the sensor of a run would show without its steps (n,), speed of the motor (n,)) from a start state."""
    one = problem(drive, (), run, run.reading)
    out, states = one.plants(np.empty(0), False)[0].simulate(one.traces[0], start, keep=True)[:2]
    return out[:, 0], states[:, 0]


def _refuse_another(run: Run, simulated: np.ndarray) -> None:
    """Refuse a driven run that goes another way than its torque lets any inertia and friction go."""
    r = run.reading
    if not run.inputs.any():
        return
    y = r.values[r.known]
    followed = 1.0 - float(np.sqrt(np.mean((y - simulated[r.known]) ** 2)) / np.std(y))
    if not followed > LEAST:
        raise BadRecording(
            f"a motion of {run.name} that some inertia and friction give",
            f"{max(100.0 * followed, 0.0):.2g} % of it",
            "Check the sign and scale of the torque; of an induction motor its pole pairs, resistances, "
            "inductances and the voltage.")


def problem(drive: Drive, free: Sequence[str], run: Run, reading: Reading) -> Problem:
    """One run, with what was read of it, as a problem of the free parameters."""
    trace = Trace(run.inputs, reading.values[:, None], reading.step, run.name, run.origin, run.record,
                  start=run.start)
    return problem_of(run.driven(drive), free, run.roles, (trace,))


def _solved(problems: Sequence[Problem], readings: Sequence[Reading], values: np.ndarray,
            starts: Sequence[np.ndarray], prior: Prior,
            ) -> tuple[np.ndarray, list[np.ndarray], np.ndarray, list[np.ndarray]]:
    """Where it ends: values, start states, weighted derivatives (m + priors, unknowns), residuals per run."""
    k, names = len(values), problems[0].names
    free_start = [np.array([i for i in p.free_start if i not in p.known(0)], int) for p in problems]
    ends = k + np.cumsum([0, *map(len, free_start)])
    known = [names.index(n) for n in prior.names]
    white = np.linalg.inv(np.linalg.cholesky(prior.covariance)) if known else np.empty((0, 0))

    def parts(x: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        left, rows = [], []
        for p, r, start, own, a, b in zip(problems, readings, starts, free_start, ends[:-1], ends[1:], strict=True):
            begin = start.copy()
            begin[own] = x[a:b]
            plant, at = p.plants(x[:k], True)[0], r.known
            out, slopes = plant.jacobian(p.traces[0], begin)
            tame = np.all(np.abs(slopes[:, 0][:, plant.system.nq + own]) < RUNAWAY, axis=1) & np.all(
                np.isfinite(slopes[:, 0]), axis=1)
            slopes = np.where(tame[:, None, None], slopes, 0.0)
            weight = 1.0 / r.std[at]
            left.append((out[at, 0] - r.values[at]) * weight)
            block = np.zeros((len(at), ends[-1]))
            block[:, :k] = slopes[at, 0, :k] * weight[:, None]
            block[:, a:b] = slopes[at, 0][:, plant.system.nq + own] * weight[:, None]
            rows.append(block)
        if known:
            left.append(white @ (x[known] - prior.values))
            rows.append(white @ np.eye(ends[-1])[known])
        return left, np.concatenate(rows)

    memory: dict[bytes, tuple[list[np.ndarray], np.ndarray]] = {}

    def at(x: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        key = x.tobytes()
        if key not in memory:
            memory.clear()
            memory[key] = parts(x)
        return memory[key]

    first = np.concatenate([values, *(s[own] for s, own in zip(starts, free_start, strict=True))])
    low = np.concatenate([problems[0].low, np.full(ends[-1] - k, -np.inf)])
    high = np.concatenate([problems[0].high, np.full(ends[-1] - k, np.inf)])
    found = least_squares(lambda x: np.concatenate(at(x)[0]), np.clip(first, low, high), lambda x: at(x)[1],
                          (low, high), "dogbox", x_scale="jac", ftol=1e-12, xtol=1e-12, gtol=1e-12, max_nfev=MOST).x
    left, rows = at(found)
    ended = []
    for start, own, a, b in zip(starts, free_start, ends[:-1], ends[1:], strict=True):
        begin = start.copy()
        begin[own] = found[a:b]
        ended.append(begin)
    return found[:k], ended, rows, left[:len(problems)]


def _covariances(rows: np.ndarray, left: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """(k, k) of the free parameters: by how the residuals add up in blocks, if that is more; by the weights.

    Where the sensor's steps follow the motion for a while, as at a count per sample, or its noise is filtered, the
    residuals are correlated. Sums over blocks that are longer than that say what they leave.
    """
    size = np.sqrt((rows**2).sum(axis=0))
    mute = size == 0.0
    size[mute] = 1.0
    scaled = rows / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=RANK, hermitian=True)
    sizes, ways = np.linalg.eigh(scaled.T @ scaled)
    mute |= np.abs(ways[:, sizes < RANK * sizes[-1]]).max(axis=1, initial=0.0) > PART
    edges = np.linspace(0, len(left), BLOCKS + 1).round().astype(int)
    sums = np.array([scaled[a:b].T @ left[a:b] for a, b in pairwise(edges)])
    told = scaled[len(left):]
    blocks = inverse @ (sums.T @ sums * BLOCKS / (BLOCKS - 1) + told.T @ told) @ inverse
    more = np.sqrt(np.maximum(np.diag(blocks) / np.maximum(np.diag(inverse), 1e-300), 1.0))
    inverse[mute, mute] = np.inf  # what moves nothing is not known
    more[mute] = 1.0
    white = (inverse / np.outer(size, size))[:k, :k]
    return white * np.outer(more, more)[:k, :k], white
