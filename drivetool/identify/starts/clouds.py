"""A way into the optimum from what is known beforehand: a cloud of guesses that condenses.

The likelihood of a light load behind a gap has very many narrow peaks, but under an observer that
listens hard to the record one hill stands out, and the linear parameters are known to some per cent, with
their correlations. So: draw guesses from that knowledge with half gaps over two decades, judge each by one pass
of a hot observer, draw new ones like the best, let the observer cool, and so on (the cross-entropy method,
Rubinstein 1999). Descents begin where the cloud has condensed; what two clouds lead to counts as confirmed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.drive import GEARED, TOTALS
from drivetool.identify.estimate import Covariance
from drivetool.identify.noise import Noise, excerpt, filtered, minus_log_likelihood, natural_ratio
from drivetool.identify.problem import Point
from drivetool.identify.setup import Task, first_point
from drivetool.identify.starts.cooling import COLDEST
from drivetool.identify.starts.search import GLANCE, Descent, confirmed, glances, values_of

CLOUDS = 4  # at most
FIRST, LATER = 150, 80  # guesses in the first round and in each later one
ROUNDS = 6  # by the linear drive's observers, and again by the exact ones; at most
STILL = 10.0  # log likelihood within which the best lie once a cloud has condensed
BEST = 12  # guesses like which the next ones are drawn
WIDER = 1.5  # variance of the next ones over that of the best
REACH = (0.02, 3.0)  # half gaps guessed, over the twist that the torque of the record makes
LEAST = 0.2  # of its value, below which no guess of a parameter goes
HOT = (1.0, 0.3, 0.1)  # torque noise in the first round, over that which moves the output by its sensor noise
COOLER = 1.0 / 3.0  # by which it may fall from round to round

Look = Callable[[Task, float], float]  # (guess, how hot) -> -log likelihood


@dataclass(frozen=True)
class Guesses:
    """From independent numbers z (size,) to values of a task: known ones, half gaps, shares of friction sums.

    task    at the values known
    names   (k,) known and free; mean (k,) and root (k, k) of their covariance
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
        """How many numbers make a guess."""
        return len(self.names) + len(self.gaps) + sum(len(p) for p in self.sums.values())

    def drawn(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """(count, size) first guesses."""
        z = rng.standard_normal((count, self.size))
        k = len(self.names)
        z[:, k:k + len(self.gaps)] = rng.uniform(*np.log(REACH), (count, len(self.gaps)))
        return z

    def values(self, z: np.ndarray) -> dict[str, float]:
        """The values that a guess stands for."""
        k = len(self.names)
        known = self.mean + self.root @ z[:k]
        lowest = [LEAST * m if self.task.drive.quantity(n).bounds[0] >= 0.0 else -np.inf
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


def guesses(task: Task, known: Covariance) -> Guesses:
    """How to guess the free parameters of a task whose values are known with this covariance."""
    drive, sums = task.drive, {}
    for total, suffix in TOTALS.items():
        parts = [f"{b}.{suffix}" for b in drive.bodies]
        if total in known.names and all(p in task.free for p in parts):
            sums[total] = {p: n ** GEARED[suffix] for p, n in zip(parts, drive.turns(), strict=True)}
    index = [i for i, n in enumerate(known.names) if known.matrix[i, i] > 0.0 and not n.endswith(".half_gap")
             and (n in sums or (n in task.free and n in drive.values))]
    names = tuple(known.names[i] for i in index)
    mean = np.array([drive.felt(TOTALS[n]) if n in sums else drive.values[n] for n in names])
    matrix = known.matrix[np.ix_(index, index)]
    std = np.sqrt(np.diag(matrix))
    root = std[:, None] * np.linalg.cholesky(matrix / np.outer(std, std) + 1e-9 * np.eye(len(std)))
    torque = float(np.nanstd(np.concatenate([e.signals["motor_torque"] for e in task.experiments])))
    gaps = {n: torque / drive.values[n.removesuffix("half_gap") + "stiffness"]
            for n in task.free if n.endswith(".half_gap")}
    return Guesses(task, names, mean, root, sums, gaps)


@np.errstate(over="ignore", invalid="ignore")  # a wild guess may make an observer unstable
def condensed(guess: Guesses, seed: int) -> tuple[Task, float]:
    """(the best guess of a cloud, torque noise of the observer under which it is the best).

    First by the observers of the linear drive, which are quick and forgive a contact at the wrong time, then by
    the exact ones, which weigh it rightly.
    """
    rng, task = np.random.default_rng(seed), guess.task
    problem, linear = excerpt(task.problem(), GLANCE), excerpt(task.linear_problem(), GLANCE)
    cloud = guess.drawn(rng, FIRST)
    natural = natural_ratio(problem, first_point(task.at(guess.values(cloud[0])).drive, problem, task.roles))

    def by_linear(trial: Task, share: float) -> float:
        return glances(problem, linear, trial, natural, (share,))[0]

    def by_exact(trial: Task, share: float) -> float:
        point = Point(values_of(trial), first_point(trial.drive, problem, task.roles).starts)
        noise = Noise(share * natural, None, problem.scale, share * natural)
        return minus_log_likelihood(filtered(problem, point, noise, keep=False))

    best, warm = _condense(guess, rng, by_linear, cloud, HOT)
    best, warm = _condense(guess, rng, by_exact, _like(best, rng), (warm, COOLER * warm))
    return task.at(guess.values(best[0])), warm


def _condense(guess: Guesses, rng: np.random.Generator, look: Look, cloud: np.ndarray,
              hot: Sequence[float]) -> tuple[np.ndarray, float]:
    """((BEST, size) the best guesses, the best first, and how hot the observer was that told so)."""
    for left in range(ROUNDS - 1, -1, -1):
        looks = np.array([[look(guess.task.at(guess.values(z)), share) for share in hot] for z in cloud])
        looks[np.isnan(looks)] = np.inf
        lowest = looks.min(axis=1)
        order = np.argsort(lowest, kind="stable")[:BEST]
        best, warm = cloud[order], hot[int(np.argmin(looks[order[0]]))]
        if left == 0 or lowest[order[-1]] - lowest[order[0]] < STILL:
            break
        cloud, hot = _like(best, rng), (warm, COOLER * warm)
    return best, warm


def _like(best: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The best three guesses and new ones like the best."""
    spread = np.linalg.cholesky(WIDER * np.cov(best.T) + 1e-6 * np.eye(best.shape[1]))
    return np.concatenate([best[:3], best.mean(axis=0) + rng.standard_normal((LATER, len(spread))) @ spread.T])


def from_known(known: Covariance) -> Callable:
    """A search for `by_innovations` that begins with what is known of the values; see `searched`."""

    def search(task: Task, starts: Sequence[Mapping[str, float]], seed: int, descend: Callable, gap: Callable,
               most: int | None = None) -> list[Descent]:
        guess, found = guesses(task, known), []
        for k in range(min(most or CLOUDS, CLOUDS)):
            start, warm = condensed(guess, seed + k)
            begun = dict(zip(task.free, values_of(start).tolist(), strict=True))
            lowest = min((d.value for d in found), default=np.inf)
            ends = [descend(start, "exact", hot, lowest)[:2] for hot in (warm, COLDEST)]
            value, end = min(ends, key=lambda pair: pair[0])
            found.append(Descent(begun, "exact", value, end))
            if most is None and confirmed(found, gap):
                break
        return found

    return search
