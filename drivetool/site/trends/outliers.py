"""Outliers of a series: recordings that are mislabelled, of another machine, or faulty."""

from __future__ import annotations

import numpy as np

from drivetool.files.shapes import trend_shapes as shapes
from drivetool.site.trends.change_points import (
    MIN_SERIES_LENGTH,
    SITE_FALSE_ALARM_RATE,
    ChangeModel,
    model_columns,
    select_model,
)
from drivetool.site.trends.regression import weighted_fit
from drivetool.site.trends.series import Series
from drivetool.site.trends.weights import outlier_factors, robust_weights, scatter_weights


class Outlier(shapes.OutlierSection):
    """A recording that is left out of its series; place: among all recordings of the series, from 0."""

    place: int


def outliers_of(series: Series, tests: int, min_ratio: float) -> tuple[Outlier, ...]:
    """The recordings of a series that do not fit the steps and the drift of the others, by their places.

    series     of all recordings
    tests      how many hypotheses are tested in all: TESTS_PER_SERIES per series
    min_ratio  smallest deviation of an outlier, in standard deviations of the others
    returns    one Outlier each. The farthest recording is removed first; then the steps and the drift of the
               others are fitted again, as long as a recording is both that far and significant. The second
               recording of a step explains the first, so that neither is an outlier.
    source     Cook and Weisberg 1982 (externally studentised residuals, Bonferroni over the recordings)
    """
    values, variances = series.values, series.variances
    remaining, found = np.arange(len(values)), list[Outlier]()
    while len(remaining) > MIN_SERIES_LENGTH:
        farthest = _farthest_recording(values[remaining], variances[remaining], tests)
        if farthest.ratio < min_ratio or farthest.chance > SITE_FALSE_ALARM_RATE:
            break
        place = int(remaining[farthest.place])
        found.append(farthest.replace(place=place, recording=series.recordings[place]))
        remaining = np.delete(remaining, farthest.place)
    return tuple(sorted(found, key=lambda outlier: outlier.place))


def _farthest_recording(values: np.ndarray, variances: np.ndarray, tests: int) -> Outlier:
    """The recording with the largest deviation from the others, by its place; with and without the stated std.

    The smaller ratio of the two is taken: a std from few intervals of a record may be far too small by chance.
    """
    own_weights = scatter_weights(values, variances)
    model = select_model(values, robust_weights(values, variances), tests)
    residuals = np.abs(values - model_columns(len(values), model.slope, model.cuts) @ model.fit.coefficients)
    place = int(np.argmax(residuals * np.sqrt(own_weights)))
    return min((_outlier_against_others(values, each, model, place, tests)
                for each in (variances, np.zeros_like(variances))), key=lambda outlier: outlier.ratio)


def _outlier_against_others(values: np.ndarray, variances: np.ndarray, model: ChangeModel, place: int,
                            tests: int) -> Outlier:
    """The deviation of a recording, by a separate column; its weight is that of a recording without one."""
    own_weights = scatter_weights(values, variances)
    own_column = np.arange(len(values)) == place
    design = np.column_stack([model_columns(len(values), model.slope, model.cuts), own_column])
    found = weighted_fit(values, np.where(own_column, own_weights,
                                          own_weights * outlier_factors(values, own_weights)), design)
    deviation, std = float(found.coefficients[-1]), found.residual_std / float(np.sqrt(own_weights[place]))
    ratio = abs(deviation) / std if std > 0.0 else 0.0  # all are zero
    return Outlier("", float(values[place]), float(values[place]) - deviation, std, ratio,
                   min(found.chance(-1) * len(values) * tests, 1.0), place)
