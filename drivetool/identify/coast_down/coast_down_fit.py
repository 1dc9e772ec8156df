"""Least squares of a simulated coast-down against its measurements, each value with its own weight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from drivetool.drive import Drive
from drivetool.drive.effects import FLUXES, VOLTAGES
from drivetool.drive.simulation import Trace
from drivetool.errors import BadRecording
from drivetool.identify.coast_down.readings import Reading, reading_of, with_encoder_error, with_placed_counts
from drivetool.identify.coast_down.stretches import Stretch
from drivetool.identify.problem import Problem
from drivetool.identify.setup import Roles, fed_by_voltages, first_states, problem_of
from drivetool.logs import Experiment
from drivetool.logs.samples import MAD_PER_STD

# In which counts are placed by the speed of the fit before, at most. A choice: it bounds the time.
MAX_PLACEMENT_ROUNDS = 12
# Share of a standard deviation by which values may still change, and of a count for the error of its edges. A
# choice: a change that no interval shows.
CONVERGED_SHARE = 0.01
# Of residuals, whose sums include their correlation: a variance from 30 is known to 26 %, sqrt(2/29).
RESIDUAL_BLOCKS = 30
# Evaluations of the solver. A choice: it bounds the time, and the rounds continue where it stopped.
MAX_SOLVER_STEPS = 60
# Of the largest eigenvalue, below which a direction is rounding: some hundred machine epsilons.
MIN_EIGENVALUE_RATIO = 1e-13
# Derivative of an angle or a speed by the start state. With friction it is below the duration in seconds; where
# smooth friction is far too steep near standstill it diverges, and the sample is left out.
MAX_START_DERIVATIVE = 1e6
# Share of the motion of a run that a fit must follow: a missing law leaves a hundredth, a wrong sign all.
MIN_FOLLOWED_MOTION = 0.9
MAX_NULL_SHARE = 1e-3  # of a direction that is rounding: a parameter with a larger share in it is not identifiable
# Of residuals over the speed, whose means test the friction law. A choice: they resolve its shape.
SPEED_GROUPS = 40
# Of the cosine series of these means, which have a test of their own: a missing law is smooth over the speed, and
# the fit takes three of its terms. A choice: 4 to 10 find as many missing drags.
SMOOTH_TERMS = 6
# Degrees of freedom of a long-run variance. Calibrated: of 500 right records, with white noise, behind a
# first-order lag of up to an eightieth of the record or a mean over up to a fortieth, one is warned.
LONG_RUN_DOF = 20.0
KNOWN_VARIANCE_DOF = 1e9  # of a variance that is known, as that of counts
# Share of the range of a sensor, below which means of residuals are errors of the simulation. A choice: it is exact
# to rounding with viscous and Coulomb friction, and to some 1e-8 with smooth laws.
SIMULATION_ACCURACY = 1e-7


@dataclass(frozen=True)
class Run:
    """A stretch to fit: its reading, inputs (n, nu) that acted, number and name of the recording.

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
        """Roles of the inputs and of the measured output."""
        fed = self.inputs.shape[1] > 1
        return Roles(("motor_torque", *(VOLTAGES if fed else ())), (self.reading.role,))

    def driven(self, drive: Drive) -> Drive:
        """The drive in this run: an open stator has no torque."""
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
    """The prior of parameters: names, values (p,), covariance (p, p)."""

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray

    def of(self, free: Sequence[str]) -> Prior:
        """The part for the parameters that are fitted."""
        at = [i for i, n in enumerate(self.names) if n in free]
        return Prior(tuple(self.names[i] for i in at), self.values[at], self.covariance[np.ix_(at, at)])


NO_PRIOR = Prior((), np.empty(0), np.empty((0, 0)))


@dataclass(frozen=True)
class CoastDownFit:
    """The result of a fit.

    values      (k,) of the free parameters, with their covariance (k, k); white: by the weights alone
    starts      start states per run; readings: with the placement of their counts
    weighted_residuals  residuals over their standard deviation (m,), all runs; speed (m,) of the motor there
    chi_square  of m - unknowns degrees of freedom
    long_run_variances  per run, variance of a mean of residuals times their number: 1 for independent ones
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    white: np.ndarray
    starts: tuple[np.ndarray, ...]
    readings: tuple[Reading, ...]
    weighted_residuals: np.ndarray
    speed: np.ndarray
    chi_square: float
    dof: int
    long_run_variances: tuple[float, ...] = ()

    @property
    def found(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, map(float, self.values), strict=True))

    @property
    def misfit(self) -> float:
        """Probability by chance of means of the residuals over the speed as large as these.

        Their squares over the long-run variance of the sensor's noise, of all groups and of a smooth function of
        the speed. The noise may be filtered.
        """
        moving = self.speed != 0.0  # at rest a sensor may have another noise, or none
        errors = np.concatenate([e / np.sqrt(v) for e, v in zip(
            self.by_run, self.long_run_variances, strict=True)])[moving]
        groups = np.array_split(errors[np.argsort(self.speed[moving], kind="stable")], SPEED_GROUPS)
        means = np.array([np.sqrt(len(g)) * g.mean() for g in groups if len(g)])
        squares = scipy.fft.dct(means, norm="ortho") ** 2
        dof = LONG_RUN_DOF * sum(not r.count for r in self.readings) or KNOWN_VARIANCE_DOF
        return min(1.0, 2.0 * min(float(scipy.stats.f.sf(s.mean(), len(s), dof)) for s in (
            squares, squares[:SMOOTH_TERMS])))

    @property
    def by_run(self) -> list[np.ndarray]:
        """The residuals of each run."""
        return np.split(self.weighted_residuals, np.cumsum([len(r.known) for r in self.readings])[:-1])

    @property
    def speeds(self) -> list[np.ndarray]:
        """The speeds at the readings of each run."""
        return np.split(self.speed, np.cumsum([len(r.known) for r in self.readings])[:-1])

    @property
    def deviance(self) -> float:
        """Minus twice the logarithm of the likelihood, up to a constant."""
        return self.chi_square + 2.0 * float(sum(np.log(r.std[r.known]).sum() for r in self.readings))

    def std(self, name: str) -> float:
        """Standard deviation of a free parameter."""
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))


def fit(drive: Drive, free: Sequence[str], runs: Sequence[Run],
        prior: Prior, rounds: int = MAX_PLACEMENT_ROUNDS) -> CoastDownFit:
    """Fit parameters and the start states of all runs.

    drive  at its start values; free: names of the parameters that are fitted
    prior  of these parameters
    rounds at most, each of which places the counts again
    """
    values = np.array([drive.value(n) for n in free], float)
    starts, readings = None, [r.reading for r in runs]
    for _ in range(rounds):
        used, before = readings, values
        problems = [run_problem(drive, free, run, r) for run, r in zip(runs, used, strict=True)]
        starts = starts or [first_states(run.driven(drive), run.roles, p.traces, free)[0]
                            for p, run in zip(problems, runs, strict=True)]
        values, starts, rows, residuals_by_run = _solve(problems, used, values, starts, prior)
        passes = [p.plants(values, False)[0].simulate(p.traces[0], s, keep=True)
                  for p, s in zip(problems, starts, strict=True)]
        for run, one in zip(runs, passes, strict=True):
            _refuse_wrong_motion(run, one[0][:, 0])
        speeds = [one[1][:, 0] for one in passes]
        residuals = np.concatenate(residuals_by_run)
        variances = _long_run_variances(used, residuals_by_run, speeds)
        covariance, white = _covariances(rows, residuals, np.repeat(variances, [len(e) for e in residuals_by_run]),
                                         len(free))
        std = np.sqrt(np.maximum(np.diag(white), 1e-300))
        if not any(r.count for r in used):
            break
        readings = [with_placed_counts(with_encoder_error(r, e * r.std[r.known]), w) if r.count else r
                    for r, e, w in zip(used, residuals_by_run, speeds, strict=True)]
        error_changes = [abs(r.error - u.error) for r, u in zip(readings, used, strict=True)]
        if np.all(np.abs(values - before) < CONVERGED_SHARE * std) and all(
                b <= CONVERGED_SHARE * r.count for b, r in zip(error_changes, readings, strict=True)):
            break
    return CoastDownFit(tuple(free), values, covariance, white, tuple(starts), tuple(used),
                  residuals, np.concatenate([w[r.known] for r, w in zip(used, speeds, strict=True)]),
                  float(residuals @ residuals), max(len(residuals) - rows.shape[1], 1), variances)


def simulated(drive: Drive, run: Run, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(output of a run's sensor without quantisation (n,), speed of the motor (n,)) from a start state."""
    one = run_problem(drive, (), run, run.reading)
    out, states = one.plants(np.empty(0), False)[0].simulate(one.traces[0], start, keep=True)[:2]
    return out[:, 0], states[:, 0]


def _refuse_wrong_motion(run: Run, simulated: np.ndarray) -> None:
    """Refuse a driven run whose motion no inertia and friction explain by its torque."""
    r = run.reading
    if not run.inputs.any():
        return
    y = r.values[r.known]
    followed = 1.0 - float(np.sqrt(np.mean((y - simulated[r.known]) ** 2)) / np.std(y))
    if not followed > MIN_FOLLOWED_MOTION:
        raise BadRecording(
            f"a motion of {run.name} that its torque, an inertia and friction explain",
            f"a fit of {max(100.0 * followed, 0.0):.2g} %",
            "Check the sign and scale of the torque; of an induction motor its pole pairs, resistances, "
            "inductances and the voltage.")


def run_problem(drive: Drive, free: Sequence[str], run: Run, reading: Reading) -> Problem:
    """One run with its reading as a problem of the free parameters."""
    trace = Trace(run.inputs, reading.values[:, None], reading.step, run.name, run.origin, run.record,
                  start=run.start)
    return problem_of(run.driven(drive), free, run.roles, (trace,))


def _solve(problems: Sequence[Problem], readings: Sequence[Reading], values: np.ndarray,
            starts: Sequence[np.ndarray], prior: Prior,
            ) -> tuple[np.ndarray, list[np.ndarray], np.ndarray, list[np.ndarray]]:
    """The optimum: values, start states, weighted derivatives (m + priors, unknowns), residuals per run."""
    k, names = len(values), problems[0].names
    free_start = [np.array([i for i in p.free_start if i not in p.known(0)], int) for p in problems]
    ends = k + np.cumsum([0, *map(len, free_start)])
    known = [names.index(n) for n in prior.names]
    white = np.linalg.inv(np.linalg.cholesky(prior.covariance)) if known else np.empty((0, 0))

    def starts_at(x: np.ndarray) -> list[np.ndarray]:
        found = [start.copy() for start in starts]
        for begin, own, a, b in zip(found, free_start, ends[:-1], ends[1:], strict=True):
            begin[own] = x[a:b]
        return found

    def parts(x: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        residuals, rows = [], []
        for p, r, begin, own, a, b in zip(
                problems, readings, starts_at(x), free_start, ends[:-1], ends[1:], strict=True):
            plant, at = p.plants(x[:k], True)[0], r.known
            out, slopes = plant.jacobian(p.traces[0], begin)
            bounded = (np.all(np.abs(slopes[:, 0][:, plant.system.nq + own]) < MAX_START_DERIVATIVE, axis=1)
                       & np.all(np.isfinite(slopes[:, 0]), axis=1))
            slopes = np.where(bounded[:, None, None], slopes, 0.0)
            weight = 1.0 / r.std[at]
            residuals.append((out[at, 0] - r.values[at]) * weight)
            block = np.zeros((len(at), ends[-1]))
            block[:, :k] = slopes[at, 0, :k] * weight[:, None]
            block[:, a:b] = slopes[at, 0][:, plant.system.nq + own] * weight[:, None]
            rows.append(block)
        if known:
            residuals.append(white @ (x[known] - prior.values))
            rows.append(white @ np.eye(ends[-1])[known])
        return residuals, np.concatenate(rows)

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
    found = scipy.optimize.least_squares(
        lambda x: np.concatenate(at(x)[0]), np.clip(first, low, high), lambda x: at(x)[1], (low, high), "dogbox",
        x_scale="jac", ftol=1e-12, xtol=1e-12, gtol=1e-12, max_nfev=MAX_SOLVER_STEPS).x
    residuals, rows = at(found)
    return found[:k], starts_at(found), rows, residuals[:len(problems)]


def _covariances(rows: np.ndarray, residuals: np.ndarray, variances: np.ndarray,
                 k: int) -> tuple[np.ndarray, np.ndarray]:
    """(k, k) of the free parameters: by sums of residuals over blocks or by long-run variances, where larger.

    The second one is by the weights. variances: (m,) long-run variances of the residuals (m,)

    The residuals are correlated where quantisation follows the motion for a while, as at a count per sample, or
    where the noise is filtered. Sums over blocks longer than the correlation include it.
    """
    size = np.sqrt((rows**2).sum(axis=0))
    without_effect = size == 0.0
    size[without_effect] = 1.0
    scaled = rows / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=MIN_EIGENVALUE_RATIO, hermitian=True)
    sizes, directions = np.linalg.eigh(scaled.T @ scaled)
    without_effect |= np.abs(
        directions[:, sizes < MIN_EIGENVALUE_RATIO * sizes[-1]]).max(axis=1, initial=0.0) > MAX_NULL_SHARE
    edges = np.linspace(0, len(residuals), RESIDUAL_BLOCKS + 1).round().astype(int)
    sums = np.array([scaled[a:b].T @ residuals[a:b] for a, b in pairwise(edges)])
    prior_rows = scaled[len(residuals):]
    blocks = inverse @ (
        sums.T @ sums * RESIDUAL_BLOCKS / (RESIDUAL_BLOCKS - 1) + prior_rows.T @ prior_rows) @ inverse
    coloured = scaled[:len(residuals)] * np.sqrt(variances)[:, None]
    coloured = inverse @ (coloured.T @ coloured + prior_rows.T @ prior_rows) @ inverse
    inflation = np.sqrt(np.maximum(np.maximum(np.diag(blocks), np.diag(coloured)) / np.maximum(
        np.diag(inverse), 1e-300), 1.0))
    inverse[without_effect, without_effect] = np.inf  # a parameter without effect is not identifiable
    inflation[without_effect] = 1.0
    white = (inverse / np.outer(size, size))[:k, :k]
    return white * np.outer(inflation, inflation)[:k, :k], white


def _long_run_variances(readings: Sequence[Reading], residuals_by_run: Sequence[np.ndarray],
                        speeds: Sequence[np.ndarray]) -> tuple[float, ...]:
    """Of each run, of its moving part; 1 for counts, and no less than the accuracy of the simulation."""
    found = []
    for r, errors, speed in zip(readings, residuals_by_run, speeds, strict=True):
        moving = errors[speed[r.known] != 0.0]  # at rest a sensor may have another noise, or none
        floor = SIMULATION_ACCURACY * float(np.ptp(r.values[r.known]) / np.nanmedian(r.std))
        found.append(1.0 if r.count else max(
            _long_run_variance(moving), floor**2 * len(moving) / SPEED_GROUPS, 1e-300))
    return tuple(found)


def _long_run_variance(errors: np.ndarray) -> float:
    """Variance of a mean of the noise in residuals (m,), times their number, by medians of second differences.

    Second differences of the means of neighbouring parts leave little of a missing law, and medians ignore the
    place where a brake bites. Of what parts of one length miss by correlation over their ends, parts twice as long
    miss half.

    source  Vats and Flegal 2022, lugsail estimators; Hadamard variance, Baugh 1971
    """
    group = max(len(errors) // SPEED_GROUPS, 1)
    sums = np.concatenate([[0.0], np.cumsum(errors)])
    once, twice = (n * _second_difference_variance((sums[n:] - sums[:-n]) / n, n) for n in (group, 2 * group))
    return max(2.0 * twice - once, once)


def _second_difference_variance(values: np.ndarray, lag: int) -> float:
    """Variance of (n,) that are independent over a lag, robust; 0 where there are too few."""
    second = np.abs(values[2 * lag:] - 2.0 * values[lag:-lag] + values[:-2 * lag])
    return float(np.median(second)) ** 2 / (6.0 * MAD_PER_STD**2) if len(second) else 0.0
