"""Steps and drift of a series: selects between change points, a drift, and both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drivetool.site.trends.regression import WeightedFit, weighted_fit

# Recordings before a change, and between two: fewer give no estimate of the scatter, the unit of its size.
MIN_RECORDINGS_BEFORE_STEP = 5
# Recordings after the last change: one alone may be a bad recording; the second must suffice to detect a change.
MIN_RECORDINGS_AFTER_STEP = 2
MIN_SERIES_LENGTH = MIN_RECORDINGS_BEFORE_STEP + MIN_RECORDINGS_AFTER_STEP
# Chance of any false change in all series of a site. A site is checked daily, and a false alarm costs a person a
# walk to the machine: one of a hundred sites without a change may have one.
SITE_FALSE_ALARM_RATE = 0.01
# Midpoint between no step and the whole step: a recording beyond it is nearer to the level after the step.
MIN_LASTING_SHARE = 0.5
MAX_STEPS_PER_SERIES = 20  # A choice: a series that changes more often has no constant levels.


@dataclass(frozen=True)
class ChangeModel:
    """A piecewise constant or linear series over the places of its recordings.

    slope    whether it drifts; cuts: places of the first recordings after each step, rising
    chances  of each step, for all places and tests; slope_chance: of the drift, for all tests, 1 where it is none
    fit      columns are 1, with a drift place minus mean place, and per cut 0 before and 1 from it on
    """

    slope: bool
    cuts: tuple[int, ...]
    chances: tuple[float, ...]
    slope_chance: float
    fit: WeightedFit

    @property
    def first_step(self) -> int:
        """The column of the first step."""
        return 2 if self.slope else 1


def select_model(values: np.ndarray, weights: np.ndarray, tests: int) -> ChangeModel:
    """The best model of a series among the significant ones.

    values   (n,) in the order of the recordings; weights (n,) of mean 1
    tests    how many hypotheses are tested in all: two per series, a drift and steps
    returns  Model: steps alone, a drift, or steps beside one drift, by the modified information criterion of Zhang
             and Siegmund. In both families steps are added one by one, or two at once, where they explain most, as
             long as they are significant. A chance is that of Student's t, times the number of tested places and
             `tests` (Bonferroni). It holds for any correlation between places, parameters and machines. For the
             maximum over places it is too large by a factor of at most three, or half a standard deviation.
    source   Zhang and Siegmund 2007 (criterion); Worsley 1979 (maximum over places); Fryzlewicz 2014 (steps one
             by one)
    """
    n = len(values)
    if n < MIN_SERIES_LENGTH:
        return ChangeModel(False, (), (), 1.0, weighted_fit(values, weights, np.ones((n, 1))))
    stepping = _add_significant_steps(values, weights, False, tests)
    drifting = _add_significant_steps(values, weights, True, tests)
    if drifting.slope_chance > SITE_FALSE_ALARM_RATE or modified_bic(stepping, n) <= modified_bic(drifting, n):
        return stepping
    return drifting


def modified_bic(model: ChangeModel, n: int) -> float:
    """Zhang and Siegmund's modified criterion, smaller is better: a step costs three times as much as a slope."""
    segment_lengths = np.diff([0, *model.cuts, n])
    squares = max(model.fit.squares, np.finfo(float).tiny)
    return float(n * np.log(squares / n) + (3.0 * len(model.cuts) + model.slope) * np.log(n)
                 + np.sum(np.log(segment_lengths / n)))


def _add_significant_steps(values: np.ndarray, weights: np.ndarray, slope: bool, tests: int) -> ChangeModel:
    """Add significant steps to a mean, or to a drift."""
    n, chances = len(values), {}
    model = _fit_model(values, weights, slope, ())
    while len(model.cuts) < MAX_STEPS_PER_SERIES:
        places = _candidate_places(n, model.cuts)
        if not len(places) or model.fit.squares <= 0.0:
            break
        one = _add_best_step(model, values, weights)
        found = _new_step_chances(model, one, values, len(places) * tests)
        if max(found.values()) > SITE_FALSE_ALARM_RATE:
            # A change that is reversed later is two steps, and each alone explains little.
            two = _add_best_step(one, values, weights)
            found = _new_step_chances(model, two, values, len(places) ** 2 // 2 * tests)
            if two is one or max(found.values()) > SITE_FALSE_ALARM_RATE:
                break
            one = two
        model = one
        chances |= found
    model = replace(model, chances=tuple(chances[cut] for cut in model.cuts))
    return replace(model, slope_chance=min(model.fit.chance(1) * tests, 1.0)) if slope else model


def _add_best_step(model: ChangeModel, values: np.ndarray, weights: np.ndarray) -> ChangeModel:
    """The model with the step that explains most of the residuals; unchanged if no place is left."""
    places = _candidate_places(len(values), model.cuts)
    if not len(places):
        return model
    place = int(places[np.argmax(_explained_squares(model, values, weights, places))])
    return _fit_model(values, weights, model.slope, tuple(sorted((*model.cuts, place))))


def _new_step_chances(old: ChangeModel, new: ChangeModel, values: np.ndarray, test_count: int) -> dict[int, float]:
    """Place -> chance of each step that only the new model has, times the number of tests."""
    return {cut: min(new.fit.chance(new.first_step + i) * test_count, 1.0) if _step_lasts(new, values, i) else 1.0
            for i, cut in enumerate(new.cuts) if cut not in old.cuts}


def _step_lasts(model: ChangeModel, values: np.ndarray, i: int) -> bool:
    """Whether every recording after a step at the end has at least half of it: one bad recording is no step."""
    cut, size = model.cuts[i], model.fit.coefficients[model.first_step + i]
    if len(values) - cut >= MIN_RECORDINGS_BEFORE_STEP:
        return True
    expected = model_columns(len(values), model.slope, model.cuts)[cut:] @ model.fit.coefficients
    return bool(np.all((values[cut:] - expected) * np.sign(size) >= -MIN_LASTING_SHARE * abs(size)))


def _fit_model(values: np.ndarray, weights: np.ndarray, slope: bool, cuts: tuple[int, ...]) -> ChangeModel:
    """The model with given steps, without chances."""
    return ChangeModel(slope, cuts, (), 1.0, weighted_fit(values, weights, model_columns(len(values), slope, cuts)))


def model_columns(n: int, slope: bool, cuts: tuple[int, ...]) -> np.ndarray:
    """(n, k) the columns of a model, see `Model.fit`."""
    place = np.arange(n)
    return np.column_stack([np.ones(n), *([place - (n - 1) / 2.0] if slope else []),
                            *((place >= cut).astype(float) for cut in cuts)])


def _candidate_places(n: int, cuts: tuple[int, ...]) -> np.ndarray:
    """Places of one more step that leave every segment long enough."""
    ends = [0, *cuts, n]
    return np.concatenate([
        np.arange(a + MIN_RECORDINGS_BEFORE_STEP,
                  b - (MIN_RECORDINGS_AFTER_STEP if b == n else MIN_RECORDINGS_BEFORE_STEP) + 1)
        for a, b in pairwise(ends)])


def _explained_squares(model: ChangeModel, values: np.ndarray, weights: np.ndarray,
                       places: np.ndarray) -> np.ndarray:
    """The decrease of the sum of squared residuals by one more step at each place.

    A step explains with the part of its column that is orthogonal to the model. Cumulative sums from the end give
    this for all places at once.
    """
    root = np.sqrt(weights)
    q, _ = np.linalg.qr(model_columns(len(values), model.slope, model.cuts) * root[:, None])
    explained_sums = _sums_from_end(root * model.fit.weighted_residuals)
    basis_sums = _sums_from_end(root[:, None] * q)
    unexplained_weight = _sums_from_end(weights) - np.sum(basis_sums**2, axis=1)
    return (explained_sums**2 / np.maximum(unexplained_weight, np.finfo(float).eps * len(values)))[places]


def _sums_from_end(x: np.ndarray) -> np.ndarray:
    """Cumulative sums from each place to the end."""
    return np.cumsum(x[::-1], axis=0)[::-1]
