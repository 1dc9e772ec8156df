"""What a model leaves in its innovations that noise would not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_toeplitz

from drivetool.check.fit.model import (
    BROKEN,
    Masks,
    Model,
    everything,
    fit,
    likeliest_noise,
    over,
    sensor_std,
    spread,
)
from drivetool.check.fit.quantisation import COARSE, resolution
from drivetool.drive.simulation import Filtered, Gains
from drivetool.identify.noise import filtered, with_state, with_torque_noise
from drivetool.identify.problem import Normal, Problem, schur

LAGS = 20
PIECE = 0.1  # s over which the size of the innovations is compared
BINS = 16  # of speed, torque and angle
HALF_TOLD = 0.05  # of what is known of a direction, that each half of the records must tell
TRACE = 1e-6  # of what is known of a start state
ROUGHLY = 1e-9  # of the best known direction, below which rounding decides
SURE = 6.0  # standard deviations of a chi-square above its mean, below which nothing is said
ROUNDS = 5  # of a fit to a record that is made up
LEFT, LITTLE = 0.15, 10.0  # of the gain, and log likelihood, that may be left over for a name to be trusted
ROUNDED = 1.5  # by which the rounding of a logger may leave more than in a record that is made up


@dataclass(frozen=True)
class Remainder:
    """Log likelihood that is still to be had, at least, by source; zero where noise explains it.

    memory   innovations that repeat from sample to sample
    size     innovations that are larger in some places than in others
    place    a mean that depends on speed or torque
    time     parameters that differ between the first and the second half of the records
    """

    memory: float
    size: float
    place: float
    time: float = 0.0

    @property
    def total(self) -> float:
        """The largest of them: they overlap."""
        return max(self.memory, self.size, self.place, self.time)


def remainder(model: Model, held: Masks = ()) -> Remainder:
    """The remainder of a model over its records, from the first output.

    held  per trace (n,) samples of records held out, none of those that the model was fitted to: the noise of these
          is estimated on them

    A logger that rounds leaves errors that repeat where the motion is slow: what it leaves in records of the
    model itself, logged in the same steps, is no sign of anything else.
    """
    found = _left(model, model.problem, held)
    steps = _steps_of(model)
    # Records made up have no torque noise that is weak where it is slow, and that leaves something by itself.
    if found.total == 0.0 or steps[0] == 0.0 or (model.noise.slow is not None and not is_coarse(model)):
        return found
    rounding = _left(model, _logged_again(model, steps), held)
    return Remainder(*(max(0.0, getattr(found, name) - ROUNDED * getattr(rounding, name))
                       for name in ("memory", "size", "place", "time")))


def much_left(left: float, gained: float) -> bool:
    """Whether too much is still to be had for a name to be trusted; both log likelihoods."""
    return left > max(LEFT * gained, LITTLE)


def faked(base: Model, cause: Model, masks: Masks) -> float:
    """Log likelihood that a cause gains on records of the base itself, for no reason but the steps of the logger.

    Zero where these are finer than the noise: then rounding is noise, and has been counted as that. Zero, too,
    where a fit fails. Both are fitted from the noise of either: only one may have a form that rounding likes.
    """
    steps = _steps_of(base)
    if not is_coarse(base):
        return 0.0
    traces = _logged_again(base, steps).traces
    try:
        without, having = (
            min(fit(replace(m, problem=replace(m.problem, traces=traces), noise=noise), masks, most=ROUNDS).value
                for noise in (base.noise, cause.noise)) for m in (base, cause))
    except BROKEN:  # what cannot be fitted there says nothing
        return 0.0
    return without - having


def is_coarse(model: Model) -> bool:
    """Whether a sensor is logged in steps that are much of its noise."""
    noise = sensor_std(model) * model.noise.scale / model.noise.scale[0]
    return bool(np.any(_steps_of(model)**2 / 12.0 > COARSE * noise**2))


def _steps_of(model: Model) -> np.ndarray:
    """(ny,) the steps in which the outputs are logged, zero where there are none."""
    outputs = np.concatenate([t.outputs for t in model.problem.traces])
    return np.array([resolution(y[np.isfinite(y)]) or 0.0 for y in outputs.T])


def _logged_again(model: Model, steps: np.ndarray) -> Problem:
    """The records as the model and its noise would give them, logged in steps."""
    rng = np.random.default_rng(1)
    problem, noise = model.problem, model.noise
    passes = filtered(problem, model.point, noise, keep=False)
    first = np.sqrt(spread(passes, everything(problem)))
    sensors = np.sqrt(np.maximum((first * noise.scale) ** 2 - steps**2 / 12.0, 0.0))
    traces = []
    for trace, start, plant in zip(problem.traces, model.point.starts, problem.plants(model.point.values, False),
                                   strict=True):
        clean = plant.outputs(with_torque_noise(trace, noise.over(problem.steps(trace)), first, rng), start)
        clean += sensors * rng.standard_normal(clean.shape)
        rounded = np.where(steps > 0.0, np.round(clean / np.where(steps > 0.0, steps, 1.0)) * steps, clean)
        outputs = np.where(np.isfinite(trace.outputs), rounded, np.nan)
        traces.append(replace(trace, outputs=outputs))
    return replace(problem, traces=tuple(traces))


def _passes(model: Model, held: Masks) -> list[Filtered]:
    """A Kalman pass per trace; over records held out under the likeliest noise of those."""
    passes = filtered(model.problem, model.point, model.noise)
    apart = [i for i, mask in enumerate(held) if mask.any()]
    if apart:
        own = likeliest_noise(over(model, apart), [held[i] for i in apart])
        for i, passed in zip(apart, filtered(own.problem, own.point, own.noise), strict=True):
            passes[i] = passed
    return passes


def _left(model: Model, problem: Problem, held: Masks = ()) -> Remainder:
    """The remainder of a model over the records of a problem."""
    passes = _passes(replace(model, problem=problem), held)
    z, torque, speed, lengths = [], [], [], []
    for f, t in zip(passes, problem.traces, strict=True):
        e = f.innovations[:, 0] / np.sqrt(f.variance[:, 0])
        good = np.flatnonzero(np.isfinite(e[1:]))
        z.append(e[1 + good])
        # Of the sample before: feedback makes the torque of the same instant depend on what was measured.
        torque.append(t.inputs[good, 0])
        speed.append(f.states[good, 0])
        lengths.append(round(PIECE / t.step))
    scale = np.sqrt(np.mean(np.concatenate(z) ** 2))
    z = [e / max(scale, 1e-300) for e in z]
    return Remainder(_memory(z), _size(z, max(lengths[0], 10)),
                     max(_place(z, speed), _place(z, torque)), _time(model, problem, passes))


def _excess(chi: float, degrees: int) -> float:
    """Half of what a chi-square has above what chance gives it."""
    return max(0.0, 0.5 * (chi - degrees - SURE * np.sqrt(2.0 * degrees)))


def _memory(z: list[np.ndarray]) -> float:
    """What an autoregression of so many lags would gain.

    The sum of squared correlations, which is the same for small ones, counts a hum once per lag.
    """
    products = np.zeros(LAGS + 1)
    for e in z:
        products += [e[: max(len(e) - k, 0)] @ e[k:] for k in range(LAGS + 1)]
    n = sum(len(e) for e in z)
    if products[0] <= 0.0:
        return 0.0
    # Correlated to the last digit, a series is told from the one before it: there is no noise to speak of.
    told = min(float(products[1:] @ solve_toeplitz(products[:-1], products[1:])) / products[0], 1.0 - 1e-12)
    return _excess(-n * float(np.log1p(-told)), LAGS)


def _size(z: list[np.ndarray], length: int) -> float:
    """Scatter of the mean square over short pieces, against that of Gaussian noise with its own tails."""
    squares = [np.minimum(e[: len(e) // length * length].reshape(-1, length) ** 2, 25.0) for e in z
               if len(e) >= length]
    if not squares:
        return 0.0
    squares = np.concatenate(squares)
    # The spread within pieces is the yardstick: heavy tails alone are no structure.
    within = float(np.mean(np.var(squares, axis=1, ddof=1))) / length
    means = squares.mean(axis=1)
    if within <= 0.0:
        return 0.0
    return _excess(float(np.sum((means - means.mean()) ** 2) / within), len(means) - 1)


def _time(model: Model, problem: Problem, passes: Sequence[Filtered]) -> float:
    """What the parameters would gain if each half of every record had its own.

    By the slopes of the two halves at the common estimate, which are equal and opposite but for chance; in
    directions of which both halves tell something.
    """
    halves = []
    for late in (False, True):
        gains = [Gains(f.gains.gain, f.gains.weight * ((np.arange(len(f.innovations)) >= 0.5 * len(f.innovations))
                                                       == late)[:, None]) for f in passes]
        halves.append(problem.with_memory(model.noise.memory).normal(with_state(model.point, model.noise), gains))
    if not all(np.all(np.isfinite(part)) for h in halves for part in (h.shared, h.slope, *h.own, *h.cross)):
        return 0.0  # a model that runs away: of its parameters nothing is known
    (first, down), (second, up) = (_without_starts(half, halves) for half in halves)
    whole = first + second
    # A parameter of which nothing is known, on its bound say, is in no direction.
    worth = np.diag(whole) * problem.size**2
    if not np.all(np.isfinite(whole)) or not worth.max() > 0.0:
        return 0.0
    shown = np.flatnonzero(worth > ROUGHLY**2 * worth.max())
    size = np.sqrt(np.diag(whole)[shown])
    known, turn = np.linalg.eigh(whole[np.ix_(shown, shown)] / np.outer(size, size))
    good = known > ROUGHLY * known.max()
    turn = turn[:, good] / np.sqrt(known[good]) / size[:, None]
    first, down, up = first[np.ix_(shown, shown)], down[shown], up[shown]
    share, own = np.linalg.eigh(turn.T @ first @ turn)
    both = (share > HALF_TOLD) & (share < 1.0 - HALF_TOLD)
    turn, share = (turn @ own)[:, both], share[both]
    apart = (1.0 - share) * (turn.T @ down) - share * (turn.T @ up)
    variance = sum(half.cost for half in halves) / max(problem.count - problem.unknowns, 1)
    return _excess(float(np.sum(apart**2 / (share * (1.0 - share)))) / variance, int(both.sum()))


def _without_starts(half: Normal, halves: Sequence[Normal]) -> tuple[np.ndarray, np.ndarray]:
    """(matrix, slope) of the parameters by one half of the records, start states eliminated.

    Of these the later half may know nothing at all: a trace of what both know keeps the equations solvable.
    """
    own = tuple(o + TRACE * np.diag(np.diag(sum(both))) for o, both in zip(
        half.own, zip(*(h.own for h in halves), strict=True), strict=True))
    matrix, slope, _ = schur(replace(half, own=own))
    return matrix, slope


def _place(z: list[np.ndarray], where: list[np.ndarray]) -> float:
    e, x = np.concatenate(z), np.concatenate(where)
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, BINS + 1)))
    if len(edges) < 4:
        return 0.0
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(index, minlength=len(edges) - 1)
    sums = np.bincount(index, weights=e, minlength=len(edges) - 1)
    good = count > 10
    return _excess(float(np.sum(sums[good] ** 2 / count[good])), int(good.sum()))
