"""The noise model of the innovations fit: sensor noise, and torque noise through the plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from drivetool.drive.simulation import Filtered, Trace
from drivetool.identify.noise.noise_scoring import NoiseLikelihood, likelihood_of_passes, minimise_by_scoring
from drivetool.identify.problem import Normal, Point, Problem

# Error of a filter that diverges: its square overflows, so that the likelihood becomes infinite
DIVERGED_ERROR = 1e200
# -log likelihood in place of infinity: parabolas subtract, and a difference of infinities is no number.
MAX_MINUS_LOG_LIKELIHOOD = 1e30
# Bounds of logarithms: of the ratio about the natural one, of other parameters about zero. A choice: at these ends
# (8 and 7 decades) the likelihood is flat, and exponentials are far from overflow.
MAX_LOG_RATIO, MAX_LOG_ODDS = 18.0, 16.0
# Decades of the ratio about the natural one over which it is searched. The spacing of 2/3 of a decade is below the
# width of a likelihood peak; a ratio of 1e-6 is indistinguishable from none.
RATIO_DECADES = np.linspace(-6.0, 2.0, 13)
MIN_RATIO_GAIN = 1.0  # log likelihood from which a distant ratio gets another fit: intervals hardly move for less
# Tolerance of the logarithm of a ratio: far below its standard deviation, a few per cent
LOG_RATIO_TOLERANCE = 2e-3
MAX_NOISE_SAMPLES = 16_000  # samples that give a noise ratio to a few per cent


@dataclass(frozen=True)
class Noise:
    """Torque noise relative to sensor noise.

    ratio   std of the torque noise per sample over the std of the first sensor
    memory  AR(1) pole: its correlation from sample to sample, of a problem over its `step`; None: white
    scale   (ny,) std of the sensors relative to the first
    others  std of a torque noise on each further body, over that of the first sensor: no model of the noise, but
            what keeps the filter's gains high on the way from a rough start
    slow    low-frequency share, with a memory: noise w, white from sample to sample, below one for what is slower
            than the memory, as in the residual of inexact flexible modes: d[k] = w[k] + z[k],
            z[k+1] = memory z[k] - (1 - slow) (1 - memory) w[k]. None: d[k+1] = memory d[k] + w[k]
    """

    ratio: float
    memory: float | None
    scale: np.ndarray
    others: float = 0.0
    slow: float | None = None

    @property
    def parameters(self) -> int:
        """Number of noise parameters without those of the sensors."""
        return len(self.figures)

    @property
    def figures(self) -> np.ndarray:
        """Logarithms of the ratio, of the odds of the AR(1) pole and of the low-frequency share, where present."""
        odds = [] if self.memory is None else [np.log(self.memory / (1.0 - self.memory))]
        return np.array([np.log(self.ratio), *odds, *([] if self.slow is None else [np.log(self.slow)])])

    def at(self, figures: np.ndarray) -> Noise:
        """The noise with other log parameters; the logarithms of the further sensors' scales may follow them."""
        further = np.exp(figures[self.parameters:])
        return replace(
            self, ratio=float(np.exp(figures[0])),
            memory=None if self.memory is None else float(1.0 / (1.0 + np.exp(-figures[1]))),
            slow=None if self.slow is None else float(np.exp(figures[2])),
            scale=np.concatenate((self.scale[:1], further)) if len(further) else self.scale)

    def over(self, steps: float) -> Noise:
        """The noise at a sampling interval that is so many times as long: its correlation time stays."""
        return self if self.memory is None or steps == 1.0 else replace(self, memory=self.memory**steps)

    def bounds(self, middle: float) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of `figures`; those of the ratio are about the logarithm of the natural one.

        A low-frequency share above one, white noise plus drifting noise, would take friction for noise.
        """
        high = np.array([middle + MAX_LOG_RATIO, MAX_LOG_ODDS, 0.0][:self.parameters])
        return np.array([middle - MAX_LOG_RATIO, -MAX_LOG_ODDS, -MAX_LOG_ODDS][:self.parameters]), high


def filtered(problem: Problem, point: Point, noise: Noise, keep: bool = True) -> list[Filtered]:
    """One Kalman pass per trace at a point. The start states are parameters, hence known here."""
    passes = []
    problem = problem.with_memory(noise.memory)
    for t, start, plant in zip(problem.traces, point.starts, problem.plants(point.values, False),
                               strict=True):
        nx, here = plant.nx, noise.over(problem.steps(t))
        extra, noise_input, covariance, white = np.zeros(nx), np.zeros(nx), np.zeros((nx, nx)), here.ratio**2
        further = slice(1, problem.bodies)
        extra[further] = (here.others * t.step / plant.system.mass[further, 0]) ** 2
        if here.memory is not None:
            start = np.append(start, 0.0) if len(start) < nx else start
            if here.slow is None:
                extra[-1] = white * (1.0 - here.memory**2)
                covariance[-1, -1], white = white, 0.0
            else:
                noise_input[-1] = (here.slow - 1.0) * (1.0 - here.memory)
                covariance[-1, -1] = white * noise_input[-1] ** 2 / (1.0 - here.memory**2)
        # Whether noise breaks stiction depends on its size.
        unit = problem.sensor_std**2
        found = plant.filter(t, start, unit * here.scale**2, unit * white, unit * extra, unit * covariance, keep,
                             noise_input)
        gains = replace(found.gains, weight=found.gains.weight * problem.sensor_std)
        passes.append(_with_divergence_marked(replace(found, gains=gains, variance=found.variance / unit), t))
    if problem.counts is None:
        return passes
    return [_with_counted_errors(f, mask) for f, mask in zip(passes, problem.counts, strict=True)]


def _with_counted_errors(found: Filtered, mask: np.ndarray) -> Filtered:
    """The pass with the errors of the counted samples only."""
    weight = np.where(mask[:, None], found.gains.weight, 0.0)
    innovations = np.where(mask[:, None], found.innovations, np.nan)
    return replace(found, innovations=innovations, gains=replace(found.gains, weight=weight))


def with_torque_noise(trace: Trace, noise: Noise, sensor_std: float, rng: np.random.Generator) -> Trace:
    """The trace with torque noise on its first input, held over each sample as in `filtered`.

    The noise is stationary from the first sample on. It enters with the command, through the converter, whereas the
    filter lets noise with a memory act behind the converter. The two differ above the bandwidth only.

    sensor_std  of the first sensor
    """
    white, m = rng.standard_normal(trace.size), noise.memory
    if m is None:
        drawn = white
    elif noise.slow is None:  # d[k+1] = m d[k] + sqrt(1 - m^2) w[k], of variance one
        drawn, _ = scipy.signal.lfilter([np.sqrt(1.0 - m**2)], [1.0, -m], white, zi=[m * rng.standard_normal()])
    else:  # w[k] + z[k]; the root is the std of z in the steady state
        loss = 1.0 - noise.slow
        initial_state = loss * np.sqrt((1.0 - m) / (1.0 + m)) * rng.standard_normal()
        drawn, _ = scipy.signal.lfilter([1.0, -m - loss * (1.0 - m)], [1.0, -m], white, zi=[initial_state])
    inputs = trace.inputs.copy()
    inputs[:, 0] += noise.ratio * sensor_std * drawn
    return replace(trace, inputs=inputs)


def _with_divergence_marked(found: Filtered, trace: Trace) -> Filtered:
    """The pass, with huge errors where it diverges: NaN would count as not measured, and cost nothing."""
    lost = np.isfinite(trace.outputs) & ~np.isfinite(found.innovations)
    return replace(found, innovations=np.where(lost, DIVERGED_ERROR, found.innovations)) if lost.any() else found


def minus_log_likelihood(passes: Sequence[Filtered]) -> float:
    """Gaussian, up to a constant, with the sensor variance profiled out; infinite where a filter diverges."""
    squares, logs, count = 0.0, 0.0, 0
    for f in passes:
        known = np.isfinite(f.innovations)
        with np.errstate(over="ignore", invalid="ignore"):
            squares += float(np.sum(f.innovations[known] ** 2 / f.variance[known]))
            logs += float(np.sum(np.log(f.variance[known])))
        count += int(known.sum())
    if not np.isfinite(squares) or squares <= 0.0:
        return np.inf
    return 0.5 * count * np.log(squares / count) + 0.5 * logs


def minus_log_likelihood_at(problem: Problem, point: Point, noise: Noise) -> float:
    """The same of a point under a noise model."""
    return minus_log_likelihood(filtered(problem, point, noise, keep=False))


def restricted_likelihood(problem: Problem, point: Point, noise: Noise,
               passes: Sequence[Filtered] | None = None) -> tuple[float, Normal]:
    """(restricted -log likelihood of a noise model, up to a constant; normal equations at the point under it).

    The plain likelihood ignores that the fitted parameters absorb part of the noise. Slow torque noise looks like
    friction, its ratio becomes near zero, and the intervals become half as wide as they should be. Here the
    parameters and start states are integrated out (Patterson and Thompson 1971), around the point after one
    Gauss-Newton step.

    passes  under the noise, with their gains, where available
    """
    passes = passes or filtered(problem, point, noise)
    logs = sum(float(np.sum(np.log(f.variance[np.isfinite(f.innovations)]))) for f in passes)
    normal = filtered_normal_equations(problem, point, noise, passes)
    matrix, slope = dense_normal_equations(normal)
    size = np.sqrt(np.diag(matrix))
    keep = size > 0.0
    size, slope = size[keep], slope[keep]
    scaled = matrix[np.ix_(keep, keep)] / np.outer(size, size) + 1e-12 * np.eye(len(size))
    residual = normal.cost - float(slope / size @ np.linalg.solve(scaled, slope / size))
    degrees = problem.count - len(size)
    if not np.isfinite(residual) or residual <= 0.0 or degrees <= 0:
        return np.inf, normal
    determinant = np.linalg.slogdet(scaled)[1] + 2.0 * float(np.sum(np.log(size)))
    return 0.5 * (degrees * np.log(residual / degrees) + logs + determinant), normal


def filtered_normal_equations(problem: Problem, point: Point, noise: Noise,
                              passes: Sequence[Filtered] | None = None) -> Normal:
    """Normal equations of the one-step prediction errors at a point, under the gains of a noise model.

    passes  under the noise, with their gains, where available
    """
    gains = [f.gains for f in passes or filtered(problem, point, noise)]
    return problem.with_memory(noise.memory).normal(with_disturbance_state(point, noise), gains)


def dense_normal_equations(normal: Normal) -> tuple[np.ndarray, np.ndarray]:
    """The block-arrow equations as one matrix and one gradient."""
    k, sizes = len(normal.slope), [len(s) for s in normal.own_slope]
    edges = k + np.concatenate(([0], np.cumsum(sizes))).astype(int)
    matrix = np.zeros((edges[-1], edges[-1]))
    matrix[:k, :k] = normal.shared
    for a, b, cross, own in zip(edges[:-1], edges[1:], normal.cross, normal.own, strict=True):
        matrix[:k, a:b], matrix[a:b, :k], matrix[a:b, a:b] = cross, cross.T, own
    return matrix, np.concatenate([normal.slope, *normal.own_slope])


def with_disturbance_state(point: Point, noise: Noise) -> Point:
    """Append the disturbance state, zero at the start, where the noise has a memory."""
    if noise.memory is None:
        return point
    return Point(point.values, tuple(np.append(s, 0.0) for s in point.starts))


def unit_noise_ratio(problem: Problem, point: Point) -> float:
    """The ratio at which one sample of torque noise moves the first output by its sensor noise."""
    plant = problem.with_memory(None).plants(point.values, False)[0]
    t = problem.traces[0]
    h, s = t.step, plant.system
    a, b = s.rows[:, :s.nx, 0] / s.mass[:, :1], s.rows[:, s.nx, 0] / s.mass[:, 0]
    row, gain, factor = s.outputs[0, :, 0], 0.0, h
    for k in range(6):
        gain = abs(row @ b) * factor
        if gain > 0.0:
            break
        b, factor = a @ b, factor * h / (k + 2)
    return 1.0 / gain if gain > 0.0 else 1.0


def first_samples_of(problem: Problem, max_samples: int = MAX_NOISE_SAMPLES) -> Problem:
    """The problem on the first samples of its traces, enough for two noise parameters."""
    total = sum(t.size for t in problem.traces)
    if total <= max_samples:
        return problem
    keep = [max(10, t.size * max_samples // total) for t in problem.traces]
    counts = None if problem.counts is None else tuple(m[:n] for m, n in zip(problem.counts, keep, strict=True))
    return replace(problem, counts=counts, traces=tuple(
        replace(t, inputs=t.inputs[:n], outputs=t.outputs[:n]) for t, n in zip(problem.traces, keep, strict=True)))


def fit_ratio(problem: Problem, point: Point, noise: Noise, around: float | None = None,
              converged: bool = False, quick: bool = False) -> Noise:
    """Maximum likelihood of the noise ratio (AR(1) pole, low-frequency share) at fixed parameters.

    around   a ratio to search near; None: over eight decades, or from the noise where it has a memory
    settled  whether the point is near its optimum: then by restricted likelihood
    quick    to half a decade only, without a ratio to search near
    """
    middle = np.log(unit_noise_ratio(problem, point))
    problem = first_samples_of(problem)

    def evaluate(log_parameters: np.ndarray) -> NoiseLikelihood:
        return _evaluate_likelihood(problem, point, noise.at(log_parameters), converged)

    if noise.memory is None and around is None:
        grid = middle + np.log(10.0) * RATIO_DECADES
        best = minimise_by_parabolas(lambda g: min(evaluate(np.array([g])).value, MAX_MINUS_LOG_LIKELIHOOD), grid,
                                     0 if quick else 4)
        return noise.at(np.array([best]))
    return noise.at(minimise_by_scoring(evaluate,
                                        (noise if around is None else replace(noise, ratio=around)).figures,
                                        *noise.bounds(middle))[0])


def likelier_ratio(problem: Problem, point: Point, noise: Noise) -> Noise | None:
    """The noise with a clearly likelier ratio far from its own, all else unchanged; None where there is none.

    The restricted likelihood of a ratio may have several peaks, and a local search finds only its own.
    """
    middle = np.log(unit_noise_ratio(problem, point))
    problem = first_samples_of(problem)

    def value(log: float) -> float:
        return min(_evaluate_likelihood(
            problem, point, replace(noise, ratio=float(np.exp(log))), converged=True).value,
                   MAX_MINUS_LOG_LIKELIHOOD)

    threshold = value(np.log(noise.ratio)) - MIN_RATIO_GAIN
    grid = list(middle + np.log(10.0) * RATIO_DECADES)
    values = [value(log) for log in grid]
    if not min(values) < threshold:
        return None
    return replace(noise, ratio=float(np.exp(_refined_by_parabolas(value, grid, values, 4, LOG_RATIO_TOLERANCE))))


def _evaluate_likelihood(problem: Problem, point: Point, noise: Noise, converged: bool) -> NoiseLikelihood:
    """The likelihood of a noise on the traces; the restricted one where the point is converged."""
    with np.errstate(over="ignore", invalid="ignore"):
        passes = filtered(problem, point, noise, keep=converged)
        value = restricted_likelihood(problem, point, noise,
                                      passes)[0] if converged else minus_log_likelihood(passes)
    return likelihood_of_passes(value if np.isfinite(value) else np.inf, passes)


def fit_correlated_noise(problem: Problem, point: Point, noise: Noise, value: Callable[[Noise], float]) -> Noise:
    """The likeliest noise with a memory: torque that drifts, fast or slowly, or is weak at low frequency.

    value  -log likelihood of a noise at the point
    """
    starts = [Noise(noise.ratio, float(np.exp(-1.0 / samples)), noise.scale, slow=slow)
             for samples, slow in ((20.0, None), (500.0, None), (4.0, 0.3))]
    return min((fit_ratio(problem, point, n) for n in starts), key=lambda n: value(n) + n.parameters)


def minimise_by_parabolas(value: Callable[[float], float], grid: np.ndarray, rounds: int = 4,
                 tolerance: float = LOG_RATIO_TOLERANCE) -> float:
    """Minimum of a function of one variable: grid, then parabolas through the best three until they converge."""
    return _refined_by_parabolas(value, list(grid), [value(g) for g in grid], rounds, tolerance)


def _refined_by_parabolas(value: Callable[[float], float], x: list[float], y: list[float], rounds: int,
                          tolerance: float) -> float:
    """Parabolas through the best three of some points until they converge."""
    for _ in range(rounds):
        order = np.argsort(x)
        x, y = [x[i] for i in order], [y[i] for i in order]
        i = int(np.argmin(y))
        if i in (0, len(x) - 1):
            break
        (a, b, c), (fa, fb, fc) = x[i - 1:i + 2], y[i - 1:i + 2]
        curve = (b - a) * (fb - fc) - (b - c) * (fb - fa)
        if not np.isfinite(curve) or curve == 0.0:
            break
        t = b - 0.5 * ((b - a) ** 2 * (fb - fc) - (b - c) ** 2 * (fb - fa)) / curve
        if not a < t < c or min(abs(t - k) for k in x) < tolerance:
            break
        x.append(t)
        y.append(value(t))
    return x[int(np.argmin(y))]
