"""Backward and exchange pass: each cause is dropped, reduced to a special case, exchanged, or confirmed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.causes import CAUSES, FITTED, mistaken_for
from drivetool.check.fit import (
    FIT_ERRORS,
    MIN_TESTABLE_GAIN,
    Model,
    neg_log_p_corrected,
    refit_without,
    run_residual_tests,
)
from drivetool.check.heldout import score
from drivetool.check.outcome import Round
from drivetool.check.search.decision import TIE_GAIN_SHARE
from drivetool.check.search.heldout_test import free_runs_worse_beyond_scatter
from drivetool.check.search.result import Base, SelectedCauses, gain_between
from drivetool.check.search.search import Expansion, ForwardSelection, Node
from drivetool.quantity import quantity_of

REASSESSED_REASON = "fitted again together with the causes found after it"
MIN_LOOKALIKE_GAIN_SHARE = TIE_GAIN_SHARE  # of a cause's gain: a look-alike is a rival on the same terms as a tie
SAME_PLACE_TOLERANCE = 0.1  # relative. A choice: a ripple order or a step instant that differs more is another one


@dataclass(frozen=True)
class ReassessedCauses:
    """The causes of a node with the rivals of each, and the rounds as they are reported."""

    node: Node
    found: SelectedCauses
    rounds: tuple[Round, ...]


def run_exchange_pass(search: ForwardSelection, path: Sequence[Expansion]) -> ReassessedCauses:
    """The end of a path, each of its causes tested again together with those that were found after it."""
    last = path[-1].child or path[-1].node
    steps = {e.child.causes[-1]: e for e in path if e.child is not None}
    found = SelectedCauses(
        last.causes, {c: _open_rivals(c, e, last) for c, e in steps.items()},
        {c: e.decision.evidence for c, e in steps.items()}, last.added, last.gained,
        frozenset(s.model.code for e in steps.values() for s in e.scores if s.sure))
    reassessed = ReassessedCauses(last, found, tuple(e.round(n) for n, e in enumerate(path, 1)))
    for code in last.causes:
        if code == last.causes[-1] and reassessed.found.causes == last.causes:
            break  # it was found on top of exactly these causes
        try:
            reassessed = _reassess(search, reassessed, code, steps[code])
        except FIT_ERRORS:  # its rivals stay as they were
            continue
    return reassessed


def _open_rivals(code: str, step: Expansion, last: Node) -> tuple[str, ...]:
    """The rivals of a cause when it was found, without those that were selected since."""
    models = {s.model.code: s.model for s in step.scores}
    return tuple(r for r in step.decision.between
                 if r != code and not (r in last.causes and _same_place(r, models.get(r), last.model)))


def _same_place(code: str, tied: Model | None, found: Model) -> bool:
    """Whether a cause that tied is the one that was found later: a ripple of another order is not."""
    place = CAUSES[code].place
    if not place or tied is None:
        return True
    before, now = ([m.fitted.drive.values[n] for n in m.task.free if quantity_of(n) == place]
                   for m in (tied, found))
    return any(abs(one - other) <= SAME_PLACE_TOLERANCE * abs(one) for one in before for other in now)


def _reassess(search: ForwardSelection, reassessed: ReassessedCauses, code: str,
              step: Expansion) -> ReassessedCauses:
    """One cause tested again: without it, and against its rivals."""
    node, found = reassessed.node, reassessed.found
    names = found.added[code]
    first = search.root.model.task.drive
    less = refit_without(node.model, names, first, search.masks)
    budget = search.options.error_budget
    lead = less.value - node.model.value
    rest = Node(tuple(c for c in node.causes if c != code), less, (), {
        c: n for c, n in node.added.items() if c != code}, max(node.gained - lead, 0.0))
    if lead <= MIN_TESTABLE_GAIN * len(names) or neg_log_p_corrected(lead, len(names)) < np.log(1.0 / budget):
        return _after_elimination(search, reassessed, code, rest)
    simple = _as_special_case(search, reassessed, code, first)
    if simple is not None:
        return simple
    rivals = _possible_rivals(search, reassessed, code, step, less)
    if not rivals:
        return reassessed
    candidates = [c for c in FITTED if c.code in {code, *rivals}]
    again = search.expand(rest, budget, candidates, [replace(node.model, code=code)])
    if again.child is None:
        return reassessed
    best = again.child.causes[-1]
    consistent = found.sure | {s.model.code for s in again.scores if s.sure}
    if best != code and code not in again.decision.between and best in search.wanted:
        return _exchanged(reassessed, code, again, consistent)
    between = tuple(r for r in again.decision.between if r != code and r not in found.causes)
    gone = set(found.rivals.get(code, ())) - set(between)
    rounds = tuple(_round_without_rivals(one, code, gone) for one in reassessed.rounds)
    return replace(reassessed, found=replace(found, rivals={**found.rivals, code: between}, sure=consistent),
                   rounds=rounds)


def _possible_rivals(search: ForwardSelection, reassessed: ReassessedCauses, code: str, step: Expansion,
                     less: Model) -> set[str]:
    """What may explain the records as well beside the others: what tied with it, or is a look-alike that was close.

    The cause itself too, where held-out data hardly identified it: beside the others they may identify it well.
    """
    found = reassessed.found
    rivals = {r for r in found.rivals.get(code, ()) if r not in found.causes}
    gains = {line.code: line.gain or 0.0 for line in step.lines}
    if run_residual_tests(reassessed.node.model).total > 0.0:
        rivals |= {c for c in mistaken_for([code])
                   if gains.get(c, 0.0) > MIN_LOOKALIKE_GAIN_SHARE * gains.get(code, 0.0)}
    weakly_identified = code not in found.sure and not CAUSES[code].event
    return (rivals - {*found.causes}) | ({code} if weakly_identified else set())


def _after_elimination(search: ForwardSelection, reassessed: ReassessedCauses, code: str,
                      rest: Node) -> ReassessedCauses:
    """Without a cause that later ones have made needless, unless that worsens the free-run error."""
    base = search.base(search.root.model)
    trained = score(rest.model, search.root.model, base.folds, search.split).trained
    if free_runs_worse_beyond_scatter(gain_between(
            Base(reassessed.node.model, _with_trained(base, reassessed.node.trained)), trained, search.split)):
        return reassessed
    found = reassessed.found
    kept = tuple(c for c in found.causes if c != code)
    return replace(reassessed, node=replace(rest, trained=trained, gained=reassessed.node.gained), found=replace(
        found, causes=kept, evidence={c: v for c, v in found.evidence.items() if c != code},
        rivals={c: v for c, v in found.rivals.items() if c != code}))


def _with_trained(base: Base, trained: Sequence[Model]):
    return tuple(replace(f, trained=t) for f, t in zip(base.folds, trained, strict=True))


def _as_special_case(search: ForwardSelection, reassessed: ReassessedCauses, code: str,
                     first) -> ReassessedCauses | None:
    """With a special case in place of a law whose further parameters have become needless; None: they have not."""
    node, found = reassessed.node, reassessed.found
    names = found.added[code]
    for simple in (s for s in CAUSES[code].special if s in search.wanted and s not in found.causes):
        keep = tuple(n for n in names if CAUSES[simple].has(n))
        surplus = tuple(n for n in names if n not in keep)
        if not keep or not surplus:
            continue
        less = refit_without(node.model, surplus, first, search.masks)
        if less.value > node.model.value + MIN_TESTABLE_GAIN * len(surplus):
            continue
        base = search.base(search.root.model)
        trained = score(less, search.root.model, base.folds, search.split).trained
        return ReassessedCauses(
            Node(tuple(simple if c == code else c for c in node.causes), less, trained,
                 {(simple if c == code else c): (keep if c == code else n) for c, n in node.added.items()},
                 node.gained), _renamed(found, code, simple, keep),
            tuple(_round_of_special_case(one, code, simple) for one in reassessed.rounds))
    return None


def _renamed(found: SelectedCauses, code: str, name: str, added: Sequence[str]) -> SelectedCauses:
    """A cause under another code, which is no rival of the others."""
    def own(values):
        return {name if c == code else c: v for c, v in values.items()}

    rivals = {c: tuple(r for r in others if r != name) for c, others in own(found.rivals).items()}
    return replace(found, causes=tuple(name if c == code else c for c in found.causes), rivals=rivals,
                   evidence=own(found.evidence), added={**own(found.added), name: tuple(added)})


def _exchanged(reassessed: ReassessedCauses, code: str, again: Expansion,
               consistent: frozenset[str]) -> ReassessedCauses:
    """Another cause in place of one, together with those that were found after it."""
    child = again.child
    assert child is not None
    name = child.causes[-1]
    found = _renamed(reassessed.found, code, name, child.added[name])
    between = tuple(r for r in again.decision.between if r != name and r not in found.causes)
    found = replace(found, rivals={**found.rivals, name: between}, sure=consistent,
                    evidence={**found.evidence, name: again.decision.evidence})
    candidates = [c.replace(reason=c.reason or REASSESSED_REASON) for c in again.lines]
    seen = {c.code for c in candidates}
    rounds = tuple(one if one.cause != code else one.replace(
        cause=name, candidates=(*candidates, *(c for c in one.candidates if c.code not in seen)), gain=again.stage)
                   for one in reassessed.rounds)
    node = replace(child, causes=found.causes, added=found.added, gained=reassessed.node.gained)
    return ReassessedCauses(node, found, rounds)


def _round_of_special_case(one: Round, code: str, simple: str) -> Round:
    """A round whose cause was reduced to a special case."""
    if one.cause != code:
        return one
    return one.with_states({code: "worse", simple: "named"}).replace(cause=simple)


def _round_without_rivals(one: Round, code: str, gone: set[str]) -> Round:
    """The round of a cause without its former rivals; the cause is named where no rival is left."""
    if one.cause != code or not gone:
        return one
    tied = {c.code for c in one.candidates if c.state == "possible"}
    return one.with_states(dict.fromkeys(tied & gone, "worse") | (
        {code: "named"} if tied - gone == {code} else {}))
