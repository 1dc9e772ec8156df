"""The noise model of the innovations fit: sensor noise, and torque noise through the plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from drivetool.drive.simulation import Filtered, Trace
from drivetool.identify.noise.noise_scoring import Heard, heard, scored
from drivetool.identify.problem import Normal, Point, Problem

ENDLESS = 1e200  # error of a filter that ran away: its square is no number
FAR = 1e30  # likelihood of what cannot be; finite, since parabolas subtract
WIDEST, ODDS = 18.0, 16.0  # logarithms: of the ratio about the natural one, of other figures about one
DECADES = np.linspace(-6.0, 2.0, 13)  # of the ratio about the natural one, over which it is looked for
LIKELIER = 1.0  # log likelihood from which a ratio far off is worth another fit: intervals hardly move for less
CLOSE = 2e-3  # of the logarithm of a ratio
ENOUGH = 16_000  # samples that give a noise ratio to a few per cent


@dataclass(frozen=True)
class Noise:
    """Torque noise relative to sensor noise.

    ratio   std of the torque noise per sample over the std of the first sensor
    memory  its correlation from sample to sample, of a problem over its `step`; None: white
    scale   (ny,) std of the sensors relative to the first
    others  std of a torque noise on each further body, over that of the first sensor: no belief,
            but what keeps the filter listening on the way from a rough start
    slow    with a memory: white noise w from sample to sample, of which what is slower than the memory has this
            share, below one, as what inexact flexible modes leave over has: d[k] = w[k] + z[k],
            z[k+1] = memory z[k] - (1 - slow) (1 - memory) w[k]. None: d[k+1] = memory d[k] + w[k]
    """

    ratio: float
    memory: float | None
    scale: np.ndarray
    others: float = 0.0
    slow: float | None = None

    @property
    def parameters(self) -> int:
        """How many there are without the sensors'."""
        return len(self.figures)

    @property
    def figures(self) -> np.ndarray:
        """Logarithms of the ratio, of the odds of the memory and of the slow share, as far as there are any."""
        odds = [] if self.memory is None else [np.log(self.memory / (1.0 - self.memory))]
        return np.array([np.log(self.ratio), *odds, *([] if self.slow is None else [np.log(self.slow)])])

    def at(self, figures: np.ndarray) -> Noise:
        """The noise with other figures; behind its own the logarithms of the further sensors' may follow."""
        further = np.exp(figures[self.parameters:])
        return replace(
            self, ratio=float(np.exp(figures[0])),
            memory=None if self.memory is None else float(1.0 / (1.0 + np.exp(-figures[1]))),
            slow=None if self.slow is None else float(np.exp(figures[2])),
            scale=np.concatenate((self.scale[:1], further)) if len(further) else self.scale)

    def over(self, steps: float) -> Noise:
        """The noise at a sampling interval that is so many times as long: it remembers for as long a time."""
        return self if self.memory is None or steps == 1.0 else replace(self, memory=self.memory**steps)

    def bounds(self, middle: float) -> tuple[np.ndarray, np.ndarray]:
        """Of `figures`, the ratio's about the logarithm of the natural one.

        A slow share above one, white noise beside noise that wanders, would take friction for noise.
        """
        high = np.array([middle + WIDEST, ODDS, 0.0][:self.parameters])
        return np.array([middle - WIDEST, -ODDS, -ODDS][:self.parameters]), high


def filtered(problem: Problem, point: Point, noise: Noise, keep: bool = True) -> list[Filtered]:
    """One Kalman pass per trace at a point. The start states are parameters, hence known here."""
    passes = []
    problem = problem.with_memory(noise.memory)
    one = noise
    for t, start, plant in zip(problem.traces, point.starts, problem.plants(point.values, False),
                               strict=True):
        nx, noise = plant.nx, one.over(problem.steps(t))
        extra, kick, covariance, white = np.zeros(nx), np.zeros(nx), np.zeros((nx, nx)), noise.ratio**2
        further = slice(1, problem.bodies)
        extra[further] = (noise.others * t.step / plant.system.mass[further, 0]) ** 2
        if noise.memory is not None:
            start = np.append(start, 0.0) if len(start) < nx else start
            if noise.slow is None:
                extra[-1] = white * (1.0 - noise.memory**2)
                covariance[-1, -1], white = white, 0.0
            else:
                kick[-1] = (noise.slow - 1.0) * (1.0 - noise.memory)
                covariance[-1, -1] = white * kick[-1] ** 2 / (1.0 - noise.memory**2)
        # Whether noise breaks loose what sticks depends on its size.
        unit = problem.sensor_std**2
        found = plant.filter(t, start, unit * noise.scale**2, unit * white, unit * extra, unit * covariance, keep,
                             kick)
        gains = replace(found.gains, weight=found.gains.weight * problem.sensor_std)
        passes.append(_told(replace(found, gains=gains, variance=found.variance / unit), t))
    if problem.counts is None:
        return passes
    return [_counted(f, mask) for f, mask in zip(passes, problem.counts, strict=True)]


def _counted(found: Filtered, mask: np.ndarray) -> Filtered:
    """The pass with the errors of the samples that count alone."""
    weight = np.where(mask[:, None], found.gains.weight, 0.0)
    innovations = np.where(mask[:, None], found.innovations, np.nan)
    return replace(found, innovations=innovations, gains=replace(found.gains, weight=weight))


def with_torque_noise(trace: Trace, noise: Noise, sensor_std: float, rng: np.random.Generator) -> Trace:
    """The trace with torque noise on its first input, each sample's held as `filtered` has it.

    The noise was there before the record: it begins as it goes on, with the variance of the steady state. It enters
    with the command, through the converter, where the filter lets what has a memory act behind it: the two differ
    above the bandwidth only.

    sensor_std  of the first sensor
    """
    white, m = rng.standard_normal(trace.size), noise.memory
    if m is None:
        drawn = white
    elif noise.slow is None:  # d[k+1] = m d[k] + sqrt(1 - m^2) w[k], of variance one
        drawn, _ = lfilter([np.sqrt(1.0 - m**2)], [1.0, -m], white, zi=[m * rng.standard_normal()])
    else:  # w[k] + z[k]; the root is the std of z in the steady state
        loss = 1.0 - noise.slow
        begun = loss * np.sqrt((1.0 - m) / (1.0 + m)) * rng.standard_normal()
        drawn, _ = lfilter([1.0, -m - loss * (1.0 - m)], [1.0, -m], white, zi=[begun])
    inputs = trace.inputs.copy()
    inputs[:, 0] += noise.ratio * sensor_std * drawn
    return replace(trace, inputs=inputs)


def _told(found: Filtered, trace: Trace) -> Filtered:
    """The pass, with endless errors where it ran away: what is no number was not measured, and costs nothing."""
    lost = np.isfinite(trace.outputs) & ~np.isfinite(found.innovations)
    return replace(found, innovations=np.where(lost, ENDLESS, found.innovations)) if lost.any() else found


def minus_log_likelihood(passes: Sequence[Filtered]) -> float:
    """Gaussian, up to a constant, with the sensor variance profiled out; infinite where a filter ran away."""
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


def integrated(problem: Problem, point: Point, noise: Noise,
               passes: Sequence[Filtered] | None = None) -> tuple[float, Normal]:
    """(restricted -log likelihood of a noise model, up to a constant; normal equations at the point under it).

    The plain likelihood counts residuals that the fitted parameters have already absorbed: slow
    torque noise looks like friction, its ratio comes out near zero, and the intervals are then
    half as wide as they should be. Here the parameters and start states are integrated out
    (Patterson and Thompson 1971), around the point after one Gauss-Newton step.

    passes  under the noise, with their gains, if they have been made
    """
    passes = passes or filtered(problem, point, noise)
    logs = sum(float(np.sum(np.log(f.variance[np.isfinite(f.innovations)]))) for f in passes)
    normal = _normal(problem, point, noise, passes)
    matrix, slope = arrow(normal)
    size = np.sqrt(np.diag(matrix))
    keep = size > 0.0
    size, slope = size[keep], slope[keep]
    scaled = matrix[np.ix_(keep, keep)] / np.outer(size, size) + 1e-12 * np.eye(len(size))
    left = normal.cost - float(slope / size @ np.linalg.solve(scaled, slope / size))
    degrees = problem.count - len(size)
    if not np.isfinite(left) or left <= 0.0 or degrees <= 0:
        return np.inf, normal
    determinant = np.linalg.slogdet(scaled)[1] + 2.0 * float(np.sum(np.log(size)))
    return 0.5 * (degrees * np.log(left / degrees) + logs + determinant), normal


def normal_under(problem: Problem, point: Point, noise: Noise) -> Normal:
    """Normal equations of the one-step errors at a point, under the gains of a noise model."""
    return _normal(problem, point, noise, filtered(problem, point, noise))


def _normal(problem: Problem, point: Point, noise: Noise, passes: Sequence[Filtered]) -> Normal:
    model = problem.with_memory(noise.memory)
    return model.normal(with_state(point, noise), [f.gains for f in passes])


def arrow(normal: Normal) -> tuple[np.ndarray, np.ndarray]:
    """The block-arrow equations as one matrix and one slope."""
    k, sizes = len(normal.slope), [len(s) for s in normal.own_slope]
    edges = k + np.concatenate(([0], np.cumsum(sizes))).astype(int)
    matrix = np.zeros((edges[-1], edges[-1]))
    matrix[:k, :k] = normal.shared
    for a, b, cross, own in zip(edges[:-1], edges[1:], normal.cross, normal.own, strict=True):
        matrix[:k, a:b], matrix[a:b, :k], matrix[a:b, a:b] = cross, cross.T, own
    return matrix, np.concatenate([normal.slope, *normal.own_slope])


def with_state(point: Point, noise: Noise) -> Point:
    """Append the disturbance state, zero at the start, where the noise has a memory."""
    if noise.memory is None:
        return point
    return Point(point.values, tuple(np.append(s, 0.0) for s in point.starts))


def natural_ratio(problem: Problem, point: Point) -> float:
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


def excerpt(problem: Problem, most: int = ENOUGH) -> Problem:
    """The problem on the first samples of its traces, enough for two noise figures."""
    total = sum(t.size for t in problem.traces)
    if total <= most:
        return problem
    keep = [max(10, t.size * most // total) for t in problem.traces]
    counts = None if problem.counts is None else tuple(m[:n] for m, n in zip(problem.counts, keep, strict=True))
    return replace(problem, counts=counts, traces=tuple(
        replace(t, inputs=t.inputs[:n], outputs=t.outputs[:n]) for t, n in zip(problem.traces, keep, strict=True)))


def fit_ratio(problem: Problem, point: Point, noise: Noise, around: float | None = None,
              settled: bool = False, quick: bool = False) -> Noise:
    """Maximum likelihood of the noise ratio (memory, share of what is slow) at fixed parameters.

    around   a ratio to search near; None: over eight decades, or from the noise where it has a memory
    settled  whether the point is near its optimum: then by restricted likelihood
    quick    to half a decade only, where there is none to search near
    """
    middle = np.log(natural_ratio(problem, point))
    problem = excerpt(problem)

    def listen(figures: np.ndarray) -> Heard:
        return _listen(problem, point, noise.at(figures), settled)

    if noise.memory is None and around is None:
        grid = middle + np.log(10.0) * DECADES
        best = by_parabolas(lambda g: min(listen(np.array([g])).value, FAR), grid, 0 if quick else 4)
        return noise.at(np.array([best]))
    return noise.at(scored(listen, (noise if around is None else replace(noise, ratio=around)).figures,
                           *noise.bounds(middle))[0])


def likelier_ratio(problem: Problem, point: Point, noise: Noise) -> Noise | None:
    """The noise with a clearly likelier ratio far from its own, all else as it is; None where there is none.

    The restricted likelihood of a ratio may have several peaks, and a search beside one sees that one alone.
    """
    middle = np.log(natural_ratio(problem, point))
    problem = excerpt(problem)

    def value(log: float) -> float:
        return min(_listen(problem, point, replace(noise, ratio=float(np.exp(log))), settled=True).value, FAR)

    least = value(np.log(noise.ratio)) - LIKELIER
    grid = list(middle + np.log(10.0) * DECADES)
    values = [value(log) for log in grid]
    if not min(values) < least:
        return None
    return replace(noise, ratio=float(np.exp(_refined(value, grid, values, 4, CLOSE))))


def _listen(problem: Problem, point: Point, noise: Noise, settled: bool) -> Heard:
    """What a noise makes of the traces; by restricted likelihood where the point is settled."""
    with np.errstate(over="ignore", invalid="ignore"):
        passes = filtered(problem, point, noise, keep=settled)
        value = integrated(problem, point, noise, passes)[0] if settled else minus_log_likelihood(passes)
    return heard(value if np.isfinite(value) else np.inf, passes)


def remembering(problem: Problem, point: Point, noise: Noise, value: Callable[[Noise], float]) -> Noise:
    """The likeliest noise with a memory: of torque that wanders, fast or slowly, or is weak where it is slow.

    value  -log likelihood of a noise at the point
    """
    begun = [Noise(noise.ratio, float(np.exp(-1.0 / samples)), noise.scale, slow=slow)
             for samples, slow in ((20.0, None), (500.0, None), (4.0, 0.3))]
    return min((fit_ratio(problem, point, n) for n in begun), key=lambda n: value(n) + n.parameters)


def by_parabolas(value: Callable[[float], float], grid: np.ndarray, rounds: int = 4, close: float = CLOSE) -> float:
    """Minimum of a function of one variable: grid, then parabolas through the best three, until they are close."""
    return _refined(value, list(grid), [value(g) for g in grid], rounds, close)


def _refined(value: Callable[[float], float], x: list[float], y: list[float], rounds: int, close: float) -> float:
    """Parabolas through the best three of some points, until they are close."""
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
        if not a < t < c or min(abs(t - k) for k in x) < close:
            break
        x.append(t)
        y.append(value(t))
    return x[int(np.argmin(y))]
