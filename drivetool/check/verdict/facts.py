"""What a verdict is made from: figures and names of a finished search, each computed once."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from drivetool.check.causes import CAUSES
from drivetool.check.fit import BROKEN
from drivetool.check.heldout import error_by_noise
from drivetool.check.outcome import Facts, Gain, taken_for_noise
from drivetool.check.starts import torque_size
from drivetool.check.verdict.by_speed import share_by_speed
from drivetool.drive.effects import TORQUES
from drivetool.identify.estimate import Estimate

if TYPE_CHECKING:
    from drivetool.check.search import Searched

PLAIN = 50.0  # log likelihood on data held out from which an event is one whatever blocks say

FACTS: Mapping[str, str] = MappingProxyType({
    "faults": "causes that lie in the records",
    "by_model": "those of them that only the drive tells, which may lack a law",
    "causes": "laws that were found",
    "between": "laws found that have rivals, and these",
    "strongest": "the law with the largest evidence",
    "hardly": "laws that blocks of data held out tell by less than two standard errors, plain events aside",
    "unasked": "what explains the records but was not to be looked for",
    "gained": "log likelihood gained on data held out",
    "left": "log likelihood that one-step errors still ask for, beyond what chance gives",
    "left_time": "the same by values of its own for each half of the records",
    "repeats": "whether one-step errors of the last fit are correlated",
    "before": "rms error of free runs over data held out without the laws found, fitted to the same samples",
    "after": "the same with them",
    "scatter": "what a difference of these errors is weighed against, from their scatter over blocks",
    "floor": "noise of the sensor alone, in the same unit",
    "by_noise": "the error of free runs that the model's own noise makes; none where no law could hide behind it",
    "left_percent": "`left` in per cent of what could be explained",
    "torque_noise": "std of the torque's noise over the spread of the torque",
    "load_changes": "instants at which a load changes",
    "by_speed": "share of these loads' variance that a function of the speed has; none with fewer than two",
    "other_values": "whether records held out ask for other values",
})


def facts_of(search: Searched, estimate: Estimate) -> Facts:
    """The facts of a search and of the last fit of what it found."""
    found, gain = search.found, search.judged_gain()
    share = estimate.noise.get("torque_std", 0.0) / torque_size(search.first.model)
    changes = sum(n.endswith(TORQUES) for n in search.model.task.free) if "load-step" in found.causes else 0
    return Facts(
        tuple(dict.fromkeys(f.code for f in search.faults)),
        tuple(dict.fromkeys(f.code for f in search.faults if all(
            other.shaft for other in search.faults if other.code == f.code))),
        tuple(found.causes), found.between,
        max(found.causes, key=lambda c: found.evidence[c], default=""), hardly_told(search), search.unasked,
        found.gained, search.left.total, search.left.time, estimate.repeats, gain.held_out_rmse_before,
        gain.held_out_rmse_after, gain.rmse_bar, gain.noise_floor, _made_by_noise(search, gain, share),
        gain.unexplained_percent, share, changes, share_by_speed(search.model) if changes > 1 else None,
        search.change is not None)


def hardly_told(search: Searched) -> tuple[str, ...]:
    """The causes of which the blocks held out hardly agree that they are there at all.

    A small step at a reversal is what breakaway friction leaves that no candidate says. An event is in one block
    only, whatever the others say.
    """
    return tuple(c.code for one in search.rounds for c in one.candidates
                 if c.code == one.cause and c.code in search.found.causes and not c.sure
                 and c.code not in search.found.sure and not (CAUSES[c.code].event and (c.gain or 0.0) > PLAIN))


def _made_by_noise(search: Searched, gain: Gain, share: float) -> float | None:
    """The error of free runs that noise makes, where a law may hide behind it; None elsewhere."""
    if not search.found.causes or not taken_for_noise(
            gain.held_out_rmse_before, gain.held_out_rmse_after, gain.noise_floor, share):
        return None
    try:
        return error_by_noise(search.trained, search.folds)
    except BROKEN:  # nothing is known of it: as if it made none
        return 0.0
