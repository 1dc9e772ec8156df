"""What a finished search amounts to: a verdict, and why it may yet be something else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivetool.check.causes import CAUSES
from drivetool.check.diagnosis import UNLISTED, Gain
from drivetool.check.fit.model import BROKEN
from drivetool.check.fit.noise_run import error_by_noise
from drivetool.check.report.by_speed import share_by_speed
from drivetool.check.report.sentence import taken_for_noise
from drivetool.drive.effects.load_step import TORQUES
from drivetool.errors import Finding
from drivetool.identify.estimate import Estimate

if TYPE_CHECKING:
    from drivetool.check.search.result import Searched

UNEXPLAINED = 25.0  # log likelihood to be had, beyond what chance gives, before something is said to be wrong
WORSE = 0.25  # of the error of free runs, beyond its scatter, by which causes that are true do not raise it
PART = 0.3  # of that error, or of what could be explained, that is part of the answer
SURELY = 2.0  # standard errors of a gain on data held out
PLAIN = 50.0  # log likelihood on data held out from which an event is one whatever blocks say
SOME = 0.05  # of the torque's spread: a noise of the torque as drives have it
FORETOLD = 1.5  # of the error that noise makes, up to which it is no sign of anything else
SCATTER = "data held out tell it by less than two standard errors"
SAME = 0.9  # of the variance of a load that changes several times, from which a function of the speed is one, too
OF_SPEED = "a load that changes with the speed may as well be friction of another law"
SEVERAL = "a load that changes several times can stand in for a law, and what it leaves is not noise alone"


@dataclass(frozen=True)
class Judgement:
    """A verdict.

    causes   what is certain; between: what it may be
    doubt    why that may be something in no catalogue; empty: no such doubt, or the noise of the torque is it
    """

    verdict: str
    causes: tuple[str, ...]
    between: tuple[str, ...]
    doubt: str = ""


def judged(search: Searched, estimate: Estimate, gain: Gain, share: float) -> Judgement:
    """The verdict on a search, from what was found and from what that leaves.

    share  std of the torque's noise over the spread of the torque
    """
    faults = tuple(dict.fromkeys(f.code for f in search.faults))
    causes = (*faults, *[c for c in search.found.causes if c not in search.found.between])
    found = Judgement(verdict_of(search, causes), causes, search.found.between)
    if search.found.causes and doubtful(search, estimate, gain):
        found = replace(found, verdict="unexplained")
    if found.verdict == "unexplained" and helped(search, gain):
        left = f"{gain.unexplained_percent:.0f} % of what could be explained is left"
        between = dict.fromkeys((*search.found.causes, *search.found.between, UNLISTED))
        return Judgement("undetermined", faults, tuple(between), left)
    if found.verdict == "undetermined" and search.found.between and hides(search, gain, share):
        return replace(found, between=tuple(dict.fromkeys((*found.between, UNLISTED))))
    if found.verdict != "named" or not search.found.causes:
        return found
    if hides(search, gain, share):
        return _without(found, [max(search.found.causes, key=lambda c: search.found.evidence[c])])
    hardly = hardly_told(search)
    if hardly:
        return _without(found, hardly, SCATTER)
    why = stands_in(search)
    return _without(found, ["load-step"], why) if why else found


def hides(search: Searched, gain: Gain, share: float) -> bool:
    """Whether a law in no catalogue may hide behind the noise of the torque.

    Not where single steps leave nothing, a drive may have so much noise, and that alone makes as large an error of
    free runs: a law that stands behind it would have to be as quick as noise, and go astray no further.

    share  std of the torque's noise over the spread of the torque
    """
    if not taken_for_noise(gain, share):
        return False
    if share > SOME or search.left.total > 0.0:
        return True
    try:
        return gain.held_out_rmse_after > FORETOLD * error_by_noise(search.trained, search.folds)
    except BROKEN:
        return True


def _without(found: Judgement, doubted: Sequence[str], doubt: str = "") -> Judgement:
    """The judgement with some of its causes no longer certain."""
    causes = tuple(c for c in found.causes if c not in doubted)
    return Judgement("undetermined", causes, (*doubted, UNLISTED), doubt)


def verdict_of(search: Searched, causes: Sequence[str]) -> str:
    """The verdict by what was found and how much that leaves of what single steps ask for."""
    if search.unasked or (search.found.causes and not search.confident):
        return "unexplained"
    if search.found.between:
        return "undetermined"
    # Rounding repeats where the motion is slow: what it leaves is no sign of anything else.
    if not search.found.causes and search.left.total > UNEXPLAINED and "quantisation" not in causes:
        return "unexplained"
    return "named" if causes else "nothing-found"


def doubtful(search: Searched, estimate: Estimate, gain: Gain) -> bool:
    """Whether what the causes leave speaks against them: they stand in for a law that is not listed.

    One-step errors that still repeat, halves that ask for other parameters, free runs clearly worse than before.
    What steps of the logger leave repeats too.
    """
    repeats = "innovations-correlated" in {f.code for f in estimate.findings}
    steps = "quantisation" in {f.code for f in search.faults}
    return (repeats and not steps) or bool(changing(search)) or spoils(gain)


def helped(search: Searched, gain: Gain) -> bool:
    """Whether what was found is part of the answer.

    Free runs become much better with it, or it says much of what there is to say about single steps.
    """
    if not search.found.causes or search.unasked or spoils(gain):
        return False
    better = gain.held_out_rmse_before - gain.held_out_rmse_after
    return (better > max(PART * gain.held_out_rmse_before, SURELY * gain.rmse_bar)
            or gain.unexplained_percent < 100.0 * (1.0 - PART))


def hardly_told(search: Searched) -> list[str]:
    """The causes of which the blocks held out hardly agree that they are there at all, plain events aside.

    A small step at a reversal is what breakaway friction leaves that no candidate says.
    """
    return [c.code for one in search.rounds for c in one.candidates
            if c.code == one.cause and c.code in search.found.causes and not c.sure
            and c.code not in search.found.sure and not (CAUSES[c.code].event and (c.gain or 0.0) > PLAIN)]


def stands_in(search: Searched) -> str:
    """Why a load that changes at more than one instant may be a law in no catalogue; empty: it is none.

    True ones leave noise, and do not come and go with the speed: by direction, say, a friction of another size is a
    load at the reversals.
    """
    changes = sum(n.endswith(TORQUES) for n in search.model.task.free)
    if "load-step" not in search.found.causes or changes < 2:
        return ""
    if search.left.total > 0.0:
        return SEVERAL
    return OF_SPEED if share_by_speed(search.model) > SAME else ""


def spoils(gain: Gain) -> bool:
    """Whether free runs over data held out are clearly worse with what was found."""
    worse = gain.held_out_rmse_after - gain.held_out_rmse_before
    return worse > max(WORSE * gain.held_out_rmse_before, gain.rmse_bar)


def changing(search: Searched) -> list[Finding]:
    """What to say where the halves of the records ask for different parameters."""
    if search.left.time <= UNEXPLAINED:
        return []
    return [Finding(
        "warning", "parameters-change",
        "The first half of the records asks for other parameters than the second: something changes while it is "
        "recorded, with temperature or wear, say, or a law is missing that the halves show differently.",
        {"log_likelihood": float(search.left.time)},
        "Fit halves by themselves to see which, and record after warming up.")]
