"""What is reported of the causes that were tried on top of a node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.check.fit import BROKEN, TRIFLE, Model, values_of
from drivetool.check.heldout import Score, total_evidence
from drivetool.check.outcome import CandidateResult, State
from drivetool.check.search.absence import law_of, needed
from drivetool.check.search.attempt import Tried
from drivetool.check.search.decision import Decision
from drivetool.check.search.smallest import VISIBLE, resolved_by
from drivetool.check.starts import FAST
from drivetool.drive.effects import RECORDS
from drivetool.identify.estimate import Parameter


def lines_of(tried: Sequence[Tried], scores: Sequence[Score], decision: Decision, base: Model, gained: float,
             why: Mapping[str, str]) -> tuple[CandidateResult, ...]:
    """One line per cause that was tried on top of the base, the best first.

    gained  log likelihood by the causes that were found before, as the decision had it
    why     cause -> what speaks against it
    """
    by_code = {s.model.code: s for s in scores}
    lines, most = [], max((base.value - t.model.value for t in tried if t.model and not t.absent), default=0.0)
    for t in tried:
        code, s = t.cause.code, by_code.get(t.cause.code)
        common = (code, law_of(t.cause))
        found = t.smallest if s is None or code not in decision.between else resolved_by(
            t.cause, t.smallest, s.model, base)
        sizes = _visible(found, FAST * base.problem.traces[0].step)
        if t.absent is not None:
            lines.append(CandidateResult(*common, t.absent, smallest=sizes, reason=t.reason))
        elif s is None:
            state, reason = _unjudged(t, 0.0 if t.model is None else base.value - t.model.value, most)
            lines.append(CandidateResult(*common, state, smallest=sizes, reason=reason))
        else:
            lines.append(CandidateResult(
                *common, _state(s, decision), s.gain, s.gain_std,
                total_evidence([s], gained) / float(np.log(10.0)), sizes, told(s.model, base),
                why.get(code) or _only_in(s.model), s.sure))
    return tuple(sorted(lines, key=lambda r: (-(r.gain if r.gain is not None else -np.inf), r.code)))


def told(model: Model, base: Model) -> tuple[Parameter, ...]:
    """What a cause was fitted to be; nothing of one that ran away in it."""
    try:
        return values_of(model, base)
    except BROKEN:
        return ()


def _only_in(model: Model) -> str:
    """Which record alone has an event that happened once, if there are others."""
    numbers = {v for n, v in model.task.drive.values.items() if n.endswith(RECORDS) and v > 0.0}
    names = dict.fromkeys(t.name for t in model.problem.traces if t.record in numbers)
    return f"Only {', '.join(names)} has it." if names else ""


def _visible(resolved: Mapping[str, float], shortest: float) -> dict[str, float]:
    """Smallest sizes that would have been seen; of a bandwidth the largest, whose lag is at least the shortest."""
    return {n: 1.0 / max(VISIBLE * v, shortest) if n.endswith(".bandwidth") else VISIBLE * v
            for n, v in resolved.items() if np.isfinite(v) and v > 0.0}


def _unjudged(t: Tried, gain: float, most: float) -> tuple[State, str]:
    """State and reason of a cause that had no chance on data held out."""
    if gain > TRIFLE:
        return "worse", (f"on the records it is fitted to it gains {gain:.0f} of log likelihood, the likeliest "
                         f"cause {most:.0f}")
    if t.smallest and all(not np.isfinite(v) for v in t.smallest.values()):
        return "not-shown", needed(t.cause)
    if t.model is None:
        return "no-gain", "what one linear step promises is not worth a fit"
    return "no-gain", "it does not make the records it is fitted to more likely"


def _state(s: Score, decision: Decision) -> State:
    if s.model.code in decision.between:
        return "named" if len(decision.between) == 1 else "possible"
    return "worse" if s.gain > 0.0 else "no-gain"
