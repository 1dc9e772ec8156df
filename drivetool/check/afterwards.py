"""What is asked again once the rounds are over: what has become needless, doubts that later causes may decide."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.check.candidates import CANDIDATES
from drivetool.check.decide import decide
from drivetool.check.diagnosis import Round
from drivetool.check.heldout import score
from drivetool.check.imitation import imitates
from drivetool.check.judgement import hardly_told
from drivetool.check.model import BROKEN, Model
from drivetool.check.needless import renamed, spared, without_them
from drivetool.check.remainder import remainder

if TYPE_CHECKING:
    from drivetool.check.rounds import Search

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


def doubts_again(search: Search) -> None:
    """Ask again for a cause that others were found after, where it tied, or blocks held out hardly told it.

    Beside the others the records may tell it apart, and well.
    """
    hardly = hardly_told(search)
    for code in search.found.causes[:-1]:
        rivals = search.found.rivals.get(code, ())
        if rivals or code in hardly:
            with suppress(*BROKEN):  # then the doubt stands
                ask_again(search, code, (code, *rivals))
            gone = {r for r in rivals if r not in search.found.rivals[code]}
            search.rounds = [_retold(one, code, gone) for one in search.rounds]


def ask_again(search: Search, code: str, among: Sequence[str] = ()) -> None:
    """See what explains the records as well as a cause beside the others, where it was found in other company.

    among  the causes to ask; none: all
    """
    model, bases, folds = search.model, search.bases, search.folds
    try:
        search.stand_on(without_them(model, search.found.added[code], search.first.task.drive, search.masks))
        search.ends = {code: replace(model, code=code)}
        tried = search.attempts(among=[c for c in CANDIDATES if c.code in among])
        scores = search.judged(tried)
        decision = decide(scores, search.options.error_budget, 0.0, imitates)
        scores = search.with_doubles(tried, scores, decision)
        decision = decide(scores, search.options.error_budget, 0.0, imitates)
    finally:
        search.model, search.bases, search.folds, search.ends = model, bases, folds, {}
    if decision.best is not None:
        search.found.reopen(code, decision.between)
        search.found.sure |= {code} if any(s.model.code == code and s.sure for s in scores) else set()


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
            > max(SPOILT * change.held_out_rmse_before, change.rmse_std))
