"""Causes that hide each other: found together, while neither shows alone.

Worst is a gap beside another law. While that is missing the contacts come at wrong times, and while the gap is
missing the base bends its parameters to make up for it. So a cause whose likelihood is rough is put first, whatever
it gains alone, where a search ends in doubt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.check.causes import CAUSES
from drivetool.check.fit import BROKEN, sensor_std
from drivetool.check.heldout import lead_in_blocks, score
from drivetool.check.outcome import CandidateResult, taken_for_noise
from drivetool.check.search.absence import law_of
from drivetool.check.search.attempt import attempt, screen
from drivetool.check.search.begin import stand_at
from drivetool.check.search.decision import Decision
from drivetool.check.search.foretell import SPOILT
from drivetool.check.search.lines import told
from drivetool.check.search.result import Searched, gain_between
from drivetool.check.search.search import Expansion, Node, Search
from drivetool.check.starts import torque_size

MOST = 2  # bodies: with three, fits of a gap take minutes
LOUD = 1.5  # sensor noises of error in free runs, from which an unlikely torque noise is looked at again
LEAD = 20.0  # log likelihood by which what is found together must lead
TOGETHER = "by itself it does not show; found together with the cause of the next round"


def doubtful(result: Searched) -> bool:
    """Whether the outcome leaves much, spoils the free runs, or hides much in an unlikely noise of the torque."""
    if result.found.causes and not result.confident:
        return True
    if not result.found.causes and result.left.total == 0.0:  # one-step errors are white: that noise is one
        return False
    gain, model = result.judged_gain(), result.model
    spoilt = gain.held_out_rmse_after > (1.0 + SPOILT) * gain.held_out_rmse_before
    share = model.noise.ratio * sensor_std(model) / torque_size(result.first.model)
    return spoilt or taken_for_noise(
        gain.held_out_rmse_before, gain.held_out_rmse_after, gain.noise_floor, share, LOUD)


def together(search: Search, path: Sequence[Expansion]) -> tuple[list[Expansion], str] | None:
    """A path that begins with a rough cause and ends likelier, and foretells better; None: there is none.

    path  that the search went, from the root
    """
    last = path[-1].child or path[-1].node
    if len(search.root.model.task.drive.bodies) > MOST or any(CAUSES[c].rough for c in last.causes):
        return None
    for cause in [c for c in search.causes if c.rough and c.code in search.wanted]:
        try:
            first = _forced(search, cause.code, path[0])
            if first is None:
                continue
            rest, unasked = search.path(first.child)
        except BROKEN:  # a fit that fails takes nothing down: what was found first stands
            continue
        end = rest[-1].child or rest[-1].node
        if len(end.causes) < 2 or end.model.value > last.model.value - LEAD:
            continue
        folds = search.base(search.root.model).folds
        blocks = [lead_in_blocks(*trial) for trial in zip(end.trained, last.trained, folds, strict=True)]
        if np.concatenate(blocks).sum() > 0.0:
            return [replace(first, child=rest[0].node), *rest], unasked
    return None


def _forced(search: Search, code: str, before: Expansion) -> Expansion | None:
    """A cause taken for found on top of the root; None: it has no fit."""
    root, cause = search.root, CAUSES[code]
    stands = [stand_at(m) for m in (root.model, *search.elsewhere)]
    seen = screen(cause, stands, search.masks)
    tried = attempt(seen, root.model, search.masks) if seen.begun else None
    if tried is None or tried.model is None:
        return None
    base = search.base(root.model)
    found = score(tried.model, base.model, base.folds, search.split)
    added = tuple(n for n in tried.model.task.free if n not in root.model.task.free)
    child = Node((code,), tried.model, found.trained, {code: added}, max(found.gain, 0.0))
    own = CandidateResult(code, law_of(cause), "named", parameters=told(tried.model, root.model), reason=TOGETHER)
    others = tuple(replace(c, state="worse") if c.state in ("named", "possible") else c
                   for c in before.lines if c.code != code)
    return Expansion(root, (tried,), (found,), Decision(found, (code,), 0.0), (own, *others), child,
                     gain_between(base, found.trained, search.split))
