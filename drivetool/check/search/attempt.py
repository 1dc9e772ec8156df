"""The fit of one cause on top of a node: its starts screened, the promising ones fitted, the best to the end."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.causes import Cause
from drivetool.check.fit import BROKEN, FIRST, MOST, TOLD, TRIFLE, Masks, Model, carried, fit, third_of, values_of
from drivetool.check.outcome import State
from drivetool.check.search.absence import needed, why_absent
from drivetool.check.search.begin import Begun, Stand, begin, bounded, kind_of, stand_at
from drivetool.check.search.smallest import resolved_at
from drivetool.identify.laws import tip_names
from drivetool.identify.setup import Task, problem_of

STARTS = 2  # of a kind that are worth a fit, the most promising ones
ROUGH = 3  # the same where the likelihood is rough
LEAST = 0.1  # of the best promise, below which a start is not worth a fit
HALF = 0.5  # of what the likeliest cause gains, below which a first fit goes no further
AHEAD = 50.0  # log likelihood by which an end of another kind may be behind the best one anyhow
CLOSE = 0.7  # of what the best gains, by which it may be behind where that is more


@dataclass(frozen=True)
class Screened:
    """A cause and where its fits may start.

    begun     the most promising first
    smallest  standard deviation of each amplitude, of the lag for a bandwidth: what the record resolves
    absent    why there is nothing to fit, with its reason; None: there is
    """

    cause: Cause
    begun: tuple[Begun, ...] = ()
    smallest: Mapping[str, float] = ()
    absent: State | None = None
    reason: str = ""

    @property
    def promise(self) -> float:
        """Of the best start."""
        return max((b.promise for b in self.begun), default=-np.inf)


@dataclass(frozen=True)
class Tried:
    """A cause after its fit to all training samples.

    model     None if there was nothing to fit, or every fit failed: `absent` says which, `reason` why
    smallest  as of Screened
    """

    cause: Cause
    model: Model | None
    smallest: Mapping[str, float]
    reason: str = ""
    absent: State | None = None


def screen(cause: Cause, stands: Sequence[Stand], masks: Masks) -> Screened:
    """Where the fits of a cause may start on top of some stands, of which the first is the node's own model."""
    found, resolved, reason = [], {}, ""
    for place, stand in enumerate(stands):
        try:
            starts = cause.starts(stand.model)
        except BROKEN as error:
            reason = f"its start could not be found: {error}"
            continue
        each = []
        for start in starts:
            try:
                on = stand if start.quiet is None else stand_at(start.quiet)
                each.append(replace(begin(on, cause, start, masks), stand=place))
            except BROKEN as error:
                reason = f"every fit failed: {error}"
        if place == 0:
            if not starts:
                state, why = why_absent(cause, stand.model)
                return Screened(cause, (), {}, state, why)
            resolved = resolved_at(stand.model, cause, [b.std for b in each])
        found += each
    if not found:
        return Screened(cause, (), resolved, "failed", reason)
    if resolved and not any(np.isfinite(v) for v in resolved.values()):
        return Screened(cause, (), resolved, "not-shown", needed(cause))
    return Screened(cause, tuple(sorted(found, key=lambda b: -b.promise)), resolved)


def attempt(screened: Screened, base: Model, masks: Masks, more: Iterable[Model] = (),
            goal: float = np.inf) -> Tried:
    """A cause fitted from its most promising starts; the best end to the end. A fit that fails is a result.

    more  further places to start from
    goal  value of the likeliest cause so far: what is far from it after a few rounds goes no further
    """
    cause, reason, ends = screened.cause, screened.reason, []
    most = ROUGH if cause.rough else STARTS if np.isinf(goal) else 1
    starts = [*_worth(screened, most), *more]
    for start in starts:
        try:
            model = start.ready(masks) if isinstance(start, Begun) else start
            ends.append(fit(model, masks, most=FIRST, goal=goal))
        except BROKEN as error:
            reason = str(error)
    ends = sorted((m for m in ends if np.isfinite(m.value)), key=lambda m: m.value)
    if cause.ends is not None:
        ends = sorted((*ends, *cause.ends(base, masks)), key=lambda m: m.value)
    finished = []
    for model in _contenders(ends, base, cause.rough):
        if base.value - model.value < HALF * (base.value - goal):
            finished.append(model)
            continue
        try:
            model = fit(model, masks)
            finished.append(cause.refined(model, base, masks, refitted) if cause.refined is not None else model)
        except BROKEN as error:
            reason = str(error)
    if not finished:
        # Where no start is worth a fit none has failed.
        return Tried(cause, None, screened.smallest, *((f"its fit failed: {reason}", "failed") if starts else ()))
    best = min(finished, key=lambda m: m.value)
    return sizeable(Tried(cause, best, screened.smallest), base)


def _worth(screened: Screened, most: int) -> list[Begun]:
    """The starts that are worth a fit: of each kind, on each stand, the most promising."""
    chosen: dict[tuple[object, ...], list[Begun]] = {}
    for b in screened.begun:
        mine = chosen.setdefault(b.kind, [])
        if b.promise > max(TRIFLE, LEAST * screened.promise) and len(mine) < most:
            mine.append(b)
    return [b for mine in chosen.values() for b in mine]


def _contenders(ends: Sequence[Model], base: Model, rough: bool) -> list[Model]:
    """The best end, and those of another kind that are close to it or gain nearly as much.

    Under a torque noise that has yet to fall, a lag of the wrong order, or a drag on the wrong body, may be ahead.
    Where the likelihood is rough the best three: which of its valleys is the deepest is not known from above.
    """
    if rough or not ends:
        return list(ends[:ROUGH])
    near = ends[0].value + max(AHEAD, CLOSE * (base.value - ends[0].value))
    likeliest: dict[tuple[object, ...], Model] = {}
    for m in ends:
        if m.value < near:
            likeliest.setdefault(kind_of(m), m)
    return list(likeliest.values())


def refitted(model: Model, task: Task, base: Model, masks: Masks, most: int = MOST) -> Model:
    """A cause fitted with other parameters free, from where it is; base: lacks it, most: rounds."""
    problem = bounded(problem_of(task.drive, task.free, task.roles, model.problem.traces), base, task)
    return fit(replace(model, task=task, problem=problem, point=carried(model, task, problem)), masks, most=most)


def as_special_case(simple: Tried, general: Tried, base: Model, masks: Masks) -> Tried:
    """A cause fitted again from where one that contains it ended, if that is likelier.

    A special case that only stopped in a worse optimum must not lose to the law that contains it.
    """
    if simple.model is None or general.model is None or general.model.value > simple.model.value - TRIFLE:
        return simple
    own, values = simple.model, general.model.fitted.drive.values
    # The surplus of a Stribeck friction counts as Coulomb friction.
    new = {n: values.get(n, 0.0) + values.get(n.replace(".coulomb", ".stribeck"), 0.0) if n.endswith(".coulomb")
           else values[n] for n in own.task.free if n in values}
    task = own.task.at(new)
    try:
        trial = fit(replace(own, task=task, point=carried(general.model, task, own.problem),
                            noise=general.model.noise), masks)
    except BROKEN:
        return simple
    return replace(simple, model=trial) if trial.value < own.value else simple


def sizeable(tried: Tried, base: Model) -> Tried:
    """The same, absent if its size is not to be told from zero, or its own file finds it implausible.

    What gained then is the rest of the fit; of a third mass the start state, swinging out.
    """
    model, cause = tried.model, tried.cause
    assert model is not None
    why = cause.implausible(model, base) if cause.implausible is not None else ""
    if why:
        return replace(tried, reason=why, absent="no-gain")
    longer = model.task.drive.bodies != base.task.drive.bodies
    if not (tried.smallest or longer) or cause.trace is not None:
        return tried
    try:
        found = {p.name: abs(p.value / p.std) for p in values_of(model, base) if p.std}
    except BROKEN:
        return tried
    named = tip_names(base.task.drive, third_of(model.task.drive))[:1] if longer else tried.smallest
    sizes = [found[n] for n in named if n in found and (longer or cause.has(n))]
    if max(sizes, default=0.0 if longer else np.inf) > TOLD:
        return tried
    return replace(tried, reason="its size is not to be told from zero", absent="no-gain")
