"""Load step scan: the instants at which constant torques explain the innovations, one by one and jointly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.check.fit import Model
from drivetool.check.starts.scan import MAX_SCAN_STARTS, innovations, steady_filter
from drivetool.drive.effects import STEP_NAMES
from drivetool.drive.simulation import Trace

# s at both ends of a record, and between steps. A choice: a nearer step is masked by the start state or the
# other step.
MIN_STEP_DISTANCE = 0.3
# Chi-square of a further step. A choice: far above that of chance (10.8 is the 0.1 % point of one instant).
MIN_STEP_CHI2 = 40.0


def load_steps(base: Model) -> list[list[tuple[float, int]]]:
    """Sets of (instant [s], number of the record, 0 for each) at which constant torques explain innovations best.

    Sets of one instant first, then the set that several make together, if they make one.
    """
    z, _, _ = innovations(base)
    step = base.problem.traces[0].step
    pairs = [(t, e) for t, e in zip(base.problem.traces, z, strict=True) if t.step == step]
    numbers = list(dict.fromkeys(t.record for t, _ in pairs))
    whole = LoadStepScan(base, pairs)
    found = [[(time, 0)] for _, time in whole.likeliest()]
    if len(numbers) == 1:
        several = [(*each, 0) for each in whole.together()]
    else:
        own = {number: LoadStepScan(base, [p for p in pairs if p[0].record == number]) for number in numbers}
        single = [(*each, number) for number, its in own.items() for each in its.likeliest()]
        found += [[(time, number)] for _, time, number in sorted(single, reverse=True)[:MAX_SCAN_STARTS]]
        several = [(*each, number) for number, its in own.items() for each in its.together()]
    several = sorted(several, reverse=True)[:len(STEP_NAMES)]
    together = sorted((time, number) for _, time, number in several)
    return [*found, together] if len(together) > 1 else found


class LoadStepScan:
    """Chi-square of a constant torque on the load in the innovations of some segments, by its first instant.

    pairs  segment, (n, outputs) whitened innovations: the same instants in all of them
    """

    def __init__(self, base: Model, pairs: Sequence[tuple[Trace, np.ndarray]]):
        self.step = pairs[0][0].step
        self.begin = min(t.origin for t, _ in pairs)
        starts = [round((t.origin - self.begin) / self.step) for t, _ in pairs]
        self.places = [(k, t.size) for k, (t, _) in zip(starts, pairs, strict=True)]
        self.size, self.margin = max(map(sum, self.places)), max(1, round(MIN_STEP_DISTANCE / self.step))
        self.shape = _step_shape(base, max(t.size for t, _ in pairs))
        self.left = [e for _, e in pairs]
        # A torque from the start on is an idle torque, which the base has: remove its part.
        energy = np.zeros(self.size)
        for first, size in self.places:
            own = np.cumsum((self.shape[:size] ** 2).sum(axis=1))[::-1]
            energy[:first] += own[0]
            energy[first:first + size] += own
        self.rest, self.least = energy, 1e-3 * energy[0]
        self.taken: list[int] = []
        self.directions: list[list[np.ndarray]] = []  # orthonormal shapes of the selected steps
        self._take(0)

    def _correlated(self, stretches: Sequence[np.ndarray]) -> np.ndarray:
        """(n,) inner product of the segments with the step shape that begins at each instant.

        A torque that begins before a segment acts in all of it, after its end in none.
        """
        found = np.zeros(self.size)
        for (first, size), stretch in zip(self.places, stretches, strict=True):
            for e, shape in zip(stretch.T, self.shape[:size].T, strict=True):
                own = _cross_correlation(e, shape)
                found[:first] += own[0]
                found[first:first + size] += own
        return found

    def _take(self, k: int) -> None:
        """Select the step at an instant and remove its shape from the residuals (Gram-Schmidt)."""
        own = []
        for first, size in self.places:
            late = min(max(k - first, 0), size)
            own.append(np.concatenate((np.zeros_like(self.shape[:late]), self.shape[:size - late])))
        for other in self.directions:
            share = _inner_product(own, other)
            own = [a - share * b for a, b in zip(own, other, strict=True)]
        length = np.sqrt(max(_inner_product(own, own), 1e-300))
        own = [a / length for a in own]
        share = _inner_product(self.left, own)
        self.left = [e - share * a for e, a in zip(self.left, own, strict=True)]
        self.rest = self.rest - self._correlated(own) ** 2
        self.directions.append(own)
        self.taken.append(k)

    def likeliest(self) -> list[tuple[float, float]]:
        """(chi-square, instant [s]) of the best instants, each by itself."""
        scores = self._scores()
        return [(float(scores[i]), self.begin + i * self.step)
                for i in separated_maxima(scores, self.margin)[:MAX_SCAN_STARTS]
                if scores[i] > 0.0]

    def together(self) -> list[tuple[float, float]]:
        """(chi-square beside those before it, instant [s]) of the best instants, selected one after the other."""
        found: list[tuple[float, float]] = []
        count = sum(e.size for e in self.left)
        while len(found) < len(STEP_NAMES):
            scores = self._scores()
            best = int(np.argmax(scores))
            if not scores[best] > MIN_STEP_CHI2 * sum(float(np.sum(e**2)) for e in self.left) / count:
                break
            found.append((float(scores[best]), self.begin + best * self.step))
            self._take(best)
        return found

    def _scores(self) -> np.ndarray:
        """(n,) chi-square of each instant beside those selected; zero near these and near both ends."""
        scores = self._correlated(self.left) ** 2 / np.maximum(self.rest, self.least)
        for k in self.taken:
            scores[max(k - self.margin, 0):k + self.margin] = 0.0
        scores[self.size - self.margin:] = 0.0
        return scores


def _inner_product(one: Sequence[np.ndarray], other: Sequence[np.ndarray]) -> float:
    return sum(float(np.sum(a * b)) for a, b in zip(one, other, strict=True))


def _step_shape(base: Model, size: int) -> np.ndarray:
    """(size, outputs) whitened innovations that a constant torque on the load leaves from its first sample on."""
    a, gamma, c = steady_filter(base, at_load=True)
    x, shape = np.zeros(len(a)), np.empty((size, len(c)))
    for k in range(size):
        shape[k] = c @ x
        x = a @ x + gamma
    return shape


def _cross_correlation(e: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """(n,) per sample the inner product of e with the shape that begins there."""
    n = len(e)
    size = 1 << (2 * n - 1).bit_length()
    return np.fft.irfft(np.fft.rfft(e, size) * np.conj(np.fft.rfft(shape, size)), size)[:n]


def separated_maxima(scores: np.ndarray, distance: int) -> list[int]:
    """Indices of the highest values at least `distance` from one another."""
    found: list[int] = []
    for i in np.argsort(-scores, kind="stable"):
        if all(abs(int(i) - j) >= distance for j in found):
            found.append(int(i))
        if len(found) == MAX_SCAN_STARTS:
            break
    return found
