"""The search over sets of causes.

A node is a set of causes with the model that was fitted with them. From a node every cause is screened by what one
linear step promises; the most promising is fitted, then those that can still tie with it. What beats the best that
the node can do on samples held out becomes the next node. In the end each cause is asked again beside the others.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from drivetool.check.causes import CAUSES, FITTED, Cause, mistaken_for
from drivetool.check.fit import (
    BROKEN,
    TRIFLE,
    Model,
    everything,
    fit,
    heard,
    remainder,
    runs_worse,
    with_parts,
    without_them,
)
from drivetool.check.heldout import LOOKS, Score, Split, exact, folds_of, score
from drivetool.check.outcome import CandidateResult, DiagnoseOptions, Gain, Round
from drivetool.check.search.attempt import HALF, Screened, Tried, as_special_case, attempt, screen, sizeable
from drivetool.check.search.begin import most_promising, stand_at
from drivetool.check.search.decision import SURPLUS, Decision, decide
from drivetool.check.search.foretell import against
from drivetool.check.search.imitation import imitates
from drivetool.check.search.lines import lines_of
from drivetool.check.search.result import Base, fitted_to_all, gain_between
from drivetool.progress import counted

WORKERS = 2
SHORT, SHARE = 3, 0.25  # causes that are on the shortlist anyhow, and of the best promise, from which others are
FLOOR = 6.0  # log likelihood that must be promised, what was searched paid for, for a fit to be worth it
ATTAINED = 4.0  # times its promise that a full fit gains, at most: 95 % of a study
TIE = 20.0  # log likelihood by which a rival must be beaten to be none
JUDGED = 6  # causes that are judged on samples held out, the likeliest first
BETTER, BRIEF = 4.0, 3  # log likelihood by which a base must end likelier elsewhere, and rounds in which that shows
CHANCE = HALF  # of the best gain, below which a cause does not tie with it


@dataclass(frozen=True)
class Node:
    """A set of causes and what was fitted with them.

    causes   in the order found; added: cause -> names that it freed
    model    fitted to all training samples; trained: per fold, over all records
    gained   log likelihood on samples held out, over the base
    """

    causes: tuple[str, ...]
    model: Model
    trained: tuple[Model, ...]
    added: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    gained: float = 0.0


@dataclass(frozen=True)
class Expansion:
    """What came of a node: the causes tried on top of it, judged, and the next node if there is one."""

    node: Node
    tried: tuple[Tried, ...]
    scores: tuple[Score, ...]
    decision: Decision
    lines: tuple[CandidateResult, ...]
    child: Node | None = None
    stage: Gain | None = None

    @property
    def round(self) -> Round:
        """As it is reported."""
        return Round(self.child.causes[-1] if self.child else None, self.lines, self.stage)


class Search:
    """What stays the same in a search; it remembers folds by node.

    wanted    codes that may be named; possible: those that are not ruled out
    elsewhere the base from other values, where fits may start too
    """

    def __init__(self, root: Model, split: Split, wanted: Sequence[str], possible: Collection[str],
                 options: DiagnoseOptions, elsewhere: Sequence[Model] = ()):
        self.split, self.wanted, self.possible, self.options = split, frozenset(wanted), possible, options
        self.masks, self.elsewhere = everything(root.problem), tuple(elsewhere)
        special = {code for c in wanted for code in CAUSES[c].special}
        # A law that contains another one gains where the other is true: that is tried too, asked for or not.
        self.causes = [c for c in FITTED if c.code in {*wanted, *special}]
        self._folds: dict[int, tuple[Model, Base]] = {}
        self.root = Node((), root, self.base(root).trained)

    def base(self, model: Model) -> Base:
        """A model as the base of others, under the noise that is likeliest for it, with its folds."""
        known = self._folds.get(id(model))
        if known is None:
            own = heard(model, self.masks)
            known = self._folds[id(model)] = (model, Base(own, folds_of(own, self.split)))
        return known[1]

    def path(self, node: Node | None = None) -> tuple[list[Expansion], str]:
        """(node after node, until nothing more is found; what is found next but was not to be looked for).

        None where free runs of the base leave rounding alone. Each next cause has half the budget of the last one.
        """
        node, found, unasked = node or self.root, [], ""
        if not node.causes and exact(node.model):
            return [], ""
        for number in range(len(node.causes), self.options.rounds + 1):
            budget = self.options.error_budget * 0.5 ** (number + 1)
            one = self.expand(node, budget)
            better = self._bettered(node, one)
            if better is not None:
                if found:
                    found[-1] = replace(found[-1], child=better)
                elif not node.causes:
                    self.root = better
                node, one = better, self.expand(better, budget)
            if one.child is not None and one.child.causes[-1] not in self.wanted:
                unasked = one.child.causes[-1]
            if unasked or number == self.options.rounds:
                one = replace(one, child=None, stage=None)
            found.append(one)
            if one.child is None:
                break
            node = one.child
        return found, unasked

    def _bettered(self, node: Node, found: Expansion) -> Node | None:
        """The node from where the cause found has led its parameters, if it ends likelier there without the cause.

        A base stopped in another valley makes any cause that leads out of it look like a discovery. Where free runs
        are worse there, noise has taken the place of what the base has.
        """
        if found.child is None:
            return None
        best = found.child.model
        goal = min(node.model.value, self.base(node.model).model.value) - BETTER  # under its likeliest noise
        names = [n for n in best.task.free if n not in node.model.task.free]
        try:
            model = without_them(best, names, self.root.model.task.drive, self.masks, BRIEF)
            if not model.value < goal:
                return None
            model = replace(fit(model, self.masks), code=node.model.code)
            if runs_worse(model, node.model):
                return None
        except BROKEN:
            return None
        return replace(node, model=model, trained=self.base(model).trained)

    def expand(self, node: Node, budget: float, among: Iterable[Cause] = (),
               ends: Sequence[Model] = ()) -> Expansion:
        """Every cause on top of a node, judged by samples held out.

        among  the causes; none: all that are to be tried
        ends   of earlier fits, from which fits may start
        """
        asked = bool(among)
        among = list(among) or [c for c in self.causes if c.code not in node.causes]
        tried = self._tried(node, among, asked, ends)
        scores = self._judged(node, tried)
        decision = decide(scores, budget, node.gained, imitates)
        unseen = (mistaken_for(decision.between) & self.possible) - {c.code for c in among} - {*node.causes}
        if unseen:
            more = self._tried(node, [c for c in FITTED if c.code in unseen], True, ())
            scores = [*scores, *self._judged(node, more)]
            decision = decide(scores, budget, node.gained, imitates)
        decision, why = against(decision, scores, self.base(node.model), self.split, node.gained, budget,
                                self.wanted) if scores else (decision, {})
        lines = lines_of([t for t in tried if t.cause.code in self.wanted], scores, decision, node.model,
                         node.gained, why)
        found = Expansion(node, tuple(tried), tuple(scores), decision, lines)
        if decision.best is None:
            return found
        child = self._child(node, decision.best)
        before = fitted_to_all(node.model, self.split, self.base(node.model))
        return replace(found, child=child, stage=gain_between(before, child.trained, self.split, child.gained))

    def _tried(self, node: Node, among: Sequence[Cause], asked: bool, ends: Sequence[Model]) -> list[Tried]:
        """The causes on top of a node, those fitted that are worth it, the leader first."""
        stands = [stand_at(m) for m in (node.model, *(self.elsewhere if not node.causes else ()))]
        own = {c.code: [m for m in ends if m.code == c.code] for c in among}
        with ThreadPoolExecutor(WORKERS) as pool:
            first = [c for c in among if not c.costly]
            seen = list(counted(f"{len(node.causes) + 1}: causes looked at", pool.map(
                lambda c: screen(c, stands, self.masks), first), len(first)))
            short = _shortlist(seen) if not asked else [s for s in seen if s.begun]
            tried: dict[str, Tried] = {}
            for group in (short[:1], short[1:]):  # the leader by itself, then what may still tie
                gained = max((node.model.value - t.model.value for t in tried.values() if t.model and not t.absent),
                             default=0.0)
                going = [s for s in group if not tried or ATTAINED * s.promise > gained - TIE]
                goal = node.model.value - gained if tried else np.inf
                for t in pool.map(lambda s, goal=goal: attempt(s, node.model, self.masks, own[s.cause.code], goal),
                                  going):
                    tried[t.cause.code] = t
            late = [c for c in among if c.costly]
            if late and (asked or not self._explained(node, tried.values())):
                for s in (screen(c, stands, self.masks) for c in late):
                    seen.append(s)
                    if s.begun:
                        tried[s.cause.code] = attempt(s, node.model, self.masks, own[s.cause.code])
        self._special_cases(node, tried)
        return [tried.get(s.cause.code) or Tried(s.cause, None, s.smallest, s.reason, s.absent) for s in seen]

    def _explained(self, node: Node, tried: Iterable[Tried]) -> bool:
        """Whether the likeliest of some causes leaves nothing, or the causes of the node themselves."""
        best = min((t.model for t in tried if t.model and not t.absent), key=lambda m: m.value,
                   default=node.model if node.causes else None)
        return best is not None and remainder(best).total == 0.0

    def _special_cases(self, node: Node, tried: dict[str, Tried]) -> None:
        """Every cause no less likely than a law that contains it makes it."""
        for code, general in list(tried.items()):
            for simple in [s for s in CAUSES[code].special if s in tried]:
                tried[simple] = as_special_case(tried[simple], general, node.model, self.masks)

    def _judged(self, node: Node, tried: Sequence[Tried]) -> list[Score]:
        """Held-out scores of the causes that may be the best or tie with it, each under its likeliest noise.

        If samples held out speak against all of these, of the others too.
        """
        gains = {t.cause.code: node.model.value - t.model.value for t in tried if t.model and not t.absent}
        order = sorted((t for t in tried if gains.get(t.cause.code, 0.0) > TRIFLE),
                       key=lambda t: -gains[t.cause.code])[:JUDGED]
        if not order:
            return []
        base = self.base(node.model)
        near = [t for t in order if gains[t.cause.code] > CHANCE * gains[order[0].cause.code]]

        def one(t: Tried) -> Score | None:
            assert t.model is not None
            try:
                model = heard(t.model, self.masks)
                if model is not t.model and sizeable(replace(t, model=model), node.model).absent:
                    return None
                return score(model, base.model, base.folds, self.split)
            except BROKEN:
                return None

        found: list[Score] = []
        with ThreadPoolExecutor(WORKERS) as pool:
            for some in (near, order[len(near):]):
                if not any(s.gain > 0.0 for s in found):
                    found += [s for s in pool.map(one, some) if s is not None]
        return found

    def _child(self, node: Node, best: Score) -> Node:
        """The next node: the best cause, with all of its kind that is asked for and samples held out agree to."""
        model, gain, trained = best.model, best.gain, best.trained
        another = CAUSES[model.code].another
        while another is not None and (more := another(model, self.masks, most_promising)) is not None:
            known = score(more, self.base(node.model).model, self.base(node.model).folds, self.split)
            if known.gain < gain:
                break
            model, gain, trained = more, known.gain, known.trained
        # Across a gap, say, friction of the motor and of the load are no longer the same: in no fold either.
        parted = with_parts(model, self.masks)
        if parted is not model:
            known = score(parted, self.base(node.model).model, self.base(node.model).folds, self.split)
            model, gain, trained = parted, known.gain, known.trained
        added = tuple(n for n in model.task.free if n not in node.model.task.free)
        # A law takes the place of its special case that was found before.
        special = [c for c in node.causes if c in CAUSES[model.code].special]
        added = (*(n for c in special for n in node.added[c]), *added)
        kept = {c: n for c, n in node.added.items() if c not in special}
        return Node((*(c for c in node.causes if c not in special), model.code), model, trained,
                    {**kept, model.code: added}, node.gained + gain)


def _shortlist(seen: Sequence[Screened]) -> list[Screened]:
    """The causes that are worth a fit, the most promising first."""
    # What the whole record was looked at for costs the log of how many values that were.
    promise = {s.cause.code: s.promise for s in seen if s.begun}
    # A law that contains another one must promise more than that: else that is found first, and what it lacks next.
    paid = {code: p - bool(CAUSES[code].searched) * float(np.log(LOOKS)) for code, p in promise.items()
            if all(p > promise.get(simple, -np.inf) + SURPLUS for simple in CAUSES[code].special)}
    order = sorted((s for s in seen if paid.get(s.cause.code, 0.0) > FLOOR), key=lambda s: -paid[s.cause.code])
    best = paid[order[0].cause.code] if order else 0.0
    return [s for i, s in enumerate(order) if i < SHORT or paid[s.cause.code] > SHARE * best]
