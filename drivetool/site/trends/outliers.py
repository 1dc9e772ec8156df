"""Recordings that lie far from all others of their series: mislabelled, of another machine, or gone wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.site.trends.change_points import FEWEST, LEVEL, Model, columns, model_of
from drivetool.site.trends.regression import fit
from drivetool.site.trends.weights import scatter_weights, trust, weights_of


@dataclass(frozen=True)
class Outlier:
    """A recording that is left out of its series.

    place     among all recordings of the series, from 0
    value     its own; expected: what the others say at its place, their steps and their drift included
    std       standard deviation of the others about that; ratio: distance over it
    chance    of a recording as far off, for all recordings and tests of the site
    """

    place: int
    value: float
    expected: float
    std: float
    ratio: float
    chance: float


def outliers_of(values: np.ndarray, variances: np.ndarray, tests: int, bar: float) -> tuple[Outlier, ...]:
    """The recordings of a series that the steps and the drift of the others do not explain, by their places.

    values     (n,) in the order of the recordings; variances (n,) of each by its stated std
    tests      how many hypotheses are tested in all: TESTS_PER_SERIES per series
    bar        how many standard deviations of the others a recording must be off
    returns    one Outlier each. The farthest recording is taken out first; then the steps and the drift of the
               others are looked for anew, as long as a recording is both that far and significant. The second
               recording of a step explains the first, so that neither is an outlier.
    source     Cook and Weisberg 1982 (externally studentised residuals, Bonferroni over the recordings)
    """
    kept, found = np.arange(len(values)), list[Outlier]()
    while len(kept) > FEWEST:
        farthest = _farthest(values[kept], variances[kept], tests)
        if farthest.ratio < bar or farthest.chance > LEVEL:
            break
        found.append(replace(farthest, place=int(kept[farthest.place])))
        kept = np.delete(kept, farthest.place)
    return tuple(sorted(found, key=lambda outlier: outlier.place))


def _farthest(values: np.ndarray, variances: np.ndarray, tests: int) -> Outlier:
    """The recording farthest from what the others say; how far that is where the stated std counts, and where not.

    The less of the two is taken: a std by few intervals of a record may be far too small by chance.
    """
    own = scatter_weights(values, variances)
    model = model_of(values, weights_of(values, variances), tests)
    off = np.abs(values - columns(len(values), model.slope, model.cuts) @ model.fit.coefficients)
    place = int(np.argmax(off * np.sqrt(own)))
    return min((_apart(values, each, model, place, tests) for each in (variances, np.zeros_like(variances))),
               key=lambda outlier: outlier.ratio)


def _apart(values: np.ndarray, variances: np.ndarray, model: Model, place: int, tests: int) -> Outlier:
    """A recording against the others, by a column of its own; its weight is as if it were no outlier."""
    own = scatter_weights(values, variances)
    alone = np.arange(len(values)) == place
    design = np.column_stack([columns(len(values), model.slope, model.cuts), alone])
    found = fit(values, np.where(alone, own, own * trust(values, own)), design)
    far, std = float(found.coefficients[-1]), found.std_left / float(np.sqrt(own[place]))
    ratio = abs(far) / std if std > 0.0 else 0.0  # all are zero
    return Outlier(place, float(values[place]), float(values[place]) - far, std, ratio,
                   min(found.chance(-1) * len(values) * tests, 1.0))
