"""Causes that mask each other: identifiable together, neither alone.

The worst case is a gap with another law. Without the law the contacts come at wrong times; without the gap the base
parameters are biased. So a search that ends in doubt starts again with a cause whose likelihood has many local
optima, whatever it gains alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.check.causes import CAUSES
from drivetool.check.fit import FIT_ERRORS, sensor_std
from drivetool.check.heldout import lead_in_blocks, score
from drivetool.check.outcome import CandidateResult, noise_hides_law
from drivetool.check.search.absence import law_of
from drivetool.check.search.candidate_fit import attempt, screen
from drivetool.check.search.candidate_report import fitted_parameters
from drivetool.check.search.decision import Decision
from drivetool.check.search.heldout_test import MAX_ERROR_INCREASE
from drivetool.check.search.prepared_start import reference_model
from drivetool.check.search.result import SearchResult, gain_between
from drivetool.check.search.search import Expansion, ForwardSelection, Node
from drivetool.check.starts import torque_size

MAX_BODIES_OF_PAIR_SEARCH = 2  # with three, fits of a gap take minutes
MIN_ERROR_TO_NOISE = 1.5  # free-run error over sensor noise. A choice: below, noise alone explains the error
# Log likelihood. A choice: so large because the error budget does not count the chances of the second search.
MIN_JOINT_LEAD = 20.0
JOINT_REASON = "not significant alone; found jointly with the cause of the next round"


def is_inconclusive(result: SearchResult) -> bool:
    """Whether the outcome leaves large residuals, worsens the free runs, or needs an implausible torque noise."""
    if result.found.causes and not result.confident:
        return True
    if not result.found.causes and result.left.total == 0.0:  # white innovations: the torque noise is plausible
        return False
    gain, model = result.judged_gain(), result.model
    worsened = gain.held_out_rmse_after > (1.0 + MAX_ERROR_INCREASE) * gain.held_out_rmse_before
    share = model.noise.ratio * sensor_std(model) / torque_size(result.first.model)
    return worsened or noise_hides_law(
        gain.held_out_rmse_before, gain.held_out_rmse_after, gain.noise_floor, share, MIN_ERROR_TO_NOISE)


def find_masked_causes(search: ForwardSelection, path: Sequence[Expansion]) -> tuple[list[Expansion], str] | None:
    """A path that begins with a multimodal cause, ends likelier and predicts held-out data better; None: none does.

    path  of the first search, from the root
    """
    last = path[-1].child or path[-1].node
    if len(search.root.model.task.drive.bodies) > MAX_BODIES_OF_PAIR_SEARCH or any(
            CAUSES[c].multimodal for c in last.causes):
        return None
    for cause in [c for c in search.causes if c.multimodal and c.code in search.wanted]:
        try:
            first = _forced_expansion(search, cause.code, path[0])
            if first is None:
                continue
            rest, unrequested = search.path(first.child)
        except FIT_ERRORS:  # a fit that fails leaves the first result unchanged
            continue
        end = rest[-1].child or rest[-1].node
        if len(end.causes) < 2 or end.model.value > last.model.value - MIN_JOINT_LEAD:
            continue
        folds = search.base(search.root.model).folds
        blocks = [lead_in_blocks(*trial) for trial in zip(end.trained, last.trained, folds, strict=True)]
        if np.concatenate(blocks).sum() > 0.0:
            return [replace(first, child=rest[0].node), *rest], unrequested
    return None


def _forced_expansion(search: ForwardSelection, code: str, before: Expansion) -> Expansion | None:
    """A cause accepted without a test on top of the root; None: it has no fit."""
    root, cause = search.root, CAUSES[code]
    references = [reference_model(m) for m in (root.model, *search.alternative_bases)]
    screened = screen(cause, references, search.masks)
    candidate = attempt(screened, root.model, search.masks) if screened.prepared_starts else None
    if candidate is None or candidate.model is None:
        return None
    base = search.base(root.model)
    held_out_score = score(candidate.model, base.model, base.folds, search.split)
    added = tuple(n for n in candidate.model.task.free if n not in root.model.task.free)
    child = Node((code,), candidate.model, held_out_score.trained, {code: added}, max(held_out_score.gain, 0.0))
    own = CandidateResult(code, "named", law=law_of(cause),
                          parameters=fitted_parameters(candidate.model, root.model), reason=JOINT_REASON)
    others = tuple(c.replace(state="worse") if c.state in ("named", "possible") else c
                   for c in before.lines if c.code != code)
    return Expansion(root, (held_out_score,), Decision(held_out_score, (code,), 0.0), (own, *others), child,
                     gain_between(base, held_out_score.trained, search.split))
