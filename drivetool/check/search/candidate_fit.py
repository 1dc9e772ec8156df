"""The multi-start fit of one cause on top of a node: starts screened, the best fitted, the best end converged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drivetool.check.causes import Cause
from drivetool.check.fit import (
    FIRST_FIT_ITERATIONS,
    FIT_ERRORS,
    MAX_FIT_ITERATIONS,
    MIN_TESTABLE_GAIN,
    SIZE_SIGNIFICANCE,
    Masks,
    Model,
    added_parameters,
    fit,
    on_task,
    third_mass_of,
    transferred_point,
)
from drivetool.check.outcome import State
from drivetool.check.search.absence import needed, why_absent
from drivetool.check.search.detection_limit import detection_limits
from drivetool.check.search.prepared_start import (
    PreparedStart,
    ReferenceModel,
    kind_of,
    prepare_start,
    reference_model,
    with_cause_bounds,
)
from drivetool.identify.laws import third_mass_names
from drivetool.identify.setup import Task
from drivetool.quantity import quantity_of, with_parts

# A choice: one start may end in a worse optimum, each further one costs a full fit.
MAX_STARTS_PER_KIND = 2
# The same where the likelihood has many local optima: the deepest is not known beforehand.
MAX_STARTS_MULTIMODAL = 3
# Share of the best expected gain. A choice: a full fit gains at most MAX_GAIN_RATIO = 4 times its expected gain.
MIN_START_GAIN_SHARE = 0.1
# Share of the best cause's gain. A choice: a first fit that reaches less than half can neither lead nor tie.
MIN_GAIN_SHARE = 0.5
# Log likelihood, and share of the best gain, by which an end of another kind may be behind and still be fitted to
# convergence. A choice: while torque noise has yet to fall, the wrong kind may lead by as much.
OTHER_KIND_LEAD = 50.0
OTHER_KIND_LEAD_SHARE = 0.7


@dataclass(frozen=True)
class CandidateFit:
    """A cause on top of a node: where its fits may start, or its fit to all training samples.

    model            None if there was nothing to fit, or every fit failed: `absent` says which, `reason` why
    smallest         standard deviation of each amplitude, of the lag for a bandwidth: what the record resolves
    prepared_starts  the largest expected gain first
    """

    cause: Cause
    model: Model | None = None
    smallest: Mapping[str, float] = field(default_factory=dict)
    absent: State | None = None
    reason: str = ""
    prepared_starts: tuple[PreparedStart, ...] = ()

    @property
    def expected_gain(self) -> float:
        """Of the best start."""
        return max((b.expected_gain for b in self.prepared_starts), default=-np.inf)


def screen(cause: Cause, references: Sequence[ReferenceModel], masks: Masks) -> CandidateFit:
    """Where the fits of a cause may start on top of reference models; the first is the node's own model."""
    found, resolved, reason = [], {}, ""
    for place, reference in enumerate(references):
        try:
            starts = cause.starts(reference.model)
        except FIT_ERRORS as error:
            reason = f"no start values for its fit: {error}"
            continue
        each = []
        for start in starts:
            try:
                base_reference = reference if start.quiet is None else reference_model(start.quiet)
                each.append(replace(prepare_start(base_reference, cause, start, masks), reference=place))
            except FIT_ERRORS as error:
                reason = f"every fit failed: {error}"
        if place == 0:
            if not starts:
                return CandidateFit(cause, None, {}, *why_absent(cause, reference.model))
            resolved = detection_limits(reference.model, cause, [b.std for b in each])
        found += each
    if not found:
        return CandidateFit(cause, None, resolved, "failed", reason)
    if resolved and not any(np.isfinite(v) for v in resolved.values()):
        return CandidateFit(cause, None, resolved, "not-shown", needed(cause))
    return CandidateFit(
        cause, smallest=resolved, prepared_starts=tuple(sorted(found, key=lambda b: -b.expected_gain)))


def attempt(screened: CandidateFit, base: Model, masks: Masks, more: Iterable[Model] = (),
            goal: float = np.inf) -> CandidateFit:
    """A cause fitted from its best starts, the best ends to convergence. A fit that fails is a result.

    more  further models to start from
    goal  value of the likeliest cause so far: a fit that is far from it after a few iterations stops
    """
    cause, reason, ends = screened.cause, screened.reason, []
    max_per_kind = MAX_STARTS_MULTIMODAL if cause.multimodal else MAX_STARTS_PER_KIND if np.isinf(goal) else 1
    starts = [*_select_starts(screened, max_per_kind), *more]
    for start in starts:
        try:
            model = start.ready(masks) if isinstance(start, PreparedStart) else start
            ends.append(fit(model, masks, max_iterations=FIRST_FIT_ITERATIONS, goal=goal))
        except FIT_ERRORS as error:
            reason = str(error)
    ends = sorted((m for m in ends if np.isfinite(m.value)), key=lambda m: m.value)
    if cause.ends is not None:
        ends = sorted((*ends, *cause.ends(base, masks)), key=lambda m: m.value)
    finished = []
    for model in _select_ends(ends, base, cause.multimodal):
        if base.value - model.value < MIN_GAIN_SHARE * (base.value - goal):
            finished.append(model)
            continue
        try:
            model = fit(model, masks)
            finished.append(cause.refined(model, base, masks, refitted) if cause.refined is not None else model)
        except FIT_ERRORS as error:
            reason = str(error)
    if not finished:
        # Without a start that is worth a fit, no fit has failed.
        return CandidateFit(cause, None, screened.smallest,
                            *(("failed", f"its fit failed: {reason}") if starts else ()))
    best = min(finished, key=lambda m: m.value)
    return screened_for_significance(CandidateFit(cause, best, screened.smallest), base)


def _select_starts(screened: CandidateFit, max_per_kind: int) -> list[PreparedStart]:
    """The starts that are worth a fit: of each kind, on each reference model, the largest expected gains."""
    chosen: dict[tuple[object, ...], list[PreparedStart]] = {}
    for b in screened.prepared_starts:
        of_kind = chosen.setdefault(b.kind, [])
        if len(of_kind) < max_per_kind and b.expected_gain > max(
                MIN_TESTABLE_GAIN, MIN_START_GAIN_SHARE * screened.expected_gain):
            of_kind.append(b)
    return [b for of_kind in chosen.values() for b in of_kind]


def _select_ends(ends: Sequence[Model], base: Model, multimodal: bool) -> list[Model]:
    """The best end, and those of another kind that are close to it or gain nearly as much.

    While the torque noise is still too large, a lag of the wrong order, or a drag on the wrong body, may lead.
    A likelihood with many local optima gets the best three: which one is deepest is not known yet.
    """
    if multimodal or not ends:
        return list(ends[:MAX_STARTS_MULTIMODAL])
    near = ends[0].value + max(OTHER_KIND_LEAD, OTHER_KIND_LEAD_SHARE * (base.value - ends[0].value))
    likeliest: dict[tuple[object, ...], Model] = {}
    for m in ends:
        if m.value < near:
            likeliest.setdefault(kind_of(m), m)
    return list(likeliest.values())


def refitted(model: Model, task: Task, base: Model, masks: Masks, most: int = MAX_FIT_ITERATIONS) -> Model:
    """A cause fitted with other parameters free, from its own estimate; base: lacks it, most: iterations."""
    return fit(with_cause_bounds(on_task(model, task), base), masks, max_iterations=most)


def as_special_case(simple: CandidateFit, general: CandidateFit, base: Model, masks: Masks) -> CandidateFit:
    """A cause fitted again from the end of a law that contains it, if that is likelier.

    A special case that only stopped in a worse optimum must not lose to the general law.
    """
    if (simple.model is None or general.model is None
            or general.model.value > simple.model.value - MIN_TESTABLE_GAIN):
        return simple
    own, values = simple.model, general.model.fitted.drive.values
    # The static surplus of a Stribeck friction counts as Coulomb friction.
    new = {n: values.get(n, 0.0) + values.get(with_parts(n, quantity="stribeck"), 0.0)
           if quantity_of(n) == "coulomb"
           else values[n] for n in own.task.free if n in values}
    task = own.task.at(new)
    try:
        trial = fit(replace(own, task=task, point=transferred_point(general.model, task, own.problem),
                            noise=general.model.noise), masks)
    except FIT_ERRORS:
        return simple
    return replace(simple, model=trial) if trial.value < own.value else simple


def screened_for_significance(candidate: CandidateFit, base: Model) -> CandidateFit:
    """The same, absent if its size is not significant, or its own file finds it implausible.

    The gain then comes from the other parameters; of a third mass from a start state that decays.
    """
    model, cause = candidate.model, candidate.cause
    assert model is not None
    why = cause.implausible(model, base) if cause.implausible is not None else ""
    if why:
        return replace(candidate, reason=why, absent="no-gain")
    has_third_mass = model.task.drive.bodies != base.task.drive.bodies
    if not (candidate.smallest or has_third_mass) or cause.trace is not None:
        return candidate
    try:
        significance = {p.name: abs(p.value / p.std) for p in added_parameters(model, base) if p.std}
    except FIT_ERRORS:
        return candidate
    names = third_mass_names(base.task.drive,
                             third_mass_of(model.task.drive))[:1] if has_third_mass else candidate.smallest
    sizes = [significance[n] for n in names if n in significance and (has_third_mass or cause.has(n))]
    if max(sizes, default=0.0 if has_third_mass else np.inf) > SIZE_SIGNIFICANCE:
        return candidate
    return replace(candidate, reason="its size does not differ significantly from zero", absent="no-gain")
