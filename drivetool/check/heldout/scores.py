"""Cross-validation scores of causes, on samples that they were not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.causes import FITTED
from drivetool.check.fit import (
    Masks,
    Model,
    all_samples,
    fit,
    gauss_newton_iterations,
    masked_loss,
    neg_log_p_corrected,
    on_task,
    over_traces,
    sample_losses,
    sensor_variance,
    with_likeliest_noise,
)
from drivetool.check.heldout.folds import blocks_of
from drivetool.check.heldout.laplace_evidence import loss_with_uncertainty
from drivetool.check.heldout.samples import Samples, Split
from drivetool.identify.noise import filtered
from drivetool.identify.problem import Point
from drivetool.identify.setup import first_states, problem_of
from drivetool.quantity import quantity_of

EVENT_TIMES = tuple(suffix for cause in FITTED for suffix in cause.located)
SEARCHED_QUANTITIES = tuple(suffix for cause in FITTED for suffix in cause.searched)
SCANNED_VALUES = 1000  # instants, or orders of a ripple, that a record can distinguish, about: the price of a scan
# Of the gain of the causes before, that their inexact laws may still leave. A choice: laws are exact to a few
# per cent.
INEXACT_LAW_SHARE = 0.03
MAX_ONE_BLOCK_SHARE = 0.75  # of a cause's gain in one block. A choice: a law acts in several
# Standard errors of a held-out gain, or gain of the other blocks over the loss of those that lose: about 95 %.
GAIN_SIGNIFICANCE = 2.0
MIN_CONSISTENT_GAIN = 4.0  # log likelihood of all blocks but the best. A choice: e^4 = 55 to one
# Log likelihood that a block loses, from which parameter uncertainty is taken into account (a choice: smaller
# losses are the usual scatter, and the marginal likelihood costs a fit).
MAX_BLOCK_LOSS = 20.0
REFIT_ITERATIONS = 6  # a choice: of a fit to some samples, from that to all of them
START_STATE_STEPS = 8  # a choice: of the start state of a held-out record, with nothing else free


@dataclass(frozen=True)
class Score:
    """The gain of a cause on held-out data.

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
        """Whether the gain is significant by two standard errors, or the blocks agree on it without the best one.

        A law acts where the motion excites it: one block of far larger gain adds scatter, but no doubt. A block
        that loses does.
        """
        rest = np.sort(self.gains)[:-1]
        # The standard error of the sum from the losing half of the scatter only.
        lost = np.sqrt(2.0 * np.sum(np.minimum(rest, 0.0) ** 2))
        return bool(self.gain >= GAIN_SIGNIFICANCE * self.gain_std
                    or rest.sum() > max(GAIN_SIGNIFICANCE * lost, MIN_CONSISTENT_GAIN))


@dataclass(frozen=True)
class Fold(Samples):
    """Training and test samples, and the base fitted to each.

    trained  the base fitted to the training samples, over all records; best: least -log likelihood of the test
             samples that the base reaches when it is fitted to them, its noise included
    """

    trained: Model
    best: float


def folds_of(base: Model, split: Split) -> tuple[Fold, ...]:
    """The folds with the base fitted in each; base: fitted to all training samples."""
    def fold(samples: Samples) -> Fold:
        trained = train_on(base, split, samples)
        keep = ([i for i, mask in enumerate(samples.test) if mask.any()] if split.held_out
                else range(len(samples.test)))
        masks = [samples.again[i] for i in keep]
        own = fit(with_likeliest_noise(over_traces(trained, keep), masks), masks, max_iterations=REFIT_ITERATIONS)
        return Fold(samples.train, samples.test, samples.again, trained,
                    masked_loss(own.problem, own.point, own.noise, [samples.test[i] for i in keep]))

    with ThreadPoolExecutor(len(split.folds)) as pool:
        return tuple(pool.map(fold, split.folds))


def train_on(model: Model, split: Split, samples: Samples) -> Model:
    """A model over all records, fitted to the training samples of a fold; model: fitted to those of all folds.

    Of held-out records only the start states are fitted, each to its initial transient. The noise is that of all
    training samples.
    """
    if split.held_out:
        return over_all_records(model, split)
    return fit(with_event_time_held(model), samples.train, max_iterations=REFIT_ITERATIONS, refit_noise=False)


def over_all_records(model: Model, split: Split) -> Model:
    """The model over all records; start states of held-out records are fitted to their initial transients."""
    if not split.held_out:
        return model
    task = replace(model.task, experiments=split.experiments)
    whole = replace(model.problem, traces=split.traces)
    drive, starts = model.fitted.drive, list(model.point.starts)
    for trace, head in zip(split.traces[split.fitted:], split.heads, strict=True):
        short = replace(trace, inputs=trace.inputs[:head], outputs=trace.outputs[:head])
        problem = problem_of(drive, (), task.roles, (short,))
        start = first_states(drive, task.roles, (trace,), task.free)
        fitted = gauss_newton_iterations(replace(model, problem=problem, point=Point(np.empty(0), start)),
                                         all_samples(problem),
                                         START_STATE_STEPS)
        starts += fitted.point.starts
    return replace(model, task=task, problem=whole, point=Point(model.point.values, tuple(starts)))


def with_event_time_held(model: Model) -> Model:
    """The model with the instant of a one-off event held.

    An event happens once, and so does a warm-up: training samples far from it do not identify its time, or
    its duration, so these are found in the whole record.
    """
    names = [n for n in model.task.free if quantity_of(n) in EVENT_TIMES]
    if not names:
        return model
    return on_task(model, replace(model.fitted, free=tuple(n for n in model.task.free if n not in names)))


def log_scanned_values(model: Model, base: Model) -> float:
    """Log of the number of values at which a model's parameters were scanned over the whole record, zero without.

    A fit to the training samples starts at the best of them and stays at that optimum, which noise of the test
    samples helped to select: the price corrects this.
    """
    new = [n for n in model.task.free if n not in base.task.free]
    return float(np.log(SCANNED_VALUES)) * sum(quantity_of(n) in SEARCHED_QUANTITIES for n in new)


def score(model: Model, base: Model, folds: Sequence[Fold], split: Split) -> Score:
    """Fit a cause to the training samples of every fold and score it on the test samples.

    base  that lacks it; folds: of that
    """
    gains, evidence, training, trained = [], [], [], []
    price, lead = log_scanned_values(model, base), base.value - model.value
    for fold, samples in zip(folds, split.folds, strict=True):
        own, value = train_on(model, split, samples), 0.0
        for block, loss, base_loss in _blocks_of(own, fold.trained, fold):
            if np.isfinite(loss) and base_loss - loss < -MAX_BLOCK_LOSS:
                loss = loss_with_uncertainty(own, fold.train, block, loss)
            gains.append(base_loss - loss)
            value += loss
        evidence.append(fold.best - value - price if np.isfinite(value) else -np.inf)
        training.append(own.value)
        trained.append(own)
    return Score(model, np.nan_to_num(np.array(gains), nan=-1e6, neginf=-1e6), tuple(evidence), tuple(training),
                 tuple(trained), lead, len(model.task.free) - len(base.task.free))


def lead_in_blocks(one: Model, other: Model, fold: Fold) -> list[float]:
    """(blocks,) log likelihood of the test samples by one model over that by another, both trained in the fold.

    Where one fails badly, its parameter uncertainty is taken into account.
    """
    leads = []
    for block, loss, other_loss in _blocks_of(one, other, fold):
        lead = other_loss - loss
        if lead < -MAX_BLOCK_LOSS:
            lead = other_loss - loss_with_uncertainty(one, fold.train, block, loss)
        elif lead > MAX_BLOCK_LOSS:
            lead = loss_with_uncertainty(other, fold.train, block, other_loss) - loss
        leads.append(lead)
    return leads


def _blocks_of(one: Model, other: Model, fold: Fold) -> list[tuple[Masks, float, float]]:
    """The test samples of each block, and their -log likelihood by both models."""
    found = []
    losses_of = [predicted_losses(m, fold) for m in (one, other)]
    for i, a, b in blocks_of(one.problem.traces):
        block = [np.zeros_like(m) for m in fold.test]
        block[i][a:b] = fold.test[i][a:b]
        if block[i].any():
            found.append((block, *(float(each[i][block[i]].sum()) for each in losses_of)))
    return found


def predicted_losses(model: Model, fold: Fold) -> list[np.ndarray]:
    """Per trace (n,) -log likelihood of every sample, under the noise of the training samples."""
    with np.errstate(over="ignore", invalid="ignore"):
        passes = filtered(model.problem, model.point, model.noise, keep=False)
        return sample_losses(passes, sensor_variance(passes, fold.train))


def evidence_ratio(scores: Sequence[Score]) -> float:
    """Natural log of the average over folds of the likelihood ratio of the cause with the best training fit.

    Choosing by the training samples needs no correction: the expected ratio is at most one for
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


def training_evidence(one: Score, gained: float = 0.0) -> float:
    """-ln of the p-value of the lead on the training samples, corrected for the whole search.

    Twice the lead is chi-square without a cause (Wilks 1938), times the number of hypotheses searched (Bonferroni).
    It detects effects half as large as the held-out ratio does, but only the latter is valid for a wrong base.
    So the held-out data must agree, and the lead must exceed a share of what was `gained` before: no law is exact.
    """
    if one.gain < one.gain_std or one.lead < INEXACT_LAW_SHARE * gained:
        return -np.inf
    return neg_log_p_corrected(one.lead, one.further)


def gain_in_one_block(one: Score, base: Model) -> bool:
    """Whether one block has nearly all of a cause's gain, though the cause is no single event."""
    new = [n for n in one.model.task.free if n not in base.task.free]
    return not any(quantity_of(n) in EVENT_TIMES
                   for n in new) and float(one.gains.max()) > MAX_ONE_BLOCK_SHARE * one.gain


def total_evidence(scores: Sequence[Score], gained: float = 0.0) -> float:
    """Natural log of the evidence for any cause: the larger of held-out ratio and training significance."""
    return max([evidence_ratio(scores), *(training_evidence(s, gained) for s in scores)],
               default=-np.inf) - np.log(2.0)
