"""The fit of one cause on top of the base, and what the record could have shown of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.absence import needed, why_absent
from drivetool.check.causes import CAUSES
from drivetool.check.causes.cause import Cause, Start
from drivetool.check.diagnosis import State
from drivetool.check.linear_step import alone, linear_step
from drivetool.check.model import BROKEN, Masks, Model, at_rest, fit, judge
from drivetool.check.search_bounds import bounded
from drivetool.check.smallest import resolved_at
from drivetool.check.structure import carried, third_of
from drivetool.identify.engine import Task
from drivetool.identify.estimate import Parameter
from drivetool.identify.least_squares import Solution, marquardt_step
from drivetool.identify.noise import normal_under
from drivetool.identify.problem import Point, Problem
from drivetool.identify.results import parameters_of
from drivetool.identify.setup import problem_of
from drivetool.identify.third_mass import tip_names

BEGUN = 2  # starts with amplitudes that are worth a few steps, the most promising ones
KEPT = 2  # ends of a first round that may be fitted to the end
AHEAD = 50.0  # log likelihood by which the best of them must lead to be the only one
CLOSE = 0.7  # of what the best of them gains, by which one of another kind may be behind it
TRIFLE = 2.0  # log likelihood gained on the records it was fitted to, below which a cause is not judged
TOLD = 2.5  # standard deviations by which one amplitude of a cause must differ from zero
HOPELESS = 20.0  # log likelihood above the base after two rounds, from which a refit of it is given up
PACE = (0.02, 0.02, 0.2)  # of what a quieter noise costs, that a fit makes up by each round, or it is given up
NEEDED = 10.0  # log likelihood that a cause must be worth whose size has no standard error to go by


@dataclass(frozen=True)
class Tried:
    """A cause after its fit to the whole record.

    models    where its fits ended, the best first; none if there was nothing to fit, or every fit
              failed: `absent` says which, `reason` why
    smallest  standard deviation of each amplitude at the base, the cause's others zero, of the lag for a bandwidth:
              what the record resolves
    promise   log likelihood that a linear step at the base would gain; zero if none was tried
    """

    candidate: Cause
    models: tuple[Model, ...]
    smallest: dict[str, float]
    reason: str = ""
    absent: State | None = None
    promise: float = 0.0

    @property
    def model(self) -> Model | None:
        """The best fit."""
        return self.models[0] if self.models else None


@dataclass(frozen=True)
class Begun:
    """A start that is ready for a fit.

    promise  log likelihood that one linear step would gain; infinite where there is none to say
    std      amplitude -> its standard deviation at the base, the cause's others zero
    """

    start: Start
    problem: Problem
    point: Point
    promise: float
    std: dict[str, float]


def attempt(candidate: Cause, base: Model, masks: Masks, before: Tried | None = None) -> Tried:
    """A few steps of a cause from all its starts; a fit that fails is a result.

    before   the same cause on top of a base that has since been improved: it goes on from there, or stays
    """
    try:
        starts = candidate.starts(base) if before is None or before.model is None else [_again(base, before.model)]
    except BROKEN as error:
        return Tried(candidate, (), {}, f"its start could not be found: {error}", "failed")
    if not starts:
        state, reason = why_absent(candidate, base)
        return Tried(candidate, (), {}, reason, state)
    begun, reason = [], "every fit failed"
    for start in starts:
        try:
            begun.append(begin(base, start, masks, candidate.sizes))
        except BROKEN as error:
            reason = str(error)
    resolved = dict(before.smallest) if before is not None else resolved_at(base, candidate, [b.std for b in begun])
    begun = _promising(begun)
    if begun and begun[0].promise < TRIFLE:
        return _screened(candidate, resolved)
    found = []
    for b in begun:
        try:
            found.append(_first_fit(candidate.code, b, base, masks))
        except BROKEN as error:
            reason = str(error)
    # Beside the parameters of a base that made up for the cause, its amplitudes may be nowhere near an optimum.
    found += [] if before is None else before.models
    further = candidate.ends(base, masks)[:KEPT] if candidate.ends is not None and before is None else []
    found = sorted((m for m in found if np.isfinite(m.value)), key=lambda m: m.value)[:KEPT]
    found = sorted((*found, *further), key=lambda m: m.value)
    if not found:
        return Tried(candidate, (), resolved, f"its fit failed: {reason}", "failed")
    promise = max((b.promise for b in begun if np.isfinite(b.promise)), default=0.0)
    return Tried(candidate, tuple(found), resolved, promise=promise)


def _first_fit(code: str, begun: Begun, base: Model, masks: Masks) -> Model:
    """A few steps from a start; where they are made under a quieter noise, that is fitted too after them.

    What the louder noise of the base stands in for makes up for the cost of the quieter one, and soon.
    """
    start, quiet = begun.start, begun.start.quiet
    if quiet is None:
        return fit(code, start.task, begun.problem, begun.point, base.noise, masks, rounds=1, renew=False,
                   most=start.steps)
    point, cost = begun.point, quiet.value - base.value
    for share in PACE:
        model = fit(code, start.task, begun.problem, point, quiet.noise, masks, rounds=1, renew=False,
                    most=start.steps)
        if quiet.value - model.value < share * cost:
            return model
        point = model.point
    return fit(code, model.task, model.problem, point, model.noise, masks, rounds=3)


def also(tried: Tried, end: Model | None) -> Tried:
    """A cause with one more end that its fit may start from."""
    if end is None:
        return tried
    models = sorted((end, *tried.models), key=lambda m: m.value)[:KEPT]
    return replace(tried, models=tuple(models), reason="", absent=None)


def polished(tried: Tried, masks: Masks, base: Model) -> Tried:
    """The best ends of a first round fitted to the end, over a base."""
    ends, reason = [], ""
    for model in _contenders(tried.models, base, tried.candidate.rough):
        try:
            end = fit(model.code, model.task, model.problem, model.point, model.noise, masks)
            end = at_rest(end, masks) if tried.candidate.rough else end
            ends.append(end if tried.candidate.refined is None else tried.candidate.refined(end, base, masks))
        except BROKEN as error:
            reason = str(error)
    if not ends:
        return replace(tried, models=(), reason=f"its fit failed: {reason}", absent="failed")
    return replace(tried, models=tuple(sorted(ends, key=lambda m: m.value)))


def refitted(model: Model, task: Task, base: Model, masks: Masks) -> Model:
    """A cause fitted with other parameters free, from where it is."""
    problem = bounded(problem_of(task.drive, task.free, task.roles, model.problem.traces), base, task)
    return fit(model.code, task, problem, carried(model, task, problem), model.noise, masks)


def _contenders(models: Sequence[Model], base: Model, rough: bool) -> list[Model]:
    """The best end, those close to it, and those of another kind that gain nearly as much.

    Under a torque noise that has yet to fall, a lag of the wrong order, or a drag on the wrong body, may be ahead.
    Where the likelihood is rough all ends: which of its valleys is the deepest is not known from above.
    """
    if rough:
        return list(models)
    best = models[0]
    close = CLOSE * (base.value - best.value)

    def behind(m: Model) -> float:
        return close if _kind(m) != _kind(best) and close > AHEAD else AHEAD

    return [best, *(m for m in models[1:] if m.value < best.value + behind(m))]


def _kind(model: Model) -> tuple[object, ...]:
    """What is fitted, and the choices in a drive that are no numbers to be fitted."""
    drive = model.task.drive
    return model.task.free, *(drive.value(n) for n, q in drive.quantities.items() if q.choice)


def as_special_case(simple: Tried, general: Tried, masks: Masks) -> Tried:
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
        point = carried(general.model, task, own.problem)
        trial = fit(own.code, task, own.problem, point, general.model.noise, masks)
    except BROKEN:
        return simple
    return replace(simple, models=(trial, *simple.models)) if trial.value < own.value else simple


def sizeable(tried: Tried, base: Model, masks: Masks) -> Tried:
    """The same, absent if its amplitudes are not to be told from zero: what gained then is the rest of the fit.

    Where parameters trade against one another a standard error says little: the base begun there decides. Not over
    a third mass, whose start state alone, swinging out, may be what gains: without inertia it is none. What its own
    file finds implausible is none either.
    """
    if tried.model is not None and tried.candidate.implausible is not None:
        why = tried.candidate.implausible(tried.model, base)
        if why:
            return replace(tried, reason=why, absent="no-gain")
    longer = tried.model is not None and tried.model.task.drive.bodies != base.task.drive.bodies
    if not (tried.smallest or longer) or tried.model is None:
        return tried
    try:
        found = {p.name: abs(p.value / p.std) for p in values_of(tried.model, base) if p.std}
    except BROKEN:
        return tried
    own = tried.candidate.sizes  # of Stribeck friction the surplus: without it, it is Coulomb friction
    named = tip_names(base.task.drive, third_of(tried.model.task.drive))[:1] if longer else tried.smallest
    sizes = [found[n] for n in named if n in found and (longer or n.rpartition(".")[2] in own)]
    if longer and not sizes:
        return replace(tried, reason="its size is not to be told", absent="no-gain")
    if not sizes or max(sizes) > TOLD or (not longer and _needed(tried.model, base, masks)):
        return tried
    return replace(tried, reason="its size is not to be told from zero", absent="no-gain")


def place_of(model: Model) -> float | None:
    """The order of a ripple, or the instant at which a load sets in; None of a cause without."""
    places = tuple(c.place for c in CAUSES.values() if c.place)
    found = [v for n, v in model.fitted.drive.values.items() if n in model.task.free and n.endswith(places)]
    return float(found[-1]) if found else None


def _needed(model: Model, base: Model, masks: Masks) -> bool:
    """Whether a cause that gains is likelier than the base that begins with its parameters and its noise."""
    if model.value > base.value - NEEDED:
        return False
    rest = without(model, replace(base, noise=model.noise), masks)
    return rest.value > model.value + NEEDED


def without(model: Model, base: Model, masks: Masks, goal: float = np.inf) -> Model:
    """The base fitted from the values that a model with a cause has for its parameters.

    goal  -log likelihood that it should reach; far above it after two rounds it is given up
    """
    values = dict(zip(model.task.free, model.point.values, strict=True))
    task = base.task.at({n: float(values[n]) for n in base.task.free if n in values})
    begun = fit("base", task, base.problem, carried(model, task, base.problem), base.noise, masks, rounds=2)
    if begun.value > goal + HOPELESS:
        return begun
    return fit("base", task, base.problem, begun.point, begun.noise, masks, rounds=6)


def values_of(model: Model, base: Model) -> tuple[Parameter, ...]:
    """What the cause adds to the base, with intervals where there are any."""
    normal = normal_under(model.problem, model.point, model.noise)
    lines, _, _ = parameters_of(model.problem, Solution(model.point, normal, 0, True), model.task.drive,
                                model.fitted.drive)
    return tuple(p for p in lines if p.name in model.task.free and p.name not in base.task.free)


def _again(base: Model, model: Model) -> Start:
    """The base with what a cause added to it before."""
    fitted, drive = model.fitted, base.fitted.drive
    if fitted.drive.bodies != drive.bodies:
        return Start(fitted, ())
    return Start(fitted.at({n: drive.value(n) for n in base.task.free}), ())


def _promising(begun: Sequence[Begun]) -> list[Begun]:
    """The starts that are worth a fit: of those with amplitudes the most promising."""
    told = sorted((b for b in begun if np.isfinite(b.promise)), key=lambda b: -b.promise)
    untold = [b for b in begun if not np.isfinite(b.promise)]
    return [*untold, *[b for b in told[:BEGUN] if not untold or b.promise > TRIFLE]]


def _screened(candidate: Cause, resolved: dict[str, float]) -> Tried:
    """A cause whose amplitudes the innovations at the base do not ask for."""
    if resolved and not any(np.isfinite(v) for v in resolved.values()):
        return Tried(candidate, (), resolved, needed(candidate), "not-shown")
    return Tried(candidate, (), resolved, "it does not make the records it is fitted to more likely", "no-gain")


def begin(base: Model, start: Start, masks: Masks, sizes: Sequence[str] = ()) -> Begun:
    """The first point of a start, and what a linear step promises.

    sizes  suffixes of the amplitudes that are the cause's own: the friction that a breakaway one comes on top of is
           none

    Amplitudes begin where one linear step from the base puts them, everything else there too or
    where it was, whichever is likelier; from zero the limits of the usual steps would take many.
    """
    task = start.task
    problem = problem_of(task.drive, task.free, task.roles, base.problem.traces)
    problem = bounded(problem, base, task)
    point = carried(base, task, problem)
    if not start.amplitudes:
        return Begun(start, problem, point, np.inf, {})
    normal = normal_under(problem, point, base.noise)
    moves = np.array([n in start.amplitudes or n in base.task.free for n in task.free])
    step, std, promise = linear_step(problem, normal, moves)
    own = np.array([n in start.amplitudes and n.rpartition(".")[2] in sizes for n in task.free])
    std = np.where(own, alone(problem, normal, own, moves & ~own), std)
    values = point.values.copy()
    at = [task.free.index(name) for name in start.amplitudes]
    for j in at:
        values[j] = np.clip(values[j] + step[j], problem.low[j], problem.high[j])
    if np.all(values[at] == problem.low[at]):
        promise = 0.0
    whole = problem.moved(point, *marquardt_step(problem, point, normal, 1e-9, ~moves))
    first = min((Point(values, point.starts), whole), key=lambda p: judge(problem, p, base.noise, masks))
    return Begun(start, problem, first, promise,
                 {n: float(std[j]) for n, j in zip(start.amplitudes, at, strict=True)})
