"""The report of the causes that were fitted on top of a node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.check.fit import FIT_ERRORS, MIN_TESTABLE_GAIN, Model, added_parameters
from drivetool.check.heldout import Score, total_evidence
from drivetool.check.outcome import CandidateResult, SizeSection, State
from drivetool.check.search.absence import law_of, needed
from drivetool.check.search.candidate_fit import CandidateFit
from drivetool.check.search.decision import Decision
from drivetool.check.search.detection_limit import DETECTION_STDS, detection_limits_with_cause
from drivetool.check.starts import MIN_LAG_SAMPLES
from drivetool.drive.effects import STEP_RECORDS
from drivetool.identify.estimate import Parameter
from drivetool.quantity import quantity_of


def candidate_results(candidates: Sequence[CandidateFit], scores: Sequence[Score], decision: Decision, base: Model,
                      gained: float,
                      rejected: Mapping[str, str]) -> tuple[CandidateResult, ...]:
    """One result per cause that was fitted on top of the base, the best first.

    gained    log likelihood by the causes that were found before, as the decision had it
    rejected  cause -> why held-out data reject it
    """
    by_code = {s.model.code: s for s in scores}
    lines, largest_gain = [], max((base.value - t.model.value for t in candidates if t.model and not t.absent),
                                  default=0.0)
    for t in candidates:
        code, s = t.cause.code, by_code.get(t.cause.code)
        found = t.smallest if s is None or code not in decision.between else detection_limits_with_cause(
            t.cause, t.smallest, s.model, base)
        law, sizes = law_of(t.cause), _detectable_sizes(found, base)
        if t.absent is not None or s is None:
            state, reason = _untested_state(t, 0.0 if t.model is None else base.value - t.model.value, largest_gain)
            lines.append(CandidateResult(code, state, law=law, smallest=sizes, reason=reason))
        else:
            lines.append(CandidateResult(
                code, tested_state(s, decision), law=law, gain=s.gain, gain_std=s.gain_std,
                evidence=total_evidence([s], gained) / float(np.log(10.0)), smallest=sizes,
                parameters=fitted_parameters(s.model, base), reason=rejected.get(code) or _event_records(s.model),
                sure=s.sure))
    return tuple(sorted(lines, key=lambda r: (-(r.gain if r.gain is not None else -np.inf), r.code)))


def fitted_parameters(model: Model, base: Model) -> dict[str, Parameter]:
    """The fitted parameters of a cause by name; none if its fit diverged."""
    try:
        return {p.name: p for p in added_parameters(model, base)}
    except FIT_ERRORS:
        return {}


def _event_records(model: Model) -> str:
    """Which records contain a single event, if there are others."""
    numbers = {v for n, v in model.task.drive.values.items() if quantity_of(n) in STEP_RECORDS and v > 0.0}
    names = dict.fromkeys(t.name for t in model.problem.traces if t.record in numbers)
    return f"The event is in {', '.join(names)} only." if names else ""


def _detectable_sizes(resolved: Mapping[str, float], base: Model) -> dict[str, SizeSection]:
    """Smallest detectable sizes; of a bandwidth the largest, whose lag is at least the shortest."""
    shortest, drive = MIN_LAG_SAMPLES * base.problem.traces[0].step, base.task.drive
    return {n: SizeSection(1.0 / max(DETECTION_STDS * v, shortest) if quantity_of(n) == "bandwidth"
                           else DETECTION_STDS * v, drive.unit(n))
            for n, v in resolved.items() if np.isfinite(v) and v > 0.0}


def _untested_state(t: CandidateFit, gain: float, largest_gain: float) -> tuple[State, str]:
    """State and reason of a cause that was not tested on held-out data."""
    if t.absent is not None:
        return t.absent, t.reason
    if gain > MIN_TESTABLE_GAIN:
        return "worse", (f"on the fitted records it gains {gain:.0f} of log likelihood; the likeliest cause gains "
                         f"{largest_gain:.0f}")
    if t.smallest and all(not np.isfinite(v) for v in t.smallest.values()):
        return "not-shown", needed(t.cause)
    if t.model is None:
        return "no-gain", "its expected gain is too small for a fit"
    return "no-gain", "it does not make the records it is fitted to more likely"


def tested_state(s: Score, decision: Decision) -> State:
    """State of a cause that was tested on held-out data."""
    if s.model.code in decision.between:
        return "named" if len(decision.between) == 1 else "possible"
    return "worse" if s.gain > 0.0 else "no-gain"
