"""How a parameter varies from recording to recording, and what that adds to its interval.

A machine changes slightly from day to day. The joint estimate of all recordings is then the mean of their
estimates, and as uncertain as their scatter makes it, however low the noise within each is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import MAX_INFLATION, Covariance, Parameter
from drivetool.identify.laws import sandwich_covariance, scores_of, with_standard_deviations
from drivetool.identify.noise import fit_innovations, fit_ratio
from drivetool.identify.outcome.scatter import half_width, p_value_of_homogeneity, variance_between
from drivetool.identify.problem import Point, solve
from drivetool.identify.setup import Outcome
from drivetool.identify.starts import PARALLEL_STARTS
from drivetool.progress import counted

# Share of a parameter change that a recording by itself must reproduce: 1 but for rounding, if it is identifiable.
MIN_REPRODUCED_SHARE = 0.999
# Rounds of a fit to one recording. A choice: it starts near its optimum, so that few suffice
RECORDING_FIT_ROUNDS = 12
# Significance level: share of fits of a machine that does not vary with a finding on scatter
MACHINE_SCATTER_SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class RecordingEstimate:
    """The estimate of the k free parameters from one recording, relative to the joint estimate of all.

    change  (k,) its difference from the joint estimate
    share   (k, k) of such a change in the joint estimate
    noise   (k,) variance of the change by the noise within the recording
    within  (k, k) what that noise adds to the covariance of the joint estimate
    tells   (k,) whether a parameter is identifiable from it alone
    """

    change: np.ndarray
    share: np.ndarray
    noise: np.ndarray
    within: np.ndarray
    identifiable: np.ndarray


@dataclass(frozen=True)
class Repeatability:
    """How k parameters vary between recordings.

    scatter  (k,) standard deviation from recording to recording; NaN where fewer than two identify the parameter
    within   (k, k) covariance of the estimate by the noise within the recordings; between: by what varies
    count    (k,) recordings that identify the parameter, by their weight
    p        (k,) p-value: probability of such a scatter by noise alone
    """

    scatter: np.ndarray
    within: np.ndarray
    between: np.ndarray
    count: np.ndarray
    p: np.ndarray


def repeatability_of(estimates: Sequence[RecordingEstimate],
                     mapping: np.ndarray | None = None) -> Repeatability | None:
    """The scatter between recordings; None with fewer than two of them.

    line    (k, n) from the n parameters of the fit to the k that are reported, the first of them; None: all
    source  Patterson and Thompson 1971, restricted likelihood
    """
    if len(estimates) < 2:
        return None
    changes, noise = (np.array(v) for v in zip(*((t.change, t.noise) for t in estimates), strict=True))
    known = np.array([t.identifiable
                      for t in estimates]) & np.isfinite(changes) & np.isfinite(noise) & (noise > 0.0)
    n = changes.shape[1]
    variances, counts, chances = np.full(n, np.nan), np.zeros(n), np.ones(n)
    for j in range(n):
        some = known[:, j]
        if np.count_nonzero(some) > 1:
            y, s2 = changes[some, j], noise[some, j]
            variances[j] = variance_between(y, s2)
            weight = 1.0 / (variances[j] + s2)
            counts[j], chances[j] = weight.sum() ** 2 / np.sum(weight**2), p_value_of_homogeneity(y, s2)
    scatter = np.diag(np.where(np.isfinite(variances), variances, 0.0))
    within, between = sum(t.within for t in estimates), sum(t.share @ scatter @ t.share.T for t in estimates)
    mapping = np.eye(n) if mapping is None else mapping
    k = len(mapping)
    own = np.sqrt(np.where(np.isfinite(variances[:k]), np.diag(mapping @ scatter @ mapping.T), np.nan))
    return Repeatability(own, mapping @ within @ mapping.T, mapping @ between @ mapping.T, counts[:k], chances[:k])


def recording_estimates(outcome: Outcome) -> list[RecordingEstimate]:
    """The estimate of each recording of a fit by itself, started from the joint estimate."""
    numbers = list(dict.fromkeys(t.record for t in outcome.problem.traces))
    if len(numbers) < 2:
        return []
    parts = [_outcome_of_recording(outcome, number) for number in numbers]
    with ThreadPoolExecutor(PARALLEL_STARTS) as pool:
        alone = list(counted("recordings", pool.map(_fit_recording, parts), len(parts)))
    joint, own = ([s for p in each if (s := scores_of(p)) is not None] for each in (parts, alone))
    if min(len(joint), len(own)) < len(parts):
        return []
    whole = replace(joint[0], each=sum(s.each for s in joint)).inverse
    found = []
    for a, j, s in zip(alone, joint, own, strict=True):
        inverse = s.inverse
        plain, by_blocks = s.variance * inverse, sandwich_covariance(s.influence)
        noise = with_standard_deviations(plain, np.sqrt(np.maximum(np.diag(plain), np.diag(by_blocks))))
        share, change = whole @ j.matrix, a.solution.point.values - outcome.solution.point.values
        found.append(RecordingEstimate(change, share, np.diag(noise), share @ noise @ share.T,
                                       identifiable_alone(s.matrix, inverse)))
    return found


def _outcome_of_recording(outcome: Outcome, number: int) -> Outcome:
    """The outcome over one recording, at the same values."""
    problem, point = outcome.problem, outcome.solution.point
    mine = [i for i, t in enumerate(problem.traces) if t.record == number]
    part = replace(problem, traces=tuple(problem.traces[i] for i in mine),
                   anchored=problem.anchored if mine[0] == 0 else ())
    here = Point(point.values, tuple(point.starts[i] for i in mine))
    return replace(outcome, problem=part, solution=replace(outcome.solution, point=here))


def _fit_recording(part: Outcome) -> Outcome:
    """The fit to one recording, with the noise of this recording: variation between recordings is no noise."""
    problem, point = part.problem, part.solution.point
    if part.fit is None:
        return replace(part, solution=solve(problem, point, relative=1e-7, max_iterations=RECORDING_FIT_ROUNDS))
    white = fit_ratio(problem, point, replace(part.fit.noise, memory=None, slow=None))
    fit = fit_innovations(problem, point, white, near_optimum=True, max_rounds=RECORDING_FIT_ROUNDS)
    return replace(part, solution=fit.solution, fit=fit)


def identifiable_alone(matrix: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """(k,) whether a parameter is identifiable from a recording alone, and noise alone does not separate it.

    matrix  (k, k) information of the recording on a change; inverse: its inverse
    """
    inflation = np.diag(inverse) * np.diag(matrix)
    return (np.diag(inverse @ matrix) > MIN_REPRODUCED_SHARE) & (inflation < MAX_INFLATION)


def with_scatter(lines: Sequence[Parameter], covariance: Covariance | None, names: Sequence[str],
                 repeats: Repeatability | None, drive: Drive,
                 ) -> tuple[tuple[Parameter, ...], Covariance | None, tuple[Finding, ...]]:
    """The lines and their covariance with the variation between recordings, and the findings on it.

    names   of the k parameters of `repeats`
    """
    if repeats is None:
        return tuple(lines), covariance, ()
    found, added, reported = [], {}, {}
    for p in lines:
        j = names.index(p.name) if p.name in names else -1
        if j < 0 or p.std is None or not np.isfinite(repeats.scatter[j]):
            found.append(p)
            continue
        noise = p.std if p.std_noise is None else p.std_noise
        # The noise part already contains what the blocks of the recordings show of it.
        more = float(np.sqrt(max(repeats.within[j, j] + repeats.between[j, j] - noise**2, 0.0)
                             if repeats.between[j, j] > 0.0 else 0.0))
        std = float(np.hypot(p.std, more))
        half = half_width(std, float(np.sqrt(repeats.between[j, j])), float(repeats.count[j]))
        added[p.name] = more
        found.append(p.with_interval(std, drive.quantity(p.name).bounds, half, std_between=more,
                                     repeatability=float(repeats.scatter[j])))
        if repeats.p[j] < MACHINE_SCATTER_SIGNIFICANCE / len(names):
            reported[p.name] = f"{p.name} by {repeats.scatter[j]:.2g} {p.unit}".rstrip(), float(repeats.scatter[j])
    if covariance is not None:
        extra = np.array([added.get(n, 0.0) for n in covariance.names])
        covariance = replace(covariance, matrix=covariance.matrix + np.diag(extra**2))
    return tuple(found), covariance, (_scatter_finding(reported),) if reported else ()


def _scatter_finding(reported: Mapping[str, tuple[str, float]]) -> Finding:
    return Finding(
        "note", "records-scatter",
        f"The parameters vary between recordings (standard deviation): "
        f"{', '.join(text for text, _ in reported.values())}. "
        "This is more than the noise within them explains. The intervals hold for the machine and include this "
        "scatter.",
        {name: value for name, (_, value) in reported.items()},
        "State what was changed on purpose with --record; more recordings determine the scatter better.")
