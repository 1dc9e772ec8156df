"""What is asked again once the rounds are over: what has become needless, doubts that later causes may decide."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.check.causes import FITTED, mistaken_for
from drivetool.check.decide import SHARE, Decision, decide
from drivetool.check.diagnosis import Round
from drivetool.check.heldout import Score, score
from drivetool.check.hypothesis import Tried
from drivetool.check.imitation import imitates
from drivetool.check.judgement import hardly_told
from drivetool.check.model import BROKEN, Model, at_rest
from drivetool.check.needless import renamed, spared, without_them
from drivetool.check.remainder import remainder
from drivetool.check.story import results_of

if TYPE_CHECKING:
    from drivetool.check.rounds import Search

BESIDE = "asked again beside what was found after it"
SPOILT = 0.1  # of the error of free runs, by which it may grow beyond its scatter


def drop_needless(search: Search) -> None:
    """Take out what an earlier round put in and a later one has made needless, or a special case of it."""
    before, kept = search.model, deepcopy(search.found)
    search.model, names = spared(search.model, search.found, search.first.task.drive, search.asked, search.masks,
                                 search.options.error_budget)
    if search.model is before:
        return
    try:
        trained = score(search.model, search.folds).trained
        worse = _runs_worse(search, trained)
    except BROKEN:  # then what single steps say stands, and the gain of what was found first
        trained, worse = None, False
    if worse:
        search.model, search.found = before, kept
        return
    search.rounds = [renamed(one, names) for one in search.rounds]
    if trained is None:
        return
    with suppress(*BROKEN):  # then what was open of what was found first stands
        search.trained, search.left = trained, remainder(search.model)
        for code in search.found.unsure(kept.causes):
            ask_again(search, code)


def doubts_again(search: Search) -> bool:
    """Ask again for a cause that others were found after, where it tied, or blocks held out hardly told it.

    Beside the others the records may tell it apart, and well. Returns whether another one has taken its place.
    """
    hardly, exchanged = hardly_told(search), False
    for code in search.found.causes[:-1]:
        if search.found.rivals.get(code) or code in hardly:
            exchanged |= _again(search, code)
    return exchanged


def look_alikes_again(search: Search) -> None:
    """Ask again for a cause that another was found after and that leaves something, where one like it was near.

    Until that other one was found it may have stood in for both.
    """
    if search.left.total > 0.0:
        for code in search.found.causes[:-1]:
            alike = _close_behind(search, code)
            if alike:
                _again(search, code, sorted(alike))


def _again(search: Search, code: str, alike: Sequence[str] = ()) -> bool:
    """Ask again for a cause, what tied with it, and what else is like it; whether that has taken its place."""
    rivals, exchanged = search.found.rivals.get(code, ()), False
    with suppress(*BROKEN):  # then the doubt stands
        exchanged = ask_again(search, code, tuple(dict.fromkeys((code, *rivals, *alike))))
    gone = {r for r in rivals if r not in search.found.rivals.get(code, ())}
    search.rounds = [_retold(one, code, gone) for one in search.rounds]
    return exchanged


def _close_behind(search: Search, code: str) -> set[str]:
    """What is known to look like a cause, is none of those found, and was not far behind it in its round."""
    lines = {c.code: c.gain or 0.0 for one in search.rounds if one.cause == code for c in one.candidates}
    likely = {c for c, gain in lines.items() if gain > SHARE * lines.get(code, 0.0)}
    return (mistaken_for([code]) & likely) - {*search.found.causes}


def ask_again(search: Search, code: str, among: Sequence[str] = ()) -> bool:
    """See what explains the records as well as a cause beside the others, where it was found in other company.

    What does better takes its place; returns whether something does.

    among  the causes to ask; none: all
    """
    model, bases, folds = search.model, search.bases, search.folds
    try:
        search.stand_on(without_them(model, search.found.added[code], search.first.task.drive, search.masks))
        search.ends = {code: replace(model, code=code)}
        tried = search.attempts(among=[c for c in FITTED if c.code in among])
        scores = search.judged(tried)
        decision = decide(scores, search.options.error_budget, 0.0, imitates)
        scores = search.with_doubles(tried, scores, decision)
        decision = decide(scores, search.options.error_budget, 0.0, imitates)
        other = _other(search, code, tried, scores, decision)
    finally:
        search.model, search.bases, search.folds, search.ends = model, bases, folds, {}
    if decision.best is None:
        return False
    if other is not None:
        _exchange(search, code, decision, *other)
        return True
    search.found.reopen(code, decision.between)
    search.found.sure |= {code} if any(s.model.code == code and s.sure for s in scores) else set()
    return False


def _other(search: Search, code: str, tried: Sequence[Tried], scores: Sequence[Score], decision: Decision,
           ) -> tuple[Round, list[str]] | None:
    """(its round, names that it frees) of what does better than a cause on top of the others; None: nothing."""
    best, base = decision.best, search.model
    if best is None or code in decision.between or best.model.code not in search.asked - {*search.found.causes}:
        return None
    stage = search.gain_between([f.trained for f in search.folds], best.trained)
    lines = [replace(c, reason=c.reason or BESIDE) for c in results_of(tried, scores, decision, base, 0.0)]
    return (Round(best.model.code, tuple(lines), stage),
            [n for n in best.model.task.free if n not in base.task.free])


def _exchange(search: Search, code: str, decision: Decision, other: Round, added: Sequence[str]) -> None:
    """Take another cause in place of one, beside those that were found after it.

    Its round says what it is worth beside them; the rest of it is as it was.
    """
    name, model = decision.best.model.code, at_rest(decision.best.model, search.masks)
    left = remainder(model)
    search.stand_on(model)
    search.trained, search.left = decision.best.trained, left
    search.found.rename(code, name, added)
    search.found.reopen(name, decision.between)
    search.found.evidence[name] = decision.evidence
    again = {c.code for c in other.candidates}
    search.rounds = [one if one.cause != code else replace(other, candidates=(
        *other.candidates, *(c for c in one.candidates if c.code not in again))) for one in search.rounds]


def _retold(one: Round, code: str, gone: Collection[str]) -> Round:
    """The round of a cause without what rivals it no longer; that is named where nothing else does."""
    if one.cause != code or not gone:
        return one
    told = [replace(c, state="worse") if c.code in gone and c.state == "possible" else c for c in one.candidates]
    tied = [c.code for c in told if c.state == "possible"]
    return replace(one, candidates=tuple(
        replace(c, state="named") if [c.code] == tied and c.code == code else c for c in told))


def _runs_worse(search: Search, trained: Sequence[Model]) -> bool:
    """Whether free runs over data held out become worse by models of which single steps are as likely."""
    change = search.gain_between(search.trained, trained)
    return (change.held_out_rmse_after - change.held_out_rmse_before
            > max(SPOILT * change.held_out_rmse_before, change.rmse_bar))
