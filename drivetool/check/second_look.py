"""A second look where a search ends in doubt: whether a gap beside another law foretells better."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

from drivetool.check.afresh import at_start, strayed
from drivetool.check.beside_gap import GAP, Pair, beside_a_gap
from drivetool.check.candidates import torque_size
from drivetool.check.decide import decide
from drivetool.check.diagnosis import CandidateResult, Round
from drivetool.check.heldout import foretold, score
from drivetool.check.model import sensor_std
from drivetool.check.remainder import remainder
from drivetool.check.rounds import SPOILT, Search
from drivetool.check.sentence import taken_for_noise

LOUD = 2.0  # sensor noises of error in free runs, from which a large torque noise is looked at again
BENT = 1.5  # by which a base that makes up for two laws leaves its start
TOGETHER = "by itself it does not show; found together with the cause of the next round"


def second_look(search: Search) -> Search:
    """The search, or one that begins with a gap, where the first ended in doubt and the other foretells better."""
    if not doubtful(search):
        return search
    stand = search.origin
    if strayed(stand, search.begun, BENT):
        stand = at_start(stand, search.begun, search.masks)
    pair = beside_a_gap(stand, search.asked, search.train, search.masks, search.model.value)
    if pair is None:
        return search
    other = _from_the_start(search)
    folds = other.folds
    _begin_with(other, pair, search.rounds[0])
    other.run()
    found = score(other.model, folds)
    decision = decide([found], search.options.error_budget)
    if decision.best is None or GAP not in other.causes or len(other.causes) < 2:
        return search
    if foretold(other.trained, folds) > foretold(search.trained, folds):
        return search
    other.evidence[GAP] = decision.evidence
    return other


def doubtful(search: Search) -> bool:
    """Whether the outcome leaves much, hides it in an unlikely noise of the torque, or spoils the free runs."""
    gain, model = search.total_gain(), search.model
    share = model.noise.ratio * sensor_std(model) / torque_size(search.first)
    spoilt = gain.held_out_rmse_after > (1.0 + SPOILT) * gain.held_out_rmse_before
    return bool(search.causes and not search.confident) or spoilt or taken_for_noise(gain, share, LOUD)


def _from_the_start(search: Search) -> Search:
    """The same search before its first round."""
    other = copy(search)
    other.causes, other.rounds, other.evidence, other.added, other.between = [], [], {}, {}, ()
    other.faults, other.unasked, other.gained = list(search.faults), "", 0.0
    other.stand_on(search.origin)
    other.trained = tuple(f.trained for f in other.folds)
    return other


def _begin_with(search: Search, pair: Pair, first: Round) -> None:
    """Take the gap of a pair for found; what it shows beside is to be found by the rounds.

    first  round of the search before, whose other causes are worse now
    """
    found = score(pair.gap, search.folds)
    stage = search.gain_between(search.trained, found.trained)
    lines = [_turned_down(c) for c in first.candidates if c.code != GAP]
    law = next((c.law for c in first.candidates if c.code == GAP), "")
    own = CandidateResult(GAP, law, "named", found.gain, found.gain_std, reason=TOGETHER)
    search.rounds.append(Round(GAP, (own, *lines), stage))
    search.causes.append(GAP)
    search.added[GAP] = tuple(n for n in pair.gap.task.free if n not in search.model.task.free)
    search.gained = max(found.gain, 0.0)
    search.trained, search.ends = found.trained, pair.further
    search.left = remainder(pair.gap)
    search.stand_on(pair.gap)


def _turned_down(line: CandidateResult) -> CandidateResult:
    """A cause that was named before and is not any more."""
    return replace(line, state="worse") if line.state in ("named", "possible") else line
