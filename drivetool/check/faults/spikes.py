"""Single wrong values of a sensor: found in the record, and held against what a model says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from drivetool.check.fit import Model, resolution, sensor_std
from drivetool.errors import Finding
from drivetool.identify.noise import filtered
from drivetool.identify.setup import traces_of
from drivetool.logs import Experiment

Places = Mapping[str, Sequence[int]]  # role -> samples of a record

WINDOW = 5  # samples of the running median
SPIKE = 8.0  # robust standard deviations that no noise reaches
ALONE = 0.4  # of the second difference of a spike, from which a sample near it bends too
STEPS = 1.5  # steps of the logger, up to which a sample that stands out is none
RARE = 0.02  # share of samples beyond which spikes are not outliers any more
SURPRISE = 0.6  # of its height, by which a wrong value surprises the model
IMPOSSIBLE = 5.7  # standard deviations of a one-step error that a sample reaches by chance once in 80 million
CALM, AFTER = 4.0, 3  # standard deviations that the samples after a wrong one stay within, and how many of them
NONE: Places = MappingProxyType({})
OUTPUTS = ("motor_speed", "load_speed", "motor_angle", "load_angle", "shaft_torque")


def without_outliers(e: Experiment, spared: Places = NONE) -> tuple[Experiment, list[Finding]]:
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
        if not len(at) or len(at) > RARE * e.size:
            continue
        values = signals[role].copy()
        values[at] = np.nan
        signals[role] = values
        findings.append(_finding(e, role, at, (float(size.max()), float(sigma)), "lie far from their neighbours"))
    return replace(e, signals=signals), findings


def _finding(e: Experiment, role: str, at: np.ndarray, sizes: tuple[float, float], what: str) -> Finding:
    """What is said of outliers; sizes: of the largest, and the noise beside them."""
    largest, noise = sizes
    return Finding("warning", "outliers",
                   f"{e.name}: {len(at)} single samples of the {role.replace('_', ' ')} {what}; they are left out.",
                   {"count": len(at), "largest": largest, "first_time": float(at[0] * e.step), "noise_std": noise},
                   "Check the sensor's cable and connector.")


def spikes(y: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(indices, sizes, robust std) of single samples that stand out from a running median.

    What the signal itself does within a window is not a spike: the difference to the median of the
    neighbours is held against its usual size around there.
    """
    from scipy.ndimage import median_filter

    good = np.isfinite(y)
    if good.sum() < 10 * WINDOW:
        return np.zeros(0, int), np.zeros(0), 1.0
    filled = np.interp(np.arange(len(y)), np.flatnonzero(good), y[good])
    d = np.abs(filled - median_filter(filled, WINDOW, mode="nearest"))
    sigma = 1.4826 * float(np.median(d[good]))  # what is bridged has no noise
    usual = 1.4826 * median_filter(d, 51, mode="nearest")
    d2 = np.abs(np.diff(filled, 2, prepend=filled[0], append=filled[-1]))
    # What rings goes on bending a few samples further on; a spike, even two, bends at most three of them.
    alone = np.sum([np.roll(d2, k) > ALONE * d2 for k in (-5, -4, -3, -2, 2, 3, 4, 5)], axis=0) <= 3
    smooth = 1.4826 * float(np.median(d2[good]))
    if max(sigma, smooth) <= 0.0:
        return np.zeros(0, int), np.zeros(0), 1.0
    # A spike is one sample against both neighbours: a step of the motion is not.
    left, right = filled - np.roll(filled, 1), filled - np.roll(filled, -1)
    lone = (left * right > 0.0) & (np.minimum(np.abs(left), np.abs(right)) > 0.6 * d)
    # Nor is a corner, which goes on as it came from one side; two looks, since the line may begin in another spike.
    for side in (1, -1):
        near, past = np.roll(filled, side), [(np.roll(filled, k * side), k - 1) for k in (2, 3)]
        lone &= np.max([np.abs(filled - near - (near - far) / k) for far, k in past], axis=0) > 0.6 * d
    # Nor is one step of a logger beside samples that happen to lie on one level.
    steps = STEPS * (resolution(y[good]) or 0.0)
    limit = np.maximum(SPIKE * np.maximum(np.maximum(usual, sigma), smooth / 2.0), steps)
    at = np.flatnonzero((d > limit) & lone & alone & good)
    at = at[(at > 0) & (at < len(y) - 1)]
    return at, d[at], max(sigma, smooth / 2.0)


def put_back(mended: Sequence[Experiment], experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """The mended records with the values that were left out of them, on the scale that the channel has there."""
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
    """Per experiment: samples left out as outliers that the model, which did not see them, says are right.

    base   fitted to the mended records
    whole  with what looked like outliers, mended without
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
                places[role] = [*places.get(role, ()), *(a + out[surprise < SURPRISE * height])]
            at += 1
    return found


def without_surprises(model: Model, experiments: Sequence[Experiment],
                      ) -> tuple[tuple[Experiment, ...], list[Finding]]:
    """(the records without single values that a model which explains all the rest finds impossible, findings).

    What is too small to stand out from its neighbours stands out from what was to be expected. A motion that did
    happen goes on: the samples after it would surprise as much once it is left out. The first samples tell
    nothing: the torque that still acts in them was not recorded.

    model  leaves nothing but noise over these experiments
    """
    found, at = [], 0
    errors, first = _surprise(model, model.problem.traces)
    late = model.fitted.drive.value("converter.dead_time") / model.problem.traces[0].step
    marked = [(np.abs(z) > IMPOSSIBLE) & (np.arange(len(z)) >= AFTER + late)[:, None] for z in first]
    _, second = _surprise(model, tuple(replace(t, outputs=np.where(m, np.nan, t.outputs))
                                    for t, m in zip(model.problem.traces, marked, strict=True)))
    findings: list[Finding] = []
    for e in experiments:
        signals, wrong = dict(e.signals), {role: [] for role in model.task.roles.outputs}
        for a, _ in (s for s in e.segments if s[1] - s[0] >= 10):
            for j, role in enumerate(model.task.roles.outputs):
                for k in np.flatnonzero(marked[at][:, j]):
                    after = slice(k + 1, k + 1 + AFTER)
                    calm = np.all(np.abs(np.nan_to_num(second[at][after, j])) < CALM)
                    if k + AFTER < len(first[at]) and calm and not marked[at][after, j].any():
                        wrong[role].append((a + k, abs(errors[at][k, j])))
            at += 1
        for role, places in wrong.items():
            if places and len(places) < RARE * e.size:
                k, size = (np.array(column) for column in zip(*places, strict=True))
                signals[role] = signals[role].copy()
                signals[role][k] = np.nan
                sizes = float(size.max()), sensor_std(model, model.task.roles.outputs.index(role))
                findings.append(_finding(e, role, k, sizes, "cannot be what happened"))
        found.append(replace(e, signals=signals))
    return tuple(found), findings


def _surprise(model: Model, traces: Sequence) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Per trace (n, ny): one-step errors, and the same over their standard deviations."""
    passes = filtered(replace(model.problem, traces=tuple(traces)), model.point, model.noise, keep=False)
    ratios = [f.innovations / np.sqrt(f.variance) for f in passes]
    usual = 1.4826 * np.nanmedian(np.abs(np.concatenate(ratios)), axis=0)
    return [f.innovations for f in passes], [r / np.where(usual > 0.0, usual, np.inf) for r in ratios]
