"""Cross-entropy search for the optimum from a prior (Rubinstein 1999).

With a low load inertia behind a gap the likelihood has very many narrow local optima. Under an observer that the
record corrects strongly one broad optimum remains, and the linear parameters have a prior of some per cent, with
correlations. So parameters are drawn from that prior, with half gaps over two decades. One pass of an observer
scores each draw, the next draws follow the best ones, and the observer's torque noise is reduced. Descents start
from the best draw; an optimum that two searches reach is confirmed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.drive import GEAR_RATIO_EXPONENTS, TOTALS
from drivetool.identify.estimate import Covariance
from drivetool.identify.noise import Noise, first_samples_of, minus_log_likelihood_at, unit_noise_ratio
from drivetool.identify.problem import Point
from drivetool.identify.setup import Task, first_point
from drivetool.identify.starts.process_noise_continuation import MIN_NOISE_RATIO
from drivetool.identify.starts.search import (
    SCREENING_SAMPLES,
    Descent,
    descents_agree,
    free_values,
    screening_values,
)
from drivetool.quantity import names_of, quantity_of, with_parts

MAX_CROSS_ENTROPY_SEARCHES = 4  # searches at most, a choice that bounds the time where no two agree
# Draws in the first round and in each later one, a choice: later ones fill less room.
FIRST_ROUND_DRAWS, LATER_ROUND_DRAWS = 150, 80
# By the linear drive's observers, and again by the exact ones; a choice that bounds the time.
MAX_CROSS_ENTROPY_ROUNDS = 6
# Log likelihood between the elite draws of a converged search, a choice: some standard deviations.
MAX_CONVERGED_RANGE = 10.0
ELITE_DRAWS = 12  # elite draws, a choice: fewer give no covariance of about ten parameters
# Variance of the next draws over that of the elite, a choice: at one, the search converges too early.
ELITE_VARIANCE_FACTOR = 1.5
HALF_GAP_RANGE = (0.02, 3.0)  # half gaps drawn, over the twist by the torque of the record; two decades, a choice
MIN_DRAWN_SHARE = 0.2  # of its value, below which no draw of a parameter goes: a prior of some per cent excludes it
# Torque noise in the first round, over that which moves the output by its sensor noise; a choice.
FIRST_ROUND_NOISE_RATIOS = (1.0, 0.3, 0.1)
NOISE_RATIO_PER_ROUND = 1.0 / 3.0  # factor of the noise from round to round, a choice: the steps of the first round

Score = Callable[[Task, float], float]  # (draw, noise ratio) -> -log likelihood


@dataclass(frozen=True)
class DrawTransform:
    """From independent numbers z (size,) to values of a task: by prior, half gaps, shares of friction sums.

    task    at the values of the prior
    names   (k,) with a prior and free; mean (k,) and root (k, k) of their covariance
    sums    of friction whose parts are free -> the parts at a sum of one, before they are shared
    gaps    name -> twist [motion unit] over which the half gap is counted
    """

    task: Task
    names: tuple[str, ...]
    mean: np.ndarray
    root: np.ndarray
    sums: Mapping[str, Mapping[str, float]]
    gaps: Mapping[str, float]

    @property
    def size(self) -> int:
        """How many numbers make a draw."""
        return len(self.names) + len(self.gaps) + sum(len(p) for p in self.sums.values())

    def drawn(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """(count, size) first draws."""
        z = rng.standard_normal((count, self.size))
        k = len(self.names)
        z[:, k:k + len(self.gaps)] = rng.uniform(*np.log(HALF_GAP_RANGE), (count, len(self.gaps)))
        return z

    def values(self, z: np.ndarray) -> dict[str, float]:
        """The parameter values of a draw."""
        k = len(self.names)
        known = self.mean + self.root @ z[:k]
        lowest = [MIN_DRAWN_SHARE * m if self.task.drive.quantity(n).bounds[0] >= 0.0 else -np.inf
                  for n, m in zip(self.names, self.mean, strict=True)]
        found = dict(zip(self.names, np.maximum(known, lowest).tolist(), strict=True))
        for name, twist in self.gaps.items():
            found[name] = float(twist * np.exp(z[k]))
            k += 1
        for total, parts in self.sums.items():
            weight = np.exp(z[k:k + len(parts)])
            whole = found.pop(total)
            found |= {n: float(whole * unit * w / weight.sum())
                      for (n, unit), w in zip(parts.items(), weight, strict=True)}
            k += len(parts)
        return found


def draw_transform(task: Task, prior: Covariance) -> DrawTransform:
    """The transform that draws the free parameters of a task from a prior with this covariance."""
    drive, sums = task.drive, {}
    for total, suffix in TOTALS.items():
        parts = names_of(drive.bodies, suffix)
        if total in prior.names and all(p in task.free for p in parts):
            sums[total] = {p: n ** GEAR_RATIO_EXPONENTS[suffix]
                           for p, n in zip(parts, drive.gear_ratios(), strict=True)}
    index = [i for i, n in enumerate(prior.names) if prior.matrix[i, i] > 0.0 and quantity_of(n) != "half_gap"
             and (n in sums or (n in task.free and n in drive.values))]
    names = tuple(prior.names[i] for i in index)
    mean = np.array([drive.referred_to_motor(TOTALS[n]) if n in sums else drive.values[n] for n in names])
    matrix = prior.matrix[np.ix_(index, index)]
    std = np.sqrt(np.diag(matrix))
    root = std[:, None] * np.linalg.cholesky(matrix / np.outer(std, std) + 1e-9 * np.eye(len(std)))
    torque = float(np.nanstd(np.concatenate([e.signals["motor_torque"] for e in task.experiments])))
    gaps = {n: torque / drive.values[with_parts(n, quantity="stiffness")]
            for n in task.free if quantity_of(n) == "half_gap"}
    return DrawTransform(task, names, mean, root, sums, gaps)


@np.errstate(over="ignore", invalid="ignore")  # an extreme draw may make an observer unstable
def best_draw(transform: DrawTransform, seed: int) -> tuple[Task, float]:
    """(the best draw of a search, torque noise of the observer under which it is the best).

    First by the observers of the linear drive, which are quick and tolerate a contact at the wrong time, then by
    the exact ones, which weight it correctly.
    """
    rng, task = np.random.default_rng(seed), transform.task
    problem, linear = first_samples_of(task.problem(), SCREENING_SAMPLES), first_samples_of(task.linear_problem(),
                                                                                            SCREENING_SAMPLES)
    draws = transform.drawn(rng, FIRST_ROUND_DRAWS)
    natural = unit_noise_ratio(problem, first_point(task.at(transform.values(draws[0])).drive, problem, task.roles))

    def by_linear(trial: Task, share: float) -> float:
        return screening_values(problem, linear, trial, natural, (share,))[0]

    def by_exact(trial: Task, share: float) -> float:
        point = Point(free_values(trial), first_point(trial.drive, problem, task.roles).starts)
        noise = Noise(share * natural, None, problem.scale, share * natural)
        return minus_log_likelihood_at(problem, point, noise)

    best, ratio = _cross_entropy_rounds(transform, rng, by_linear, draws, FIRST_ROUND_NOISE_RATIOS)
    best, ratio = _cross_entropy_rounds(transform, rng, by_exact, _next_draws(best, rng),
                                        (ratio, NOISE_RATIO_PER_ROUND * ratio))
    return task.at(transform.values(best[0])), ratio


def _cross_entropy_rounds(transform: DrawTransform, rng: np.random.Generator, score: Score, draws: np.ndarray,
                          ratios: Sequence[float]) -> tuple[np.ndarray, float]:
    """((ELITE_DRAWS, size) the elite draws, the best first, and the noise ratio of the best one's observer)."""
    for rounds_left in range(MAX_CROSS_ENTROPY_ROUNDS - 1, -1, -1):
        scores = np.array([[score(transform.task.at(transform.values(z)), share) for share in ratios]
                           for z in draws])
        scores[np.isnan(scores)] = np.inf
        lowest = scores.min(axis=1)
        order = np.argsort(lowest, kind="stable")[:ELITE_DRAWS]
        best, best_ratio = draws[order], ratios[int(np.argmin(scores[order[0]]))]
        if rounds_left == 0 or lowest[order[-1]] - lowest[order[0]] < MAX_CONVERGED_RANGE:
            break
        draws, ratios = _next_draws(best, rng), (best_ratio, NOISE_RATIO_PER_ROUND * best_ratio)
    return best, best_ratio


def _next_draws(best: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The best three draws and new ones from the distribution of the elite."""
    root = np.linalg.cholesky(ELITE_VARIANCE_FACTOR * np.cov(best.T) + 1e-6 * np.eye(best.shape[1]))
    return np.concatenate([best[:3],
                           best.mean(axis=0) + rng.standard_normal((LATER_ROUND_DRAWS, len(root))) @ root.T])


def search_from_prior(prior: Covariance) -> Callable:
    """A search for `by_innovations` that starts from a prior of the values; see `searched`."""

    def search(task: Task, starts: Sequence[Mapping[str, float]], seed: int, descend: Callable, distance: Callable,
               max_descents: int | None = None) -> list[Descent]:
        transform, found = draw_transform(task, prior), []
        for k in range(min(max_descents or MAX_CROSS_ENTROPY_SEARCHES, MAX_CROSS_ENTROPY_SEARCHES)):
            start, ratio = best_draw(transform, seed + k)
            start_values = dict(zip(task.free, free_values(start).tolist(), strict=True))
            lowest = min((d.value for d in found), default=np.inf)
            ends = [descend(start, "exact", hot, lowest)[:2] for hot in (ratio, MIN_NOISE_RATIO)]
            value, end = min(ends, key=lambda pair: pair[0])
            found.append(Descent(start_values, "exact", value, end))
            if max_descents is None and descents_agree(found, distance):
                break
        return found

    return search
