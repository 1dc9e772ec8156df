"""Where a series steps, and whether it drifts: change points against drift against both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drivetool.site.trends.regression import Fit, fit

# Recordings before a change, and between two: fewer do not tell the scatter that its size is compared with.
FEWEST_BEFORE = 5
# Recordings after the last change: one alone may be a bad recording, and a change shall be found with the second.
FEWEST_AFTER = 2
FEWEST = FEWEST_BEFORE + FEWEST_AFTER
# Chance of any change in all the series of a site that do not change. A site is looked at daily, and a false alarm
# costs a person a walk: one of a hundred sites without a change may have one.
LEVEL = 0.01
HALF = 0.5
MOST_CHANGES = 20  # of one series; what changes more often has no levels


@dataclass(frozen=True)
class Model:
    """What a series does, from place to place.

    slope    whether it drifts; cuts: places of the first recordings after each step, rising
    chances  of each step, for all places and tests; slope_chance: of the drift, for all tests, 1 where it is none
    fit      columns are 1, place less the mean place where it drifts, and 0 before and 1 from each cut on
    """

    slope: bool
    cuts: tuple[int, ...]
    chances: tuple[float, ...]
    slope_chance: float
    fit: Fit

    @property
    def first_step(self) -> int:
        """The column of the first step."""
        return 2 if self.slope else 1


def model_of(values: np.ndarray, weights: np.ndarray, tests: int) -> Model:
    """The model that describes a series best, of those that are significant.

    values   (n,) in the order of the recordings; weights (n,) of mean 1
    tests    how many hypotheses are tested in all: two per series, a drift and steps
    returns  Model: steps alone, a drift, or steps beside one drift, by the modified information criterion of Zhang
             and Siegmund. In both families steps are added one by one, or two at once, where they explain most, as
             long as they are significant. A chance is that of Student's t, multiplied by the places looked at and
             by `tests` (Bonferroni). It holds whatever the correlation between places, parameters and machines. Of
             the maximum over places that is at most a factor of three too much, half a standard deviation.
    source   Zhang and Siegmund 2007 (criterion); Worsley 1979 (maximum over places); Fryzlewicz 2014 (steps one
             by one)
    """
    n = len(values)
    if n < FEWEST:
        return Model(False, (), (), 1.0, fit(values, weights, np.ones((n, 1))))
    stepping = _with_steps(values, weights, False, tests)
    drifting = _with_steps(values, weights, True, tests)
    if drifting.slope_chance > LEVEL or criterion(stepping, n) <= criterion(drifting, n):
        return stepping
    return drifting


def criterion(model: Model, n: int) -> float:
    """Zhang and Siegmund's modified criterion, less is better: a place costs three times what a slope does."""
    sizes = np.diff([0, *model.cuts, n])
    squares = max(model.fit.squares, np.finfo(float).tiny)
    return float(n * np.log(squares / n) + (3.0 * len(model.cuts) + model.slope) * np.log(n)
                 + np.sum(np.log(sizes / n)))


def _with_steps(values: np.ndarray, weights: np.ndarray, slope: bool, tests: int) -> Model:
    """Steps that are significant beside a mean, or beside a drift."""
    n, chances = len(values), {}
    model = _fitted(values, weights, slope, ())
    while len(model.cuts) < MOST_CHANGES:
        places = _places(n, model.cuts)
        if not len(places) or model.fit.squares <= 0.0:
            break
        one = _one_more(model, values, weights)
        found = _new_chances(model, one, values, len(places) * tests)
        if max(found.values()) > LEVEL:
            # A change that was put right again is two steps, of which either alone explains little.
            two = _one_more(one, values, weights)
            found = _new_chances(model, two, values, len(places) ** 2 // 2 * tests)
            if two is one or max(found.values()) > LEVEL:
                break
            one = two
        model = one
        chances |= found
    model = replace(model, chances=tuple(chances[cut] for cut in model.cuts))
    return replace(model, slope_chance=min(model.fit.chance(1) * tests, 1.0)) if slope else model


def _one_more(model: Model, values: np.ndarray, weights: np.ndarray) -> Model:
    """The model with the step that explains most of what it leaves; itself where there is no place for one."""
    places = _places(len(values), model.cuts)
    if not len(places):
        return model
    place = int(places[np.argmax(_gains(model, values, weights, places))])
    return _fitted(values, weights, model.slope, tuple(sorted((*model.cuts, place))))


def _new_chances(old: Model, new: Model, values: np.ndarray, looked_at: int) -> dict[int, float]:
    """Place -> chance of each step that the new model has and the old one has not, times what was looked at."""
    return {cut: min(new.fit.chance(new.first_step + i) * looked_at, 1.0) if _lasts(new, values, i) else 1.0
            for i, cut in enumerate(new.cuts) if cut not in old.cuts}


def _lasts(model: Model, values: np.ndarray, i: int) -> bool:
    """Whether every recording after a step at the end has made at least half of it: one bad one is no step."""
    cut, size = model.cuts[i], model.fit.coefficients[model.first_step + i]
    if len(values) - cut >= FEWEST_BEFORE:
        return True
    expected = columns(len(values), model.slope, model.cuts)[cut:] @ model.fit.coefficients
    return bool(np.all((values[cut:] - expected) * np.sign(size) >= -HALF * abs(size)))


def _fitted(values: np.ndarray, weights: np.ndarray, slope: bool, cuts: tuple[int, ...]) -> Model:
    """The model with given steps; chances are not known yet."""
    return Model(slope, cuts, (), 1.0, fit(values, weights, columns(len(values), slope, cuts)))


def columns(n: int, slope: bool, cuts: tuple[int, ...]) -> np.ndarray:
    """(n, k) the columns of a model, see `Model.fit`."""
    place = np.arange(n)
    return np.column_stack([np.ones(n), *([place - (n - 1) / 2.0] if slope else []),
                            *((place >= cut).astype(float) for cut in cuts)])


def _places(n: int, cuts: tuple[int, ...]) -> np.ndarray:
    """Places at which one more step leaves every part long enough."""
    ends = [0, *cuts, n]
    return np.concatenate([np.arange(a + FEWEST_BEFORE, b - (FEWEST_AFTER if b == n else FEWEST_BEFORE) + 1)
                           for a, b in pairwise(ends)])


def _gains(model: Model, values: np.ndarray, weights: np.ndarray, places: np.ndarray) -> np.ndarray:
    """By how much one more step at each place lessens the squares of what is left.

    The column of a step less its part in the model is what the step explains with; sums from the end on give that
    for all places at once.
    """
    root = np.sqrt(weights)
    q, _ = np.linalg.qr(columns(len(values), model.slope, model.cuts) * root[:, None])
    explained = _from_the_end(root * model.fit.left)
    inside = _from_the_end(root[:, None] * q)
    own = _from_the_end(weights) - np.sum(inside**2, axis=1)
    return (explained**2 / np.maximum(own, np.finfo(float).eps * len(values)))[places]


def _from_the_end(x: np.ndarray) -> np.ndarray:
    """Sums over each place and all later ones."""
    return np.cumsum(x[::-1], axis=0)[::-1]
