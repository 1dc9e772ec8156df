"""Causes that samples held out speak against, whatever single steps say."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from drivetool.check.fit import everything, faked
from drivetool.check.heldout import Score, Split, in_one_place, total_evidence
from drivetool.check.outcome import Gain
from drivetool.check.search.decision import Decision
from drivetool.check.search.result import Base, gain_between

SPOILT = 0.1  # of the error of free runs, by which it may grow beyond its scatter
LITTLE = 0.2  # of what was gained before, below which a cause may make up for an inexact law
DOUBLED = 2.0  # of that error, beyond twice its scatter, from which it is no law, however likely steps become
RUINED = 10.0  # the same, whatever its scatter
AGAINST = "free runs over data held out become worse with it"
ONE_PLACE = "nearly all that it gains on data held out lies in one place"
FAKED = 0.5  # of what a cause gains, that it may gain on records of the base logged in the same steps
STEPS = "the steps of the logger would show as much"


def against(decision: Decision, scores: Sequence[Score], base: Base, split: Split, gained: float, budget: float,
            wanted: Collection[str]) -> tuple[Decision, dict[str, str]]:
    """(the decision without causes that data held out speak against, those and why).

    A law that gains little beside those before it, and mends single steps but spoils the run, or gains in one place
    only, makes up for what they are not exact in; one that records made up without it show as well makes up for the
    steps of the logger. What ties with it must then be found by itself, and is held against the same.

    gained  log likelihood by what was found before; wanted: the causes that may be named
    """
    said: dict[str, str] = {}
    left: list[Score] = []
    tied = [s for s in scores if s.model.code in decision.between]
    # One that was asked for first, where that is as good as one that was not.
    for s in sorted(tied, key=lambda s: (s.model.code not in wanted, -s.gain)):
        if not left and said and total_evidence([s], gained) < np.log(1.0 / budget):
            continue
        why = _why_not(s, gain_between(base, s.trained, split, gained + s.gain), base, gained)
        if why:
            said[s.model.code] = why
        else:
            left.append(s)
    if not left:
        return replace(decision, best=None, between=()), said
    return replace(decision, best=left[0], between=tuple(
        c for c in decision.between if c in {s.model.code for s in left})), said


def _why_not(s: Score, stage: Gain, base: Base, gained: float) -> str:
    """Why a cause that is likelier is none; empty: it may be one."""
    change = stage.held_out_rmse_after - stage.held_out_rmse_before
    if faked(base.model, s.model, everything(base.model.problem)) > FAKED * max(s.lead, 0.0):
        return STEPS
    if (stage.held_out_rmse_after > RUINED * stage.held_out_rmse_before
            or change > max((DOUBLED - 1.0) * stage.held_out_rmse_before, 2.0 * stage.rmse_bar)):
        return AGAINST
    if s.gain >= LITTLE * gained:
        return ""
    if runs_worse(stage):
        return AGAINST
    return ONE_PLACE if in_one_place(s, base.model) else ""


def runs_worse(stage: Gain) -> bool:
    """Whether free runs over data held out become worse beyond their scatter."""
    return (stage.held_out_rmse_after - stage.held_out_rmse_before
            > max(SPOILT * stage.held_out_rmse_before, stage.rmse_bar))
