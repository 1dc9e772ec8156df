"""The facts behind a verdict: figures and names of a finished search, each computed once."""

from __future__ import annotations

from drivetool.check.causes import CAUSES
from drivetool.check.fit import FIT_ERRORS
from drivetool.check.heldout import error_by_noise
from drivetool.check.outcome import Facts, Gain, noise_hides_law
from drivetool.check.search import SearchResult
from drivetool.check.starts import torque_size
from drivetool.check.verdict.by_speed import share_by_speed
from drivetool.drive.effects import STEP_TORQUES
from drivetool.identify.estimate import Estimate
from drivetool.quantity import quantity_of

# Log likelihood on held-out data from which an event counts although only one block supports it. A choice: a
# smaller one may be breakaway friction that has no candidate of its own.
CLEAR_EVENT_GAIN = 50.0


def facts_of(search: SearchResult, estimate: Estimate) -> Facts:
    """The facts of a search and of the last fit with the causes found."""
    found, gain = search.found, search.judged_gain()
    share = estimate.noise.get("torque_std", 0.0) / torque_size(search.first.model)
    changes = sum(quantity_of(n) in STEP_TORQUES for n in search.model.task.free if "load-step" in found.causes)
    return Facts(
        tuple(dict.fromkeys(f.code for f in search.faults)),
        tuple(dict.fromkeys(f.code for f in search.faults if all(
            other.shaft for other in search.faults if other.code == f.code))),
        tuple(found.causes), found.between,
        max(found.causes, key=lambda c: found.evidence[c], default=""), weakly_supported(search), search.unasked,
        found.gained, search.left.total, search.left.time, estimate.repeats, gain.held_out_rmse_before,
        gain.held_out_rmse_after, gain.rmse_bar, gain.noise_floor, _error_from_noise(search, gain, share),
        gain.unexplained_percent, share, changes, share_by_speed(search.model) if changes > 1 else None,
        search.change is not None)


def weakly_supported(search: SearchResult) -> tuple[str, ...]:
    """The causes whose gain on held-out blocks is below two standard errors.

    Breakaway friction without its own candidate appears as a small step at a reversal. An event lies in one block
    only; the other blocks do not count against it.
    """
    return tuple(c.code for one in search.rounds for c in one.candidates
                 if c.code == one.cause and c.code in search.found.causes and not c.sure
                 and c.code not in search.found.sure
                 and not (CAUSES[c.code].event and (c.gain or 0.0) > CLEAR_EVENT_GAIN))


def _error_from_noise(search: SearchResult, gain: Gain, share: float) -> float | None:
    """The free-run error that noise causes, where a law may hide behind the noise; None elsewhere."""
    if not search.found.causes or not noise_hides_law(
            gain.held_out_rmse_before, gain.held_out_rmse_after, gain.noise_floor, share):
        return None
    try:
        return error_by_noise(search.trained, search.folds)
    except FIT_ERRORS:  # unknown: taken as zero
        return 0.0
