"""Prediction-error fits: start values, descent, covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from drivetool.errors import NotEnoughData
from drivetool.identify.polynomial.pem_model import Prediction, Stretch, Structure, _delayed_columns
from drivetool.identify.polynomial.pem_restricted import restricted_shift
from drivetool.identify.problem import MIN_SPARE_SAMPLES, Point, Solution, nonzero_scale, solve

MAX_DESCENT_ITERATIONS = 100  # iterations of a descent, a choice that bounds the time
MAX_INSTRUMENTAL_ROUNDS = 8  # of the instrumental-variable start, at most, a choice that bounds the time
INSTRUMENTAL_TOLERANCE = 1e-4  # relative change of its cost at which it has converged: a start needs no more digits
# Newton steps of the restricted likelihood, each with the gradient at the end of the one before; a choice.
RESTRICTED_STEPS = 2
# Poles of the start's filter over the sampling rate, a choice: slow, medium, fast dynamics.
START_FILTER_RATES = (0.02, 0.1, 0.5)


@dataclass(frozen=True)
class PemFit:
    """A fitted polynomial model.

    problem, solution  as fitted; covariance (k, k) of the coefficients
    colour   autocorrelation of the errors at lag one over its 95 % limit
    white    whether the errors pass as white noise (Ljung-Box, p > 0.001)
    sigma    std of the errors
    """

    problem: Prediction
    solution: Solution
    covariance: np.ndarray
    white: bool
    whiteness_p: float
    sigma: float

    @property
    def structure(self) -> Structure:
        """Of the model."""
        return self.problem.structure

    @property
    def values(self) -> np.ndarray:
        """The coefficients."""
        return self.solution.point.values


def fit_structure(stretches: Sequence[Stretch], structure: Structure) -> PemFit:
    """The structure fitted to all stretches together.

    stretches  torque and output; means may be anything
    returns    PemFit; `structure_findings` assesses it
    raises     NotEnoughData: fewer samples than unknowns and 20 more in a stretch
    source     Ljung 1999, sec. 7.2 (predictors), 10.2 (gradients), 9.4 (covariance where the errors are not
               white); start: Young 2011, refined instrumental variables
    """
    structure = replace(structure, rate=1.0)
    least = 2 * structure.order + structure.noise_parameters + 1 + MIN_SPARE_SAMPLES
    stretches = tuple(replace(s, u=s.u - s.u.mean(), y=s.y - s.y.mean()) for s in stretches if len(s.y) >= least)
    if not stretches:
        raise NotEnoughData(f"a stretch of at least {least} samples for order {structure.order}",
                            "shorter ones only", "Record longer, or lower --order.")
    starts = sorted((_instrumental_start(stretches, structure, rate)
                     for rate in START_FILTER_RATES), key=lambda s: s[0])
    oe = [_fit_from(stretches, replace(structure, kind="oe", rate=rate), values)
          for cost, rate, values in starts[:2] if np.isfinite(cost)]
    if not oe:
        raise NotEnoughData("a record on which a fit of this order converges", "none that converged",
                            "Excite more, or lower --order.")
    problem, solution = min(oe, key=lambda found: found[1].cost)
    if structure.kind != "oe":
        problem, solution = _fit_with_noise_model(problem, solution, structure)
    return _with_restricted_noise(_with_covariance(problem, solution))


def _with_restricted_noise(fit: PemFit) -> PemFit:
    """The fit with its noise by restricted likelihood, and all other coefficients along with it."""
    likeliest, problem = fit.values, fit.problem
    held = replace(problem, held=np.ones(len(problem.names), bool))
    for _ in range(RESTRICTED_STEPS if problem.structure.noise_parameters else 0):
        with np.errstate(all="ignore"):
            shift = restricted_shift(problem, fit.solution.point, fit.covariance)
        point = Point(likeliest + shift, fit.solution.point.starts)
        if not np.any(shift) or not np.isfinite(problem.cost(point)):
            break
        point = solve(held, point, max_iterations=5, damping=1e-9).point
        fit = _with_covariance(problem, replace(fit.solution, point=point, normal=problem.normal(point)))
    return fit


def _fit_from(stretches: tuple[Stretch, ...], structure: Structure, values: np.ndarray,
              starts: tuple[np.ndarray, ...] | None = None,
              max_iterations: int = MAX_DESCENT_ITERATIONS) -> tuple[Prediction, Solution]:
    """Levenberg-Marquardt from coefficients; the start states first."""
    k = len(structure.names)
    size = np.full(k, 0.5)
    b = structure.part("B")
    size[b] = 0.5 * max(np.abs(values[b]).max(), 1e-12)
    if structure.kind == "arx":
        size[:] = np.inf  # linear: the first step may go anywhere
    problem = Prediction(structure, stretches, size)
    point = Point(values, starts or problem.zeros())
    if starts is None:
        point = solve(replace(problem, held=np.ones(k, bool)), point, max_iterations=5, damping=1e-9).point
    return problem, solve(problem, point, max_iterations=max_iterations, relative=1e-9)


def _fit_with_noise_model(problem: Prediction, solution: Solution,
                          structure: Structure) -> tuple[Prediction, Solution]:
    """From an output-error model to a structure that models the noise as well.

    bj starts with the residual noise; armax and innovations with C = F, which is equivalent to the
    output-error model; arx is linear and needs no start but the poles' rate.
    """
    rate, old = problem.structure.rate, problem.structure
    structure = replace(structure, rate=rate)
    values = np.zeros(len(structure.names))
    values[structure.part("B")] = solution.point.values[old.part("B")]
    poles = solution.point.values[old.part("F")]
    if structure.kind == "bj":
        values[structure.part("F")] = poles
        residual = np.concatenate([problem.errors(solution.point.values, s, d)
                                   for s, d in zip(solution.point.starts, problem.stretches, strict=True)])
        ar = yule_walker(residual, structure.noise)
        values[structure.part("D")] = ar
        return _fit_from(problem.stretches, structure, values, solution.point.starts)
    values[structure.part("A")] = poles
    trials = [np.zeros(structure.size("C"))]
    if structure.kind == "innovations":
        base, table = structure.basis("C")
        # Poles of the predictor, from output error towards dead beat; and those fitted to the start's errors.
        firsts = [np.poly(pull * _stable(np.roots(structure.polynomial("A", values)))) for pull in (1.0, 0.9, 0.7,
            0.3)]
        trials = [np.linalg.lstsq(table, c.real - base, rcond=None)[0]
                  for c in (*firsts, _moving_average(problem, solution))]
    found, trial_iterations = [], 12 if len(trials) > 1 else MAX_DESCENT_ITERATIONS
    for trial in trials:
        values = values.copy()
        values[structure.part("C")] = trial
        found.append(_fit_from(problem.stretches, structure, values, solution.point.starts, trial_iterations))
    found.sort(key=lambda f: f[1].cost)
    ends = [(p, s if s.converged or trial_iterations == MAX_DESCENT_ITERATIONS
             else solve(p, s.point, max_iterations=MAX_DESCENT_ITERATIONS, relative=1e-9))
            for p, s in found[:2]]
    return min(ends, key=lambda f: f[1].cost)


def _moving_average(problem: Prediction, solution: Solution) -> np.ndarray:
    """(order + 1,) C of C e = F times the output errors, by a long autoregression and a regression.

    source  Hannan and Rissanen 1982
    """
    values, n = solution.point.values, problem.structure.order
    plant = problem.structure.polynomial("F", values)
    now, past = [], []
    for start, stretch in zip(solution.point.starts, problem.stretches, strict=True):
        v = scipy.signal.lfilter(plant, [1.0], problem.errors(values, start, stretch))[n:]
        e = scipy.signal.lfilter(np.concatenate([[1.0], yule_walker(v, min(60, len(v) // 10))]), [1.0], v)
        now.append((v - e)[n:])
        past.append(np.column_stack([e[n - j: len(e) - j] for j in range(1, n + 1)]))
    c = np.linalg.lstsq(np.concatenate(past), np.concatenate(now), rcond=None)[0]
    return np.poly(_stable(np.roots(np.concatenate([[1.0], c]))))


def _stable(roots: np.ndarray) -> np.ndarray:
    """Roots reflected into the unit circle, with a margin to its edge."""
    size = np.abs(roots)
    outside = size >= 1.0
    roots = np.where(outside, 1.0 / np.conj(np.where(outside, roots, 1.0)), roots)
    return roots * np.minimum(1.0, 0.9999 / np.maximum(np.abs(roots), 1e-12))


def _instrumental_start(stretches: Sequence[Stretch], structure: Structure, rate: float,
                       ) -> tuple[float, float, np.ndarray]:
    """(simulation cost, rate, output-error coefficients) by refined instrumental variables.

    All signals pass 1/F of the round before; the instruments are the simulated output.
    """
    s = replace(structure, kind="oe", rate=rate)
    f, b = s.part("F"), s.part("B")
    values = np.zeros(len(s.names))
    # F = ((q - 1)/rate + 1)^n: all poles at the rate, which is a state-variable filter.
    values[f] = np.poly(-np.ones(s.order))[1:]
    best = (np.inf, rate, values)
    for turn in range(MAX_INSTRUMENTAL_ROUNDS):
        try:
            values, cost = _instrumental_round(stretches, s, values, f, b, turn)
        except (np.linalg.LinAlgError, FloatingPointError):
            break
        converged = turn > 1 and abs(cost - best[0]) < INSTRUMENTAL_TOLERANCE * best[0]
        if cost < 0.999999 * best[0]:
            best = (cost, rate, values)
        if converged:
            break
    return best


def _instrumental_round(stretches, s: Structure, values: np.ndarray, f: slice, b: slice, turn: int):
    """One regression under the filter of the last one, and the cost of its simulation."""
    bottom = s.polynomial("F", values)
    bottom = np.poly(_stable(np.roots(bottom)))
    (base, tf), (_, tb) = s.basis("F"), s.basis("B")
    problem = Prediction(s, tuple(stretches), np.ones(len(s.names)))
    lhs, rhs = 0.0, 0.0
    tails = []
    for d in stretches:
        y, u = scipy.signal.lfilter([1.0], bottom, d.y), scipy.signal.lfilter([1.0], bottom, d.u)
        one = scipy.signal.lfilter([1.0], bottom, np.ones(len(u)))
        ys = _delayed_columns(y, s.order + 1)
        phi = np.hstack([-ys @ tf, _delayed_columns(u, len(tb)) @ tb])
        tail = np.column_stack([
            one, _delayed_columns(scipy.signal.lfilter([1.0], bottom, np.eye(1, len(u))[0]), s.order)])
        tail = tail / np.maximum(np.linalg.norm(tail, axis=0), 1e-300)
        z = phi
        if turn:
            x = scipy.signal.lfilter(s.polynomial("B", values), bottom, d.u)
            z = np.hstack([-_delayed_columns(scipy.signal.lfilter([1.0], bottom, x), s.order + 1) @ tf,
                           phi[:, s.order:]])
        q, _ = np.linalg.qr(tail)
        target = ys @ base
        phi, target = phi - q @ (q.T @ phi), target - q @ (q.T @ target)
        lhs, rhs = lhs + z.T @ phi, rhs + z.T @ target
        tails.append(q)
    size = nonzero_scale(np.sqrt(np.abs(np.diag(lhs))))
    found = np.linalg.lstsq(lhs / np.outer(size, size), rhs / size, rcond=1e-14)[0] / size
    values = np.zeros_like(values)
    values[f], values[b] = found[: s.order], found[s.order:]
    point = Point(values, problem.zeros())
    k = len(values)
    with np.errstate(all="ignore"):
        if not np.isfinite(problem.cost(point)):
            raise np.linalg.LinAlgError
        done = solve(replace(problem, held=np.ones(k, bool)), point, max_iterations=3, damping=1e-9)
    return values, done.cost


def yule_walker(x: np.ndarray, order: int) -> np.ndarray:
    """(order,) coefficients of an autoregression, the leading one left out; always stable."""
    if not order:
        return np.empty(0)
    x = x - x.mean()
    r = np.array([x[: len(x) - k] @ x[k:] for k in range(order + 1)]) / len(x)
    r[0] = r[0] * (1.0 + 1e-9) + 1e-300
    return -np.linalg.solve(scipy.linalg.toeplitz(r[:-1]), r[1:])


def _with_covariance(problem: Prediction, solution: Solution) -> PemFit:
    """Covariance and whiteness at the end of a fit.

    Where the errors are not white, an output-error model is still unbiased in open loop, but the inverse
    of its information is no covariance: the colour of the errors enters it.
    """
    point, k = solution.point, len(problem.names)
    errors, derivatives = zip(*(problem.jacobian(point.values, s, d)
                                for s, d in zip(point.starts, problem.stretches, strict=True)), strict=True)
    e = np.concatenate(errors)
    degrees = max(problem.count - problem.unknowns, 1)
    variance = float(e @ e) / degrees
    lags = min(25, len(e) // 5)
    r = np.array([sum(x[: len(x) - j] @ x[j:] for x in errors) for j in range(1, lags + 1)])
    r /= max(float(e @ e), 1e-300)  # zero where the model repeats the output to the last digit
    statistic = len(e) * float(np.sum(r**2))
    p = float(scipy.stats.chi2.sf(statistic, max(lags - problem.structure.noise_parameters, 1)))
    white = p > 1e-3
    ar, whitened_variance = (np.ones(1), variance) if white else _whitener(problem, point.values, errors, degrees)
    total, inner = np.zeros((k, k)), np.zeros((k, k))
    for j in derivatives:
        # The part of the start values is taken out of the derivatives: they belong to one stretch each.
        tail = j[:, k:]
        q, _ = np.linalg.qr(tail / np.maximum(np.linalg.norm(tail, axis=0), 1e-300))
        j = j[:, :k] - q @ (q.T @ j[:, :k])
        total += j.T @ j
        if not white:
            # Sum over t of j(t) v(t) with v = e/ar is the sum over s of e(s) times j filtered backwards.
            j = scipy.signal.lfilter([1.0], ar, j[::-1], axis=0)
            inner += j.T @ j
    size = np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.pinv(total / np.outer(size, size), rcond=1e-15, hermitian=True) / np.outer(size, size)
    covariance = variance * inverse if white else whitened_variance * inverse @ inner @ inverse
    return PemFit(problem, solution, covariance, white, p, float(np.sqrt(variance)))


def _whitener(problem: Prediction, values: np.ndarray, errors: Sequence[np.ndarray], degrees: int,
              ) -> tuple[np.ndarray, float]:
    """(polynomial that makes the errors white, variance behind it).

    An autoregression; or one after the plant's own poles. Torque noise through the plant has these poles, and
    they are too slow for an autoregression of a few lags.
    """
    s = problem.structure
    plant = np.poly(_stable(np.roots(s.polynomial(s.dynamics, values)))).real
    trials = []
    for first in (np.ones(1), plant):
        bare = [scipy.signal.lfilter(first, [1.0], x)[len(first) - 1:] for x in errors]
        ar = np.concatenate([[1.0], yule_walker(np.concatenate(bare), min(40, problem.count // 20))])
        variance = sum(float(np.sum(scipy.signal.lfilter(ar, [1.0], x)[len(ar):] ** 2)) for x in bare)
        trials.append((variance / degrees, np.convolve(first, ar)))
    whitened_variance, polynomial = min(trials, key=lambda t: t[0])
    return polynomial, whitened_variance
