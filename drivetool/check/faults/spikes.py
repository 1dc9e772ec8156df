"""Outliers: single wrong values of a sensor, found in the record and tested against a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from drivetool.check.fit import Model, resolution, sensor_std
from drivetool.finding import Finding
from drivetool.identify.noise import filtered
from drivetool.identify.setup import traces_of
from drivetool.logs import Experiment
from drivetool.logs.samples import STD_PER_MAD

Places = Mapping[str, Sequence[int]]  # role -> samples of a record

SPIKE_MEDIAN_WINDOW = 5  # samples of the running median: five pass over two neighbouring spikes
MIN_SPIKE_STDS = 8.0  # robust standard deviations. A choice: Gaussian noise never reaches it
# Of a spike's second difference, from which a sample near it is curved too (a choice).
NEIGHBOUR_CURVATURE_SHARE = 0.4
MAX_QUANTISATION_STEPS = 1.5  # quantisation steps: a single step is no outlier
MAX_OUTLIER_SHARE = 0.02  # of the samples. A choice: more are no single outliers but a property of the channel
# Innovation over the height of a spike. A choice: a model that predicts a peak errs by less than half of it.
MIN_INNOVATION_SHARE = 0.6
OUTLIER_STDS = 5.7  # standard deviations of an innovation: 1 in 80 million samples by chance
# Standard deviations of the samples after a wrong one, and their number. A choice: a real motion goes on for
# several samples.
MAX_STDS_AFTER, SAMPLES_AFTER = 4.0, 3
NO_PLACES: Places = MappingProxyType({})
OUTPUTS = ("motor_speed", "load_speed", "motor_angle", "load_angle", "shaft_torque")


def without_outliers(e: Experiment, spared: Places = NO_PLACES) -> tuple[Experiment, list[Finding]]:
    """(the record with its outliers as missing values, a finding per channel that had any).

    spared  samples that look like outliers and are none
    """
    signals, findings = dict(e.signals), []
    for role in OUTPUTS:
        if role not in signals:
            continue
        at, size, sigma = spikes(signals[role])
        stays = ~np.isin(at, spared.get(role, ()))
        at, size = at[stays], size[stays]
        if not len(at) or len(at) > MAX_OUTLIER_SHARE * e.size:
            continue
        values = signals[role].copy()
        values[at] = np.nan
        signals[role] = values
        findings.append(_outlier_finding(
            e, role, at, (float(size.max()), float(sigma)), "lie far from their neighbours"))
    return replace(e, signals=signals), findings


def _outlier_finding(e: Experiment, role: str, at: np.ndarray, sizes: tuple[float, float], what: str) -> Finding:
    """The finding of outliers; sizes: of the largest, and the noise around them."""
    largest, noise = sizes
    return Finding("warning", "outliers",
                   f"{e.name}: {len(at)} single samples of the {role.replace('_', ' ')} {what}; they are left out.",
                   {"count": len(at), "largest": largest, "first_time": float(at[0] * e.step), "noise_std": noise},
                   "Check the sensor's cable and connector.")


def spikes(y: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(indices, sizes, robust std) of single samples that stand out from a running median.

    A fast motion within a window is not a spike: the difference to the median of the neighbours is compared with
    its local median.
    """
    from scipy.ndimage import median_filter

    good = np.isfinite(y)
    if good.sum() < 10 * SPIKE_MEDIAN_WINDOW:
        return np.zeros(0, int), np.zeros(0), 1.0
    filled = np.interp(np.arange(len(y)), np.flatnonzero(good), y[good])
    d = np.abs(filled - median_filter(filled, SPIKE_MEDIAN_WINDOW, mode="nearest"))
    sigma = STD_PER_MAD * float(np.median(d[good]))  # interpolated samples have no noise
    local_scale = STD_PER_MAD * median_filter(d, 51, mode="nearest")
    d2 = np.abs(np.diff(filled, 2, prepend=filled[0], append=filled[-1]))
    # An oscillation is curved a few samples further on; a spike, even two, makes at most three of them curved.
    isolated = np.sum([np.roll(d2, k) > NEIGHBOUR_CURVATURE_SHARE * d2
                       for k in (-5, -4, -3, -2, 2, 3, 4, 5)], axis=0) <= 3
    smooth = STD_PER_MAD * float(np.median(d2[good]))
    if max(sigma, smooth) <= 0.0:
        return np.zeros(0, int), np.zeros(0), 1.0
    # A spike is one sample against both neighbours: a step of the motion is not.
    left, right = filled - np.roll(filled, 1), filled - np.roll(filled, -1)
    single = (left * right > 0.0) & (np.minimum(np.abs(left), np.abs(right)) > 0.6 * d)
    # Nor is a corner, a straight line on one side; two lines are tested, since one may begin in another spike.
    for side in (1, -1):
        near, past = np.roll(filled, side), [(np.roll(filled, k * side), k - 1) for k in (2, 3)]
        single &= np.max([np.abs(filled - near - (near - far) / k) for far, k in past], axis=0) > 0.6 * d
    # Nor is one quantisation step next to samples on one level.
    steps = MAX_QUANTISATION_STEPS * (resolution(y[good]) or 0.0)
    limit = np.maximum(MIN_SPIKE_STDS * np.maximum(np.maximum(local_scale, sigma), smooth / 2.0), steps)
    at = np.flatnonzero((d > limit) & single & isolated & good)
    at = at[(at > 0) & (at < len(y) - 1)]
    return at, d[at], max(sigma, smooth / 2.0)


def with_outliers_restored(mended: Sequence[Experiment], experiments: Sequence[Experiment]) -> tuple[Experiment,
                                                                                                     ...]:
    """The corrected records with their outliers restored, on the scale of the corrected channel."""
    found = []
    for m, e in zip(mended, experiments, strict=True):
        signals = dict(m.signals)
        for role in (r for r in OUTPUTS if r in signals):
            logged = e.signals[role]
            out = np.isfinite(logged) & ~np.isfinite(signals[role])
            if out.any():
                scale = np.nanmedian(signals[role][logged != 0.0] / logged[logged != 0.0])
                signals[role] = np.where(out, scale * logged, signals[role])
        found.append(replace(m, signals=signals))
    return tuple(found)


def expected_peaks(base: Model, whole: Sequence[Experiment], mended: Sequence[Experiment]) -> list[Places]:
    """Per experiment: samples left out as outliers that the model, fitted without them, predicts.

    base   fitted to the corrected records
    whole  with the suspected outliers; mended: without
    """
    roles, found = base.task.roles, [{} for _ in whole]
    problem = replace(base.problem, traces=traces_of(whole, roles))
    passes = filtered(problem, base.point, base.noise, keep=False)
    at = 0
    for e, m, places in zip(whole, mended, found, strict=True):
        for a, b in (s for s in e.segments if s[1] - s[0] >= 10):
            for j, role in enumerate(roles.outputs):
                out = np.flatnonzero(np.isfinite(e.signals[role][a:b]) & ~np.isfinite(m.signals[role][a:b]))
                y = e.signals[role][a:b]
                height = np.abs(y[out] - 0.5 * (y[out - 1] + y[out + 1]))
                surprise = np.abs(passes[at].innovations[out, j])
                places[role] = [*places.get(role, ()), *(a + out[surprise < MIN_INNOVATION_SHARE * height])]
            at += 1
    return found


def without_model_outliers(model: Model, experiments: Sequence[Experiment],
                      ) -> tuple[tuple[Experiment, ...], list[Finding]]:
    """(the records without single values that contradict a model which explains all the rest, findings).

    An outlier too small to differ from its neighbours may differ from its prediction. A real motion goes on: once
    a sample is left out, those after it would have large innovations as well. The first samples are not tested:
    the torque that still acts in them was not recorded.

    model  leaves white residuals over these experiments
    """
    found, at = [], 0
    errors, normalized = _normalized_innovations(model, model.problem.traces)
    dead_time = model.fitted.drive.value("converter.dead_time") / model.problem.traces[0].step
    marked = [(np.abs(z) > OUTLIER_STDS) & (np.arange(len(z)) >= SAMPLES_AFTER + dead_time)[:, None]
              for z in normalized]
    _, normalized_without = _normalized_innovations(model, tuple(replace(t, outputs=np.where(m, np.nan, t.outputs))
                                    for t, m in zip(model.problem.traces, marked, strict=True)))
    findings: list[Finding] = []
    for e in experiments:
        signals, wrong = dict(e.signals), {role: [] for role in model.task.roles.outputs}
        for a, _ in (s for s in e.segments if s[1] - s[0] >= 10):
            for j, role in enumerate(model.task.roles.outputs):
                for k in np.flatnonzero(marked[at][:, j]):
                    after = slice(k + 1, k + 1 + SAMPLES_AFTER)
                    calm = np.all(np.abs(np.nan_to_num(normalized_without[at][after, j])) < MAX_STDS_AFTER)
                    if k + SAMPLES_AFTER < len(normalized[at]) and calm and not marked[at][after, j].any():
                        wrong[role].append((a + k, abs(errors[at][k, j])))
            at += 1
        for role, places in wrong.items():
            if places and len(places) < MAX_OUTLIER_SHARE * e.size:
                k, size = (np.array(column) for column in zip(*places, strict=True))
                signals[role] = signals[role].copy()
                signals[role][k] = np.nan
                sizes = float(size.max()), sensor_std(model, model.task.roles.outputs.index(role))
                findings.append(_outlier_finding(
                    e, role, k, sizes, "deviate significantly from the one-step prediction"))
        found.append(replace(e, signals=signals))
    return tuple(found), findings


def _normalized_innovations(model: Model, traces: Sequence) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Per trace (n, ny): innovations, and the same over their standard deviations."""
    passes = filtered(replace(model.problem, traces=tuple(traces)), model.point, model.noise, keep=False)
    ratios = [f.innovations / np.sqrt(f.variance) for f in passes]
    scale = STD_PER_MAD * np.nanmedian(np.abs(np.concatenate(ratios)), axis=0)
    return [f.innovations for f in passes], [r / np.where(scale > 0.0, scale, np.inf) for r in ratios]
