"""Every cause asked again beside the others: needless, a special case, another one in its place, or as it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.causes import CAUSES, FITTED, mistaken_for
from drivetool.check.fit import BROKEN, TRIFLE, Model, remainder, unlikely, without_them
from drivetool.check.heldout import score
from drivetool.check.outcome import CandidateResult, Round
from drivetool.check.search.decision import SHARE
from drivetool.check.search.foretell import runs_worse
from drivetool.check.search.result import Base, Found, gain_between
from drivetool.check.search.search import Expansion, Node, Search

BESIDE = "asked again beside what was found after it"
CLOSE = SHARE  # of what a cause gained, from which a look-alike was close behind it
APART = 0.1  # relative difference from which a ripple is of another order, a step at another instant


@dataclass(frozen=True)
class Asked:
    """The causes of a node with what rivals each, and the rounds as they are to be told."""

    node: Node
    found: Found
    rounds: tuple[Round, ...]


def asked_beside(search: Search, path: Sequence[Expansion]) -> Asked:
    """The end of a path, each of its causes asked again beside those that were found after it."""
    last = path[-1].child or path[-1].node
    steps = {e.child.causes[-1]: e for e in path if e.child is not None}
    found = Found(
        last.causes, {c: _open(c, e, last) for c, e in steps.items()},
        {c: e.decision.evidence for c, e in steps.items()}, last.added, last.gained,
        frozenset(s.model.code for e in steps.values() for s in e.scores if s.sure))
    asked = Asked(last, found, tuple(e.round for e in path))
    for code in last.causes:
        if code == last.causes[-1] and asked.found.causes == last.causes:
            break  # it was asked beside the others as they are
        try:
            asked = _again(search, asked, code, steps[code])
        except BROKEN:  # then what was open of it stands
            continue
    return asked


def _open(code: str, step: Expansion, last: Node) -> tuple[str, ...]:
    """What explained the records as well as a cause when that was found, without what is there beside it by now."""
    models = {s.model.code: s.model for s in step.scores}
    return tuple(r for r in step.decision.between
                 if r != code and not (r in last.causes and _same(r, models.get(r), last.model)))


def _same(code: str, tied: Model | None, found: Model) -> bool:
    """Whether a cause that tied is the one that was found later: a ripple of another order is not."""
    place = CAUSES[code].place
    if not place or tied is None:
        return True
    before, now = ([m.fitted.drive.values[n] for n in m.task.free if n.endswith(place)] for m in (tied, found))
    return any(abs(one - other) <= APART * abs(one) for one in before for other in now)


def _again(search: Search, asked: Asked, code: str, step: Expansion) -> Asked:
    """One cause asked again."""
    node, found = asked.node, asked.found
    names = found.added[code]
    first = search.root.model.task.drive
    less = without_them(node.model, names, first, search.masks)
    budget = search.options.error_budget
    lead = less.value - node.model.value
    rest = Node(tuple(c for c in node.causes if c != code), less, (), {
        c: n for c, n in node.added.items() if c != code}, max(node.gained - lead, 0.0))
    if lead <= TRIFLE * len(names) or unlikely(lead, len(names)) < np.log(1.0 / budget):
        return _dropped(search, asked, code, rest)
    simple = _as_simple(search, asked, code, first)
    if simple is not None:
        return simple
    rivals = _rivals(search, asked, code, step, less)
    if not rivals:
        return asked
    among = [c for c in FITTED if c.code in {code, *rivals}]
    again = search.expand(rest, budget, among, [replace(node.model, code=code)])
    if again.child is None:
        return asked
    best = again.child.causes[-1]
    sure = found.sure | {s.model.code for s in again.scores if s.sure}
    if best != code and code not in again.decision.between and best in search.wanted:
        return _exchanged(asked, code, again, sure)
    between = tuple(r for r in again.decision.between if r != code and r not in found.causes)
    gone = set(found.rivals.get(code, ())) - set(between)
    rounds = tuple(_retold(one, code, gone) for one in asked.rounds)
    return replace(asked, found=replace(found, rivals={**found.rivals, code: between}, sure=sure), rounds=rounds)


def _rivals(search: Search, asked: Asked, code: str, step: Expansion, less: Model) -> set[str]:
    """What may explain the records as well beside the others: what tied with it, or is like it and was close.

    And it itself where samples held out hardly told it: beside the others they may tell it well.
    """
    found = asked.found
    rivals = {r for r in found.rivals.get(code, ()) if r not in found.causes}
    gains = {line.code: line.gain or 0.0 for line in step.lines}
    if remainder(asked.node.model).total > 0.0:
        rivals |= {c for c in mistaken_for([code]) if gains.get(c, 0.0) > CLOSE * gains.get(code, 0.0)}
    hardly = code not in found.sure and not CAUSES[code].event
    return (rivals - {*found.causes}) | ({code} if hardly else set())


def _dropped(search: Search, asked: Asked, code: str, rest: Node) -> Asked:
    """Without a cause that later ones have made needless, unless free runs become worse so."""
    base = search.base(search.root.model)
    trained = score(rest.model, search.root.model, base.folds, search.split).trained
    if runs_worse(gain_between(Base(asked.node.model, _with(base, asked.node.trained)), trained, search.split)):
        return asked
    found = asked.found
    kept = tuple(c for c in found.causes if c != code)
    return replace(asked, node=replace(rest, trained=trained, gained=asked.node.gained), found=replace(
        found, causes=kept, evidence={c: v for c, v in found.evidence.items() if c != code},
        rivals={c: v for c, v in found.rivals.items() if c != code}))


def _with(base: Base, trained: Sequence[Model]):
    return tuple(replace(f, trained=t) for f, t in zip(base.folds, trained, strict=True))


def _as_simple(search: Search, asked: Asked, code: str, first) -> Asked | None:
    """With a special case in place of a law whose surplus has become needless; None: it has not."""
    node, found = asked.node, asked.found
    names = found.added[code]
    for simple in (s for s in CAUSES[code].special if s in search.wanted and s not in found.causes):
        keep = tuple(n for n in names if CAUSES[simple].has(n))
        surplus = tuple(n for n in names if n not in keep)
        if not keep or not surplus:
            continue
        less = without_them(node.model, surplus, first, search.masks)
        if less.value > node.model.value + TRIFLE * len(surplus):
            continue
        base = search.base(search.root.model)
        trained = score(less, search.root.model, base.folds, search.split).trained
        return Asked(
            Node(tuple(simple if c == code else c for c in node.causes), less, trained,
                 {(simple if c == code else c): (keep if c == code else n) for c, n in node.added.items()},
                 node.gained), _renamed(found, code, simple, keep),
            tuple(_named(one, code, simple) for one in asked.rounds))
    return None


def _renamed(found: Found, code: str, name: str, added: Sequence[str]) -> Found:
    """A cause called by another name, which rivals none of the others."""
    def own(values):
        return {name if c == code else c: v for c, v in values.items()}

    rivals = {c: tuple(r for r in others if r != name) for c, others in own(found.rivals).items()}
    return replace(found, causes=tuple(name if c == code else c for c in found.causes), rivals=rivals,
                   evidence=own(found.evidence), added={**own(found.added), name: tuple(added)})


def _exchanged(asked: Asked, code: str, again: Expansion, sure: frozenset[str]) -> Asked:
    """Another cause in place of one, beside those that were found after it."""
    child = again.child
    assert child is not None
    name = child.causes[-1]
    found = _renamed(asked.found, code, name, child.added[name])
    between = tuple(r for r in again.decision.between if r != name and r not in found.causes)
    found = replace(found, rivals={**found.rivals, name: between}, sure=sure,
                    evidence={**found.evidence, name: again.decision.evidence})
    told = [replace(c, reason=c.reason or BESIDE) for c in again.lines]
    seen = {c.code for c in told}
    rounds = tuple(one if one.cause != code else Round(
        name, (*told, *(c for c in one.candidates if c.code not in seen)), again.stage) for one in asked.rounds)
    node = replace(child, causes=found.causes, added=found.added, gained=asked.node.gained)
    return Asked(node, found, rounds)


def _named(one: Round, code: str, simple: str) -> Round:
    """A round whose cause turned out a special case of what it was called."""
    if one.cause != code:
        return one
    state = {code: "worse", simple: "named"}
    return replace(one, cause=simple, candidates=tuple(
        replace(c, state=state.get(c.code, c.state)) for c in one.candidates))


def _retold(one: Round, code: str, gone: set[str]) -> Round:
    """The round of a cause without what rivals it no longer; that is named where nothing else does."""
    if one.cause != code or not gone:
        return one
    told: list[CandidateResult] = [
        replace(c, state="worse") if c.code in gone and c.state == "possible" else c for c in one.candidates]
    tied = [c.code for c in told if c.state == "possible"]
    return replace(one, candidates=tuple(
        replace(c, state="named") if [c.code] == tied and c.code == code else c for c in told))
