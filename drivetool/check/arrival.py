"""Fits that are still on their way when their rounds are over.

From a base that took a cause for torque noise the noise falls by a factor of a few a round, the parameters with it,
and what is left half way is thousands less likely than the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace

from drivetool.check.hypothesis import Tried
from drivetool.check.model import BROKEN, SETTLED, Masks, Model, fit

ONWARD = 12  # further fits, at most
CREEP = 0.003  # of what a model gains over its base, in one round, from which it is on its way
CONTENDS = 0.3  # of the most that any cause gains, from which a cause is fitted until it moves no more


def all_arrived(tried: Sequence[Tried], base: Model, masks: Masks, pool: Executor) -> list[Tried]:
    """The causes, each fitted on while that gains much, those that may yet be the best until they are at rest."""
    tried = list(pool.map(lambda t: arrived(t, base, masks, CREEP), tried))
    best = max((base.value - t.model.value for t in tried if t.model is not None), default=0.0)
    return list(pool.map(lambda t: arrived(t, base, masks, 0.0) if t.model is not None
                         and base.value - t.model.value > CONTENDS * best else t, tried))


def arrived(tried: Tried, base: Model, masks: Masks, creep: float) -> Tried:
    """A cause fitted on as long as a round still gains that share of what it gains over its base."""
    model = tried.model
    for _ in range(ONWARD):
        if model is None or not model.moving > max(SETTLED, creep * (base.value - model.value)):
            break
        try:
            trial = fit(model.code, model.task, model.problem, model.point, model.noise, masks, rounds=3)
        except BROKEN:
            break
        if not trial.value < model.value:
            break
        model = trial
    return tried if model is tried.model else replace(tried, models=(model, *tried.models[1:]))
