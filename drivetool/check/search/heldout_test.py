"""Rejects causes that held-out data contradict, whatever their one-step prediction errors are."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from drivetool.check.fit import all_samples, gain_from_quantisation
from drivetool.check.heldout import Score, Split, gain_in_one_block, total_evidence
from drivetool.check.outcome import Gain
from drivetool.check.search.decision import Decision
from drivetool.check.search.result import Base, gain_between

# Relative growth of the free-run error. A choice: the growth must exceed the scatter of blocks, too.
MAX_ERROR_INCREASE = 0.1
# Share of the gain found before. A choice: a law that adds less may only compensate an inexact earlier law.
MINOR_GAIN_SHARE = 0.2
# Free-run error over that of the base: a law that doubles it is none, however small its one-step errors are.
MAX_ERROR_RATIO = 2.0
MAX_ERROR_RATIO_ANY_SCATTER = 10.0  # the same where few blocks make the scatter large; a choice
WORSE_FREE_RUNS = "it worsens the free-run error on held-out data"
ONE_PLACE = "nearly all of its gain on held-out data comes from one block"
# Share of a cause's gain on simulated records of the base with the same quantisation. A choice: at more than half,
# quantisation explains the gain better than the cause does.
MAX_QUANTISATION_SHARE = 0.5
FROM_QUANTISATION = "quantisation alone would give as much gain"


def apply_heldout_test(decision: Decision, scores: Sequence[Score], base: Base, split: Split, gained: float,
                       budget: float,
                       wanted: Collection[str]) -> tuple[Decision, dict[str, str]]:
    """(the decision without causes that held-out data contradict, those and why).

    A law of little gain that worsens the free-run error, or gains in one place only, compensates errors of the laws
    before it. One that gains as much on simulated records without it compensates quantisation. A cause that ties
    with a rejected one must then be found by itself, and passes the same tests.

    gained  log likelihood by what was found before; wanted: the causes that may be named
    """
    rejected: dict[str, str] = {}
    accepted: list[Score] = []
    tied = [s for s in scores if s.model.code in decision.between]
    # A requested cause goes first, before one that is as good but was not requested.
    for s in sorted(tied, key=lambda s: (s.model.code not in wanted, -s.gain)):
        if not accepted and rejected and total_evidence([s], gained) < np.log(1.0 / budget):
            continue
        reason = _rejection_reason(s, gain_between(base, s.trained, split, gained + s.gain), base, gained)
        if reason:
            rejected[s.model.code] = reason
        else:
            accepted.append(s)
    if not accepted:
        return replace(decision, best=None, between=()), rejected
    return replace(decision, best=accepted[0], between=tuple(
        c for c in decision.between if c in {s.model.code for s in accepted})), rejected


def _rejection_reason(s: Score, stage: Gain, base: Base, gained: float) -> str:
    """Why a likelier cause is rejected; empty: it is accepted."""
    change = stage.held_out_rmse_after - stage.held_out_rmse_before
    if gain_from_quantisation(base.model, s.model,
                              all_samples(base.model.problem)) > MAX_QUANTISATION_SHARE * max(s.lead, 0.0):
        return FROM_QUANTISATION
    if (stage.held_out_rmse_after > MAX_ERROR_RATIO_ANY_SCATTER * stage.held_out_rmse_before
        or change > max((MAX_ERROR_RATIO - 1.0) * stage.held_out_rmse_before, 2.0 * stage.rmse_bar)):
        return WORSE_FREE_RUNS
    if s.gain >= MINOR_GAIN_SHARE * gained:
        return ""
    if free_runs_worse_beyond_scatter(stage):
        return WORSE_FREE_RUNS
    return ONE_PLACE if gain_in_one_block(s, base.model) else ""


def free_runs_worse_beyond_scatter(stage: Gain) -> bool:
    """Whether the free-run error on held-out data grows beyond its scatter."""
    return (stage.held_out_rmse_after - stage.held_out_rmse_before
            > max(MAX_ERROR_INCREASE * stage.held_out_rmse_before, stage.rmse_bar))
