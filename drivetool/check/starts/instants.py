"""Load steps: the instants at which constant torques explain the innovations, one by one and together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.check.fit import Model
from drivetool.check.starts.scan import KEEP, innovations, steady_filter
from drivetool.drive.effects import STEPS
from drivetool.drive.simulation import Trace

EARLY = 0.3  # s at both ends of a record, and from step to step, where a load step is not looked for
FURTHER = 40.0  # chi-square that a further step must bring


def load_steps(base: Model) -> list[list[tuple[float, int]]]:
    """Sets of (instant [s], number of the record, 0 for each) at which constant torques explain innovations best.

    Sets of one instant first, then the set that several make together, if they make one.
    """
    z, _, _ = innovations(base)
    step = base.problem.traces[0].step
    pairs = [(t, e) for t, e in zip(base.problem.traces, z, strict=True) if t.step == step]
    numbers = list(dict.fromkeys(t.record for t, _ in pairs))
    whole = Instants(base, pairs)
    found = [[(time, 0)] for _, time in whole.likeliest()]
    if len(numbers) == 1:
        several = [(*each, 0) for each in whole.together()]
    else:
        own = {number: Instants(base, [p for p in pairs if p[0].record == number]) for number in numbers}
        alone = [(*each, number) for number, its in own.items() for each in its.likeliest()]
        found += [[(time, number)] for _, time, number in sorted(alone, reverse=True)[:KEEP]]
        several = [(*each, number) for number, its in own.items() for each in its.together()]
    several = sorted(several, reverse=True)[:len(STEPS)]
    together = sorted((time, number) for _, time, number in several)
    return [*found, together] if len(together) > 1 else found


class Instants:
    """What a constant torque on the load explains of the innovations of some stretches, by its first instant.

    pairs  stretch, (n, outputs) whitened innovations: the same instants in all of them
    """

    def __init__(self, base: Model, pairs: Sequence[tuple[Trace, np.ndarray]]):
        self.step = pairs[0][0].step
        self.begin = min(t.origin for t, _ in pairs)
        starts = [round((t.origin - self.begin) / self.step) for t, _ in pairs]
        self.places = [(k, t.size) for k, (t, _) in zip(starts, pairs, strict=True)]
        self.size, self.margin = max(map(sum, self.places)), max(1, round(EARLY / self.step))
        self.shape = _step_shape(base, max(t.size for t, _ in pairs))
        self.left = [e for _, e in pairs]
        # A torque from the start on is an idle torque, which the base has: take its share off.
        energy = np.zeros(self.size)
        for first, size in self.places:
            own = np.cumsum((self.shape[:size] ** 2).sum(axis=1))[::-1]
            energy[:first] += own[0]
            energy[first:first + size] += own
        self.rest, self.least = energy, 1e-3 * energy[0]
        self.taken: list[int] = []
        self.directions: list[list[np.ndarray]] = []  # of what is taken, of length one and at right angles
        self._take(0)

    def _against(self, stretches: Sequence[np.ndarray]) -> np.ndarray:
        """(n,) product of what there is in the stretches with the shape that begins at each instant.

        Before a stretch begins the torque acts in all of it, after its end in none.
        """
        found = np.zeros(self.size)
        for (first, size), stretch in zip(self.places, stretches, strict=True):
            for e, shape in zip(stretch.T, self.shape[:size].T, strict=True):
                own = _matches(e, shape)
                found[:first] += own[0]
                found[first:first + size] += own
        return found

    def _take(self, k: int) -> None:
        """Let the shape that begins at an instant, and what it explains, be known."""
        own = []
        for first, size in self.places:
            late = min(max(k - first, 0), size)
            own.append(np.concatenate((np.zeros_like(self.shape[:late]), self.shape[:size - late])))
        for other in self.directions:
            share = _product(own, other)
            own = [a - share * b for a, b in zip(own, other, strict=True)]
        length = np.sqrt(max(_product(own, own), 1e-300))
        own = [a / length for a in own]
        share = _product(self.left, own)
        self.left = [e - share * a for e, a in zip(self.left, own, strict=True)]
        self.rest = self.rest - self._against(own) ** 2
        self.directions.append(own)
        self.taken.append(k)

    def likeliest(self) -> list[tuple[float, float]]:
        """(what it explains, instant [s]) of the best instants, each by itself."""
        scores = self._scores()
        return [(float(scores[i]), self.begin + i * self.step) for i in apart(scores, self.margin)[:KEEP]
                if scores[i] > 0.0]

    def together(self) -> list[tuple[float, float]]:
        """(what it adds to those before it, instant [s]) of the best instants, one beside the other."""
        found: list[tuple[float, float]] = []
        count = sum(e.size for e in self.left)
        while len(found) < len(STEPS):
            scores = self._scores()
            best = int(np.argmax(scores))
            if not scores[best] > FURTHER * sum(float(np.sum(e**2)) for e in self.left) / count:
                break
            found.append((float(scores[best]), self.begin + best * self.step))
            self._take(best)
        return found

    def _scores(self) -> np.ndarray:
        """(n,) what each instant explains beside those taken; zero near these and near both ends."""
        scores = self._against(self.left) ** 2 / np.maximum(self.rest, self.least)
        for k in self.taken:
            scores[max(k - self.margin, 0):k + self.margin] = 0.0
        scores[self.size - self.margin:] = 0.0
        return scores


def _product(one: Sequence[np.ndarray], other: Sequence[np.ndarray]) -> float:
    return sum(float(np.sum(a * b)) for a, b in zip(one, other, strict=True))


def _step_shape(base: Model, size: int) -> np.ndarray:
    """(size, outputs) whitened innovations that a constant torque on the load leaves from its first sample on."""
    a, gamma, c = steady_filter(base, at_load=True)
    x, shape = np.zeros(len(a)), np.empty((size, len(c)))
    for k in range(size):
        shape[k] = c @ x
        x = a @ x + gamma
    return shape


def _matches(e: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """(n,) per sample the product of e and the shape that begins there."""
    n = len(e)
    size = 1 << (2 * n - 1).bit_length()
    return np.fft.irfft(np.fft.rfft(e, size) * np.conj(np.fft.rfft(shape, size)), size)[:n]


def apart(scores: np.ndarray, distance: int) -> list[int]:
    """Indices of the highest values that lie at least `distance` apart."""
    found: list[int] = []
    for i in np.argsort(-scores, kind="stable"):
        if all(abs(int(i) - j) >= distance for j in found):
            found.append(int(i))
        if len(found) == KEEP:
            break
    return found
