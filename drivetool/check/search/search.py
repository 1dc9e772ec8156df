"""Forward selection over sets of causes.

A node is a set of causes with the model that was fitted with them. From a node every cause is screened by the
expected gain of one Gauss-Newton step. The best is fitted, then those that can still tie with it. The cause that
beats the node on held-out data (cross-validation) becomes the next node. An exchange pass ends the search.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from drivetool.check.causes import CAUSES, FITTED, Cause, mistaken_for
from drivetool.check.fit import (
    FIT_ERRORS,
    MIN_TESTABLE_GAIN,
    Model,
    all_samples,
    fit,
    free_runs_clearly_worse,
    reestimate_noise,
    refit_without,
    run_residual_tests,
    with_parts,
)
from drivetool.check.heldout import SCANNED_VALUES, Score, Split, exact_to_rounding, folds_of, score
from drivetool.check.outcome import CandidateResult, DiagnoseOptions, Gain, Round
from drivetool.check.search.candidate_fit import (
    MIN_GAIN_SHARE,
    CandidateFit,
    as_special_case,
    attempt,
    screen,
    screened_for_significance,
)
from drivetool.check.search.candidate_report import candidate_results
from drivetool.check.search.decision import CLEAR_LEAD, MIN_GAIN_PER_PARAMETER, Decision, decide
from drivetool.check.search.heldout_test import apply_heldout_test
from drivetool.check.search.prepared_start import best_prepared_start, reference_model
from drivetool.check.search.response_equivalence import responses_equivalent
from drivetool.check.search.result import Base, fitted_to_all, gain_between
from drivetool.progress import counted

WORKERS = 2  # a choice: threads, whatever the machine has
# Causes that are fitted in any case, and the share of the best expected gain from which others are. A full fit
# gains up to MAX_GAIN_RATIO = 4 times its expected gain: below a quarter it stays behind what the leader predicts.
MIN_SHORTLIST, SHORTLIST_GAIN_SHARE = 3, 0.25
# Log likelihood after the price of the scan. A choice: a full fit gains up to four times as much, the error budget
# requires several units anyhow.
MIN_EXPECTED_GAIN = 6.0
MAX_GAIN_RATIO = 4.0  # of a full fit over its expected gain: 95 % of a study stay below
MAX_CROSS_VALIDATED = 6  # a choice: each costs a fit per fold; the likeliest go first
# Log likelihood, as MIN_LEAD of the decision, and iterations after which the improvement shows: both a choice.
MIN_BASE_IMPROVEMENT, BASE_REFIT_ITERATIONS = 4.0, 3
RIVAL_GAIN_SHARE = MIN_GAIN_SHARE  # of the best gain, below which a cause does not tie with it


@dataclass(frozen=True)
class Node:
    """A set of causes and what was fitted with them.

    causes   in the order found; added: cause -> names that it freed
    model    fitted to all training samples; trained: per fold, over all records
    gained   log likelihood on held-out data, over the base
    """

    causes: tuple[str, ...]
    model: Model
    trained: tuple[Model, ...]
    added: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    gained: float = 0.0


@dataclass(frozen=True)
class Expansion:
    """The expansion of a node: the causes fitted on top of it, their scores, and the next node if there is one."""

    node: Node
    scores: tuple[Score, ...]
    decision: Decision
    lines: tuple[CandidateResult, ...]
    child: Node | None = None
    stage: Gain | None = None

    def round(self, number: int) -> Round:
        """As it is reported."""
        return Round(number, self.child.causes[-1] if self.child else None, candidates=self.lines, gain=self.stage)


class ForwardSelection:
    """The settings of one search; it caches the folds of each node.

    wanted             codes that may be named; possible: those that are not ruled out
    alternative_bases  the base from other values, where fits may start too
    """

    def __init__(self, root: Model, split: Split, wanted: Sequence[str], possible: Collection[str],
                 options: DiagnoseOptions, alternative_bases: Sequence[Model] = ()):
        self.split, self.wanted, self.possible, self.options = split, frozenset(wanted), possible, options
        self.masks, self.alternative_bases = all_samples(root.problem), tuple(alternative_bases)
        special = {code for c in wanted for code in CAUSES[c].special}
        # A general law gains where its special case is true: that is fitted too, requested or not.
        self.causes = [c for c in FITTED if c.code in {*wanted, *special}]
        self._folds: dict[int, tuple[Model, Base]] = {}
        self.root = Node((), root, self.base(root).trained)

    def base(self, model: Model) -> Base:
        """A model as the base of others, under the noise that is likeliest for it, with its folds."""
        known = self._folds.get(id(model))
        if known is None:
            own = reestimate_noise(model, self.masks)
            known = self._folds[id(model)] = (model, Base(own, folds_of(own, self.split)))
        return known[1]

    def path(self, node: Node | None = None) -> tuple[list[Expansion], str]:
        """(expansions until nothing more is found; a cause that is found next but was not requested).

        None where free runs of the base are exact to rounding. Each next cause has half the budget of the last one.
        """
        node, found, unrequested = node or self.root, [], ""
        if not node.causes and exact_to_rounding(node.model):
            return [], ""
        for number in range(len(node.causes), self.options.rounds + 1):
            budget = self.options.error_budget * 0.5 ** (number + 1)
            expansion = self.expand(node, budget)
            improved = self._improved_base(node, expansion)
            if improved is not None:
                if found:
                    found[-1] = replace(found[-1], child=improved)
                elif not node.causes:
                    self.root = improved
                node, expansion = improved, self.expand(improved, budget)
            if expansion.child is not None and expansion.child.causes[-1] not in self.wanted:
                unrequested = expansion.child.causes[-1]
            if unrequested or number == self.options.rounds:
                expansion = replace(expansion, child=None, stage=None)
            found.append(expansion)
            if expansion.child is None:
                break
            node = expansion.child
        return found, unrequested

    def _improved_base(self, node: Node, found: Expansion) -> Node | None:
        """The node refitted without the cause from the cause's estimate, if it ends likelier there.

        A base in a worse local optimum makes any cause look true that leads out of it. Where free runs become
        worse, noise has replaced a law of the base.
        """
        if found.child is None:
            return None
        best = found.child.model
        # The base under its likeliest noise.
        goal = min(node.model.value, self.base(node.model).model.value) - MIN_BASE_IMPROVEMENT
        names = [n for n in best.task.free if n not in node.model.task.free]
        try:
            model = refit_without(best, names, self.root.model.task.drive, self.masks, BASE_REFIT_ITERATIONS)
            if not model.value < goal:
                return None
            model = replace(fit(model, self.masks), code=node.model.code)
            if free_runs_clearly_worse(model, node.model):
                return None
        except FIT_ERRORS:
            return None
        return replace(node, model=model, trained=self.base(model).trained)

    def expand(self, node: Node, budget: float, among: Iterable[Cause] = (),
               ends: Sequence[Model] = ()) -> Expansion:
        """Every cause on top of a node, tested on held-out data.

        among  the causes; none: all that are to be fitted
        ends   of earlier fits, from which fits may start
        """
        requested = bool(among)
        among = list(among) or [c for c in self.causes if c.code not in node.causes]
        candidates = self._fit_candidates(node, among, requested, ends)
        scores = self._cross_validated(node, candidates)
        decision = decide(scores, budget, node.gained, responses_equivalent)
        lookalikes = (mistaken_for(decision.between) & self.possible) - {c.code for c in among} - {*node.causes}
        if lookalikes:
            more = self._fit_candidates(node, [c for c in FITTED if c.code in lookalikes], True, ())
            scores = [*scores, *self._cross_validated(node, more)]
            decision = decide(scores, budget, node.gained, responses_equivalent)
        decision, rejected = apply_heldout_test(decision, scores, self.base(node.model), self.split, node.gained,
                                                budget,
                                                self.wanted) if scores else (decision, {})
        lines = candidate_results([t for t in candidates if t.cause.code in self.wanted], scores, decision,
                                  node.model,
                                  node.gained, rejected)
        expansion = Expansion(node, tuple(scores), decision, lines)
        if decision.best is None:
            return expansion
        child = self._child(node, decision.best)
        before = fitted_to_all(node.model, self.split, self.base(node.model))
        return replace(expansion, child=child, stage=gain_between(before, child.trained, self.split, child.gained))

    def _fit_candidates(self, node: Node, among: Sequence[Cause], requested: bool,
                        ends: Sequence[Model]) -> list[CandidateFit]:
        """The causes on top of a node; those worth a fit are fitted, the leader first."""
        references = [reference_model(m)
                      for m in (node.model, *(self.alternative_bases if not node.causes else ()))]
        own = {c.code: [m for m in ends if m.code == c.code] for c in among}
        with ThreadPoolExecutor(WORKERS) as pool:
            first = [c for c in among if not c.costly]
            screened = list(counted(f"{len(node.causes) + 1}: causes screened", pool.map(
                lambda c: screen(c, references, self.masks), first), len(first)))
            short = _shortlist(screened) if not requested else [s for s in screened if s.prepared_starts]
            fitted: dict[str, CandidateFit] = {}
            for group in (short[:1], short[1:]):  # the leader by itself, then what may still tie
                gained = max((node.model.value - t.model.value for t in fitted.values()
                              if t.model and not t.absent), default=0.0)
                worth_fitting = [s for s in group
                                 if not fitted or MAX_GAIN_RATIO * s.expected_gain > gained - CLEAR_LEAD]
                goal = node.model.value - gained if fitted else np.inf
                for t in pool.map(lambda s, goal=goal: attempt(s, node.model, self.masks, own[s.cause.code], goal),
                                  worth_fitting):
                    fitted[t.cause.code] = t
            costly = [c for c in among if c.costly]
            if costly and (requested or not self._fully_explained(node, fitted.values())):
                for s in (screen(c, references, self.masks) for c in costly):
                    screened.append(s)
                    if s.prepared_starts:
                        fitted[s.cause.code] = attempt(s, node.model, self.masks, own[s.cause.code])
        self._special_cases(node, fitted)
        return [fitted.get(s.cause.code, s) for s in screened]

    def _fully_explained(self, node: Node, fitted: Iterable[CandidateFit]) -> bool:
        """Whether the likeliest of some causes, or the node itself, leaves residuals that noise explains."""
        best = min((t.model for t in fitted if t.model and not t.absent), key=lambda m: m.value,
                   default=node.model if node.causes else None)
        return best is not None and run_residual_tests(best).total == 0.0

    def _special_cases(self, node: Node, fitted: dict[str, CandidateFit]) -> None:
        """Refit every special case from the end of its general law."""
        for code, general in list(fitted.items()):
            for simple in [s for s in CAUSES[code].special if s in fitted]:
                fitted[simple] = as_special_case(fitted[simple], general, node.model, self.masks)

    def _cross_validated(self, node: Node, candidates: Sequence[CandidateFit]) -> list[Score]:
        """Held-out scores of the causes that may be the best or tie with it, each under its likeliest noise.

        If held-out data contradict all of these, the others are scored too.
        """
        gains = {t.cause.code: node.model.value - t.model.value for t in candidates if t.model and not t.absent}
        order = sorted((t for t in candidates if gains.get(t.cause.code, 0.0) > MIN_TESTABLE_GAIN),
                       key=lambda t: -gains[t.cause.code])[:MAX_CROSS_VALIDATED]
        if not order:
            return []
        base = self.base(node.model)
        near = [t for t in order if gains[t.cause.code] > RIVAL_GAIN_SHARE * gains[order[0].cause.code]]

        def one(t: CandidateFit) -> Score | None:
            assert t.model is not None
            try:
                model = reestimate_noise(t.model, self.masks)
                if model is not t.model and screened_for_significance(replace(t, model=model), node.model).absent:
                    return None
                return score(model, base.model, base.folds, self.split)
            except FIT_ERRORS:
                return None

        found: list[Score] = []
        with ThreadPoolExecutor(WORKERS) as pool:
            for some in (near, order[len(near):]):
                if not any(s.gain > 0.0 for s in found):
                    found += [s for s in pool.map(one, some) if s is not None]
        return found

    def _child(self, node: Node, best: Score) -> Node:
        """The next node: the best cause, with further instances of it that held-out data confirm."""
        model, gain, trained = best.model, best.gain, best.trained
        another = CAUSES[model.code].another
        while another is not None and (more := another(model, self.masks, best_prepared_start)) is not None:
            held_out_score = score(more, self.base(node.model).model, self.base(node.model).folds, self.split)
            if held_out_score.gain < gain:
                break
            model, gain, trained = more, held_out_score.gain, held_out_score.trained
        # Across a gap, say, friction of motor and load can be separated: then in every fold.
        split_friction = with_parts(model, self.masks)
        if split_friction is not model:
            held_out_score = score(
                split_friction, self.base(node.model).model, self.base(node.model).folds, self.split)
            model, gain, trained = split_friction, held_out_score.gain, held_out_score.trained
        added = tuple(n for n in model.task.free if n not in node.model.task.free)
        # A law takes the place of its special case that was found before.
        special = [c for c in node.causes if c in CAUSES[model.code].special]
        added = (*(n for c in special for n in node.added[c]), *added)
        kept = {c: n for c, n in node.added.items() if c not in special}
        return Node((*(c for c in node.causes if c not in special), model.code), model, trained,
                    {**kept, model.code: added}, node.gained + gain)


def _shortlist(screened: Sequence[CandidateFit]) -> list[CandidateFit]:
    """The causes that are worth a fit, the largest expected gain first."""
    # A scan over the whole record costs the log of its number of values.
    expected_gain = {s.cause.code: s.expected_gain for s in screened if s.prepared_starts}
    # A general law must beat its special case: else that is found first, and the rest in the next round.
    net_gain = {code: p - bool(CAUSES[code].searched) * float(np.log(SCANNED_VALUES))
                for code, p in expected_gain.items()
                if all(p > expected_gain.get(simple, -np.inf) + MIN_GAIN_PER_PARAMETER
                       for simple in CAUSES[code].special)}
    order = sorted((s for s in screened if net_gain.get(s.cause.code, 0.0) > MIN_EXPECTED_GAIN),
                   key=lambda s: -net_gain[s.cause.code])
    best = net_gain[order[0].cause.code] if order else 0.0
    return [s for i, s in enumerate(order)
            if i < MIN_SHORTLIST or net_gain[s.cause.code] > SHORTLIST_GAIN_SHARE * best]
