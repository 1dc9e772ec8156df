"""How a parameter varies from recording to recording, and what that adds to its interval.

One machine on another day is not quite the same. What all recordings together say is then the mean of what each
says, and as uncertain as their scatter makes it, however quiet each of them is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import Finding
from drivetool.identify.estimate import COLLINEAR, Covariance, Parameter
from drivetool.identify.laws import sandwich, scores_of, sized
from drivetool.identify.noise import fit_innovations, fit_ratio
from drivetool.identify.outcome.scatter import half_width, heterogeneity, restricted
from drivetool.identify.problem import Point, solve
from drivetool.identify.setup import Outcome
from drivetool.identify.starts import AT_ONCE
from drivetool.progress import counted

TOLD = 0.999  # of a change of a parameter, that a recording by itself must give back
NEAR = 12  # rounds of a fit to one recording, which begins near its end
BY_CHANCE = 0.01  # of fits of a machine that does not vary, in which a scatter is spoken of


@dataclass(frozen=True)
class Told:
    """What one recording says of the k free parameters, beside what all say together.

    change  (k,) by which it would move them
    share   (k, k) of such a change in the estimate of all
    noise   (k,) variance of the change by the noise within the recording
    within  (k, k) what that noise adds to the covariance of the estimate of all
    tells   (k,) whether it tells a parameter by itself
    """

    change: np.ndarray
    share: np.ndarray
    noise: np.ndarray
    within: np.ndarray
    tells: np.ndarray


@dataclass(frozen=True)
class Repeats:
    """How k parameters vary between recordings.

    scatter  (k,) standard deviation from recording to recording; NaN where fewer than two tell the parameter
    within   (k, k) covariance of the estimate by the noise within the recordings; between: by what varies
    count    (k,) recordings that tell the parameter, by their weight
    p        (k,) chance that noise alone scatters so
    """

    scatter: np.ndarray
    within: np.ndarray
    between: np.ndarray
    count: np.ndarray
    p: np.ndarray


def repeats_of(told: Sequence[Told], line: np.ndarray | None = None) -> Repeats | None:
    """The scatter between recordings; None with fewer than two of them.

    line    (k, n) from the n parameters of the fit to the k that are reported, the first of them; None: all
    source  Patterson and Thompson 1971, restricted likelihood
    """
    if len(told) < 2:
        return None
    changes, noise = (np.array(v) for v in zip(*((t.change, t.noise) for t in told), strict=True))
    known = np.array([t.tells for t in told]) & np.isfinite(changes) & np.isfinite(noise) & (noise > 0.0)
    n = changes.shape[1]
    variances, counts, chances = np.full(n, np.nan), np.zeros(n), np.ones(n)
    for j in range(n):
        some = known[:, j]
        if np.count_nonzero(some) > 1:
            y, s2 = changes[some, j], noise[some, j]
            variances[j] = restricted(y, s2)
            weight = 1.0 / (variances[j] + s2)
            counts[j], chances[j] = weight.sum() ** 2 / np.sum(weight**2), heterogeneity(y, s2)
    scatter = np.diag(np.where(np.isfinite(variances), variances, 0.0))
    within, between = sum(t.within for t in told), sum(t.share @ scatter @ t.share.T for t in told)
    line = np.eye(n) if line is None else line
    k = len(line)
    own = np.sqrt(np.where(np.isfinite(variances[:k]), np.diag(line @ scatter @ line.T), np.nan))
    return Repeats(own, line @ within @ line.T, line @ between @ line.T, counts[:k], chances[:k])


def told_by_each(outcome: Outcome) -> list[Told]:
    """What each recording of a fit says by itself, fitted from where all of them together lead."""
    numbers = list(dict.fromkeys(t.record for t in outcome.problem.traces))
    if len(numbers) < 2:
        return []
    parts = [_of_record(outcome, number) for number in numbers]
    with ThreadPoolExecutor(AT_ONCE) as pool:
        alone = list(counted("recordings", pool.map(_alone, parts), len(parts)))
    joint, own = ([s for p in each if (s := scores_of(p)) is not None] for each in (parts, alone))
    if min(len(joint), len(own)) < len(parts):
        return []
    whole = replace(joint[0], each=sum(s.each for s in joint)).inverse
    found = []
    for a, j, s in zip(alone, joint, own, strict=True):
        inverse = s.inverse
        plain, by_blocks = s.variance * inverse, sandwich(s.influence)
        noise = sized(plain, np.sqrt(np.maximum(np.diag(plain), np.diag(by_blocks))))
        share, change = whole @ j.matrix, a.solution.point.values - outcome.solution.point.values
        found.append(Told(change, share, np.diag(noise), share @ noise @ share.T, tells(s.matrix, inverse)))
    return found


def _of_record(outcome: Outcome, number: int) -> Outcome:
    """The outcome over one recording, at the same values."""
    problem, point = outcome.problem, outcome.solution.point
    mine = [i for i, t in enumerate(problem.traces) if t.record == number]
    part = replace(problem, traces=tuple(problem.traces[i] for i in mine),
                   anchored=problem.anchored if mine[0] == 0 else ())
    here = Point(point.values, tuple(point.starts[i] for i in mine))
    return replace(outcome, problem=part, solution=replace(outcome.solution, point=here))


def _alone(part: Outcome) -> Outcome:
    """The fit to one recording. The noise is that of this recording: what varies is none."""
    problem, point = part.problem, part.solution.point
    if part.fit is None:
        return replace(part, solution=solve(problem, point, relative=1e-7, most=NEAR))
    white = fit_ratio(problem, point, replace(part.fit.noise, memory=None, slow=None))
    fit = fit_innovations(problem, point, white, arrived=True, most=NEAR)
    return replace(part, solution=fit.solution, fit=fit)


def tells(matrix: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """(k,) whether a recording tells a parameter by itself, and not by its noise alone apart from the others.

    matrix  (k, k) from a change to what the recording sees of it; inverse: back
    """
    inflation = np.diag(inverse) * np.diag(matrix)
    return (np.diag(inverse @ matrix) > TOLD) & (inflation < COLLINEAR)


def with_scatter(lines: Sequence[Parameter], covariance: Covariance | None, names: Sequence[str],
                 repeats: Repeats | None, drive: Drive,
                 ) -> tuple[tuple[Parameter, ...], Covariance | None, tuple[Finding, ...]]:
    """The lines and their covariance with what varies between recordings, and what to say of it.

    names   of the k parameters of `repeats`
    """
    if repeats is None:
        return tuple(lines), covariance, ()
    found, added, said = [], {}, {}
    for p in lines:
        j = names.index(p.name) if p.name in names else -1
        if j < 0 or p.std is None or not np.isfinite(repeats.scatter[j]):
            found.append(p)
            continue
        noise = p.std if p.std_noise is None else p.std_noise
        # What blocks of the recordings show of it the noise has in it already.
        more = float(np.sqrt(max(repeats.within[j, j] + repeats.between[j, j] - noise**2, 0.0)
                             if repeats.between[j, j] > 0.0 else 0.0))
        std = float(np.hypot(p.std, more))
        far = half_width(std, float(np.sqrt(repeats.between[j, j])), float(repeats.count[j]))
        low, high = drive.quantity(p.name).bounds
        added[p.name] = more
        found.append(replace(p, std=std, ci95=(max(p.value - far, low), min(p.value + far, high)), std_between=more,
                             repeatability=float(repeats.scatter[j])))
        if repeats.p[j] < BY_CHANCE / len(names):
            said[p.name] = f"{p.name} by {repeats.scatter[j]:.2g} {p.unit}".rstrip(), float(repeats.scatter[j])
    if covariance is not None:
        extra = np.array([added.get(n, 0.0) for n in covariance.names])
        covariance = replace(covariance, matrix=covariance.matrix + np.diag(extra**2))
    return tuple(found), covariance, (_scatter(said),) if said else ()


def _scatter(said: Mapping[str, tuple[str, float]]) -> Finding:
    return Finding(
        "note", "records-scatter",
        f"From recording to recording varies {', '.join(text for text, _ in said.values())}, as a standard "
        "deviation: more than the noise within them explains. The intervals hold for the machine and have it in "
        "them.", {name: value for name, (_, value) in said.items()},
        "State what was changed on purpose with --record; more recordings tell the scatter better.")
