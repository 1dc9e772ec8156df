"""A second look where a search ends in doubt: do descents from where the base began foretell better?"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace

import numpy as np

from drivetool.check.afresh import at_start, strayed
from drivetool.check.afterwards import SPOILT
from drivetool.check.causes.starts import torque_size
from drivetool.check.decide import Decision, decide
from drivetool.check.descents import GAP, descended, gap_alone, with_gap
from drivetool.check.diagnosis import CandidateResult, Round
from drivetool.check.found import Found
from drivetool.check.heldout import lead_in_blocks, score
from drivetool.check.model import BROKEN, Model, at_rest, sensor_std
from drivetool.check.remainder import remainder
from drivetool.check.rounds import Search
from drivetool.check.sentence import taken_for_noise
from drivetool.check.story import told

MOST = 2  # bodies: with three, descents take minutes
LOUD = 1.5  # sensor noises of error in free runs, from which an unlikely torque noise is looked at again
BENT = 1.5  # by which a base that makes up for a law leaves its start
CLOSED = 0.01  # of the twist that the torque makes: a gap that is none
LEAD = 20.0  # log likelihood by which what is found must lead
SAME = "hardening-stiffness"  # a gap by another name
TOGETHER = "by itself it does not show; found together with the cause of the next round"

Ends = Mapping[str, Model]  # cause -> where its descents ended


def second_look(search: Search) -> Search:
    """The search, or another one that begins with what descents found, if that foretells better."""
    if len(search.origin.task.drive.bodies) > MOST or not doubtful(search):
        return search
    try:
        return _looked_again(search)
    except BROKEN:  # a fit that fails takes nothing down: what was found first stands
        return search


def _looked_again(search: Search) -> Search:
    """The search, or the other one."""
    stand, train, masks = search.origin, search.train, search.masks
    if strayed(stand, search.begun, BENT):
        stand = at_start(stand, search.begun, masks)
    single: Ends = _rested(descended(stand, search.asked, train, masks), masks)
    beside: Ends = {}
    if GAP in single and _open(single[GAP]):
        beside = _rested(descended(with_gap(stand, single[GAP]), search.asked - {GAP, SAME}, train, masks), masks)
    least = min(search.model.value, _least(single))
    if least - LEAD < _least(beside) and search.model.value - LEAD < _least(single):
        return search
    other = _from_the_start(search)
    folds, budget = other.folds, other.options.error_budget
    taken = _least(beside) < least - LEAD
    if taken:
        _begin_with_gap(other, beside, search.rounds[0])
    else:
        other.ends = single
    other.run()
    if len(other.found.causes) <= taken:
        return search
    trials = zip(other.trained, search.trained, folds, strict=True)
    if not np.concatenate([lead_in_blocks(*trial) for trial in trials]).sum() > 0.0:
        return search
    decision = decide([score(other.model, folds)], budget)
    if decision.best is None:
        return search
    if taken and GAP in other.found.causes:
        other.found.evidence[GAP] = decision.evidence
    return other


def doubtful(search: Search) -> bool:
    """Whether the outcome leaves much, spoils the free runs, or hides much in an unlikely noise of the torque."""
    if search.found.causes and not search.confident:
        return True
    if not search.found.causes and search.left.total == 0.0:  # one-step errors are white: that noise is one
        return False
    gain, model = search.total_gain(), search.model
    spoilt = gain.held_out_rmse_after > (1.0 + SPOILT) * gain.held_out_rmse_before
    share = model.noise.ratio * sensor_std(model) / torque_size(search.first)
    return spoilt or taken_for_noise(gain, share, LOUD)


def _open(gap: Model) -> bool:
    """Whether a descent has left a gap open at all."""
    drive = gap.fitted.drive
    return any((drive.value(f"{s}.half_gap") or 0.0) * drive.value(f"{s}.stiffness") > CLOSED * torque_size(gap, s)
               for s in drive.shafts)


def _rested(ends: Ends, masks) -> Ends:
    """The ends, the likeliest fitted until it moves no more."""
    first = min(ends, key=lambda code: ends[code].value, default=None)
    return {**ends, first: at_rest(ends[first], masks)} if first else {}


def _least(ends: Ends) -> float:
    return min((m.value for m in ends.values()), default=np.inf)


def _from_the_start(search: Search) -> Search:
    """The same search before its first round, with what its rounds have left of the error budget."""
    other = copy(search)
    left = search.options.error_budget * 0.5 ** len(search.rounds)
    other.options = replace(search.options, error_budget=left)
    other.found, other.rounds, other.faults, other.unasked = Found(), [], list(search.faults), ""
    other.stand_on(search.origin)
    other.trained = tuple(f.trained for f in other.folds)
    return other


def _begin_with_gap(search: Search, beside: Ends, first: Round) -> None:
    """Take a gap for found; what it shows beside is to be found by the rounds.

    beside  causes beside the gap
    first   round of the search before, whose other causes are worse now
    """
    gap = gap_alone(min(beside.values(), key=lambda m: m.value), search.origin, search.masks)
    found = score(gap, search.folds)
    stage = search.gain_between(search.trained, found.trained)
    lines = [_turned_down(c) for c in first.candidates if c.code != GAP]
    law = next((c.law for c in first.candidates if c.code == GAP), "")
    # What it gains by itself says nothing.
    own = CandidateResult(GAP, law, "named", parameters=told(gap, search.origin), reason=TOGETHER)
    search.rounds.append(Round(GAP, (own, *lines), stage))
    added = [n for n in gap.task.free if n not in search.model.task.free]
    search.found.take(GAP, Decision(found, (GAP,), 0.0), added, max(found.gain, 0.0))
    search.trained, search.ends = found.trained, beside
    search.left = remainder(gap, search.held)
    search.stand_on(gap)


def _turned_down(line: CandidateResult) -> CandidateResult:
    """A cause that was named before and is not any more."""
    return replace(line, state="worse") if line.state in ("named", "possible") else line
