"""Causes judged on samples that they were not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.causes import FITTED
from drivetool.check.fit import (
    Masks,
    Model,
    everything,
    few_steps,
    fit,
    judge,
    likeliest_noise,
    losses,
    over,
    spread,
    unlikely,
)
from drivetool.check.heldout.allowance import allowed
from drivetool.check.heldout.folds import blocks_of
from drivetool.check.heldout.samples import Samples, Split
from drivetool.identify.noise import filtered
from drivetool.identify.problem import Point
from drivetool.identify.setup import first_states, problem_of

ONE_OFF = tuple(suffix for cause in FITTED for suffix in cause.located)
SEARCHED = tuple(suffix for cause in FITTED for suffix in cause.searched)
LOOKS = 1000  # instants, or orders of a ripple, that a record can tell apart, about
INEXACT = 0.03  # of what the causes before gained, that an inexact law of theirs may leave
ALONE = 0.75  # of what a cause gains, that may lie in one block
SURELY = 2.0  # standard errors of a gain on data held out, or times what blocks lose by it that the others gain
LITTLE = 4.0  # log likelihood that they must gain, whatever none of them loses
BAD = 20.0  # log likelihood that a block loses, from which what is not known of the parameters is allowed for
REFIT = 6  # rounds of a fit to some samples, from that to all of them
STEPS = 8  # of the start state of a record held out


@dataclass(frozen=True)
class Score:
    """What a cause is worth on data held out.

    gains     (blocks,) log likelihood per block over the base fitted to the same samples
    evidence  per fold: log likelihood ratio against the best that the base can do on the test samples
    training  per fold: -log likelihood of the training samples
    trained   per fold: the model fitted to the training samples
    lead      log likelihood over the likeliest base on the samples that both were fitted to
    further   parameters that the cause adds
    """

    model: Model
    gains: np.ndarray
    evidence: tuple[float, ...]
    training: tuple[float, ...]
    trained: tuple[Model, ...]
    lead: float = 0.0
    further: int = 1

    @property
    def gain(self) -> float:
        """Sum over the blocks."""
        return float(self.gains.sum())

    @property
    def gain_std(self) -> float:
        """Standard error of the sum, from the scatter of the blocks."""
        return float(np.sqrt(len(self.gains)) * np.std(self.gains, ddof=1)) if len(self.gains) > 1 else np.inf

    @property
    def sure(self) -> bool:
        """Whether blocks tell that there is a gain by two standard errors, or agree on it without the best of them.

        A law shows where the motion asks for it: that one block gains far more than the others scatters, but is no
        doubt. A block that loses is.
        """
        rest = np.sort(self.gains)[:-1]
        # The standard error of the sum by one half of the scatter only, of which blocks that gain say nothing.
        lost = np.sqrt(2.0 * np.sum(np.minimum(rest, 0.0) ** 2))
        return bool(self.gain >= SURELY * self.gain_std or rest.sum() > max(SURELY * lost, LITTLE))


@dataclass(frozen=True)
class Fold:
    """Training and test samples, and what the base makes of them.

    again    the test samples and what start states need
    trained  the base fitted to the training samples, over all records; best: least -log likelihood of the test
             samples that the base reaches when it is fitted to them, its noise included
    """

    train: Masks
    test: Masks
    again: Masks
    trained: Model
    best: float


def folds_of(base: Model, split: Split) -> tuple[Fold, ...]:
    """The folds with what the base makes of them; base: fitted to all training samples."""
    def fold(its: Samples) -> Fold:
        trained = trained_on(base, split, its)
        keep = [i for i, mask in enumerate(its.test) if mask.any()] if split.held_out else range(len(its.test))
        masks = [its.again[i] for i in keep]
        own = fit(likeliest_noise(over(trained, keep), masks), masks, most=REFIT)
        return Fold(*its, trained, judge(own.problem, own.point, own.noise, [its.test[i] for i in keep]))

    with ThreadPoolExecutor(len(split.folds)) as pool:
        return tuple(pool.map(fold, split.folds))


def trained_on(model: Model, split: Split, its: Samples) -> Model:
    """A model over all records as the training samples of a fold have it; model: fitted to those of all folds.

    Of records that are held out the start states alone are found, each from its beginning. The noise is that of
    all training samples.
    """
    if split.held_out:
        return extended(model, split)
    return fit(located(model), its.train, most=REFIT, renewed=False)


def extended(model: Model, split: Split) -> Model:
    """The model over all records; the start states of those held out as their beginnings tell them."""
    if not split.held_out:
        return model
    task = replace(model.task, experiments=split.experiments)
    whole = replace(model.problem, traces=split.traces)
    drive, starts = model.fitted.drive, list(model.point.starts)
    for trace, head in zip(split.traces[split.fitted:], split.heads, strict=True):
        short = replace(trace, inputs=trace.inputs[:head], outputs=trace.outputs[:head])
        alone = problem_of(drive, (), task.roles, (short,))
        start = first_states(drive, task.roles, (trace,), task.free)
        told = few_steps(replace(model, problem=alone, point=Point(np.empty(0), start)), everything(alone), STEPS)
        starts += told.point.starts
    return replace(model, task=task, problem=whole, point=Point(model.point.values, tuple(starts)))


def located(model: Model) -> Model:
    """The model with the instant of a one-off event held.

    An event happens once, and so does a warm-up: training samples that lie apart from it cannot say when, or
    how long it took, so that is found in the whole record.
    """
    names = [n for n in model.task.free if n.endswith(ONE_OFF)]
    if not names:
        return model
    task = replace(model.fitted, free=tuple(n for n in model.task.free if n not in names))
    problem = problem_of(task.drive, task.free, task.roles, model.problem.traces)
    keep = [j for j, n in enumerate(model.task.free) if n not in names]
    point = Point(model.point.values[keep], model.point.starts)
    return Model(model.code, task, problem, point, model.noise, model.value)


def price_of(model: Model, base: Model) -> float:
    """Log of how many values of its searched parameters the whole record was looked at for, zero without any.

    A fit to the training samples begins at the best of them, and stays at that peak: so chance in the
    test samples has had a say in it, which is taken off.
    """
    new = [n for n in model.task.free if n not in base.task.free]
    return float(np.log(LOOKS)) * sum(n.endswith(SEARCHED) for n in new)


def score(model: Model, base: Model, folds: Sequence[Fold], split: Split) -> Score:
    """Fit a cause to the training samples of every fold and judge it on the test samples.

    base  that lacks it; folds: of that
    """
    gains, evidence, training, trained = [], [], [], []
    price, lead = price_of(model, base), base.value - model.value
    for fold, its in zip(folds, split.folds, strict=True):
        own, value = trained_on(model, split, its), 0.0
        for block, mine, theirs in _blocks_of(own, fold.trained, fold):
            if np.isfinite(mine) and theirs - mine < -BAD:
                mine = allowed(own, fold.train, block, mine)
            gains.append(theirs - mine)
            value += mine
        evidence.append(fold.best - value - price if np.isfinite(value) else -np.inf)
        training.append(own.value)
        trained.append(own)
    return Score(model, np.nan_to_num(np.array(gains), nan=-1e6, neginf=-1e6), tuple(evidence), tuple(training),
                 tuple(trained), lead, len(model.task.free) - len(base.task.free))


def lead_in_blocks(one: Model, other: Model, fold: Fold) -> list[float]:
    """(blocks,) log likelihood of the test samples by one model over that by another, both trained in the fold.

    Where one fails badly, what is not known of its parameters is allowed for.
    """
    leads = []
    for block, mine, theirs in _blocks_of(one, other, fold):
        lead = theirs - mine
        if lead < -BAD:
            lead = theirs - allowed(one, fold.train, block, mine)
        elif lead > BAD:
            lead = allowed(other, fold.train, block, theirs) - mine
        leads.append(lead)
    return leads


def _blocks_of(one: Model, other: Model, fold: Fold) -> list[tuple[Masks, float, float]]:
    """The test samples of each block, and their -log likelihood by both models."""
    found = []
    losses_of = [predicted(m, fold) for m in (one, other)]
    for i, a, b in blocks_of(one.problem.traces):
        block = [np.zeros_like(m) for m in fold.test]
        block[i][a:b] = fold.test[i][a:b]
        if block[i].any():
            found.append((block, *(float(each[i][block[i]].sum()) for each in losses_of)))
    return found


def predicted(model: Model, fold: Fold) -> list[np.ndarray]:
    """Per trace (n,) -log likelihood of every sample, noise as the training samples had it."""
    with np.errstate(over="ignore", invalid="ignore"):
        passes = filtered(model.problem, model.point, model.noise, keep=False)
        return losses(passes, spread(passes, fold.train))


def evidence(scores: Sequence[Score]) -> float:
    """Natural log of the average over folds of the likelihood ratio of the cause that trained best.

    Choosing by the training samples costs nothing: in expectation the ratio is at most one for
    every choice, so above 1/a it is wrong in a share a of records at most (Wasserman, Ramdas,
    Balakrishnan 2020, Universal inference).
    """
    if not scores:
        return -np.inf
    ratios = []
    for k in range(len(scores[0].evidence)):
        best = min(scores, key=lambda s: s.training[k])
        ratios.append(best.evidence[k])
    top = max(ratios)
    return float(top + np.log(np.mean(np.exp(np.array(ratios) - top)))) if np.isfinite(top) else -np.inf


def surprise(one: Score, gained: float = 0.0) -> float:
    """Natural log of one over the share of records without any cause in which the search leads by as much.

    The lead on the samples that were fitted is chi-square there (Wilks 1938), and everything that was
    looked at counts (Bonferroni). It shows effects half as large as the ratio on data held out does,
    but only the latter is right whatever the base got wrong: so the data held out must agree, and
    the lead must stand out from what was `gained` before, of which no law is exact.
    """
    if one.gain < one.gain_std or one.lead < INEXACT * gained:
        return -np.inf
    return unlikely(one.lead, one.further)


def in_one_place(one: Score, base: Model) -> bool:
    """Whether one block has nearly all that a cause gains, though it is no event that happens once."""
    new = [n for n in one.model.task.free if n not in base.task.free]
    return not any(n.endswith(ONE_OFF) for n in new) and float(one.gains.max()) > ALONE * one.gain


def total_evidence(scores: Sequence[Score], gained: float = 0.0) -> float:
    """Natural log of the evidence for there being a cause at all, by either way."""
    return max([evidence(scores), *(surprise(s, gained) for s in scores)], default=-np.inf) - np.log(2.0)
