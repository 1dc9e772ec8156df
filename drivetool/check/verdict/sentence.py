"""The verdict in a sentence, and what to record next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from drivetool.check.causes import CAUSES, DECIDES
from drivetool.check.outcome import LOUD, UNLISTED, Gain
from drivetool.check.search import needs_of


def experiment_of(between: Sequence[str], verdict: str, shafts: bool = True, logged: Sequence[str] = (),
                  doubt: str = "", laws: bool = True) -> str:
    """What would decide, or show more.

    shafts  whether the drive has more than one body; logged: roles of the sensors that the records have
    doubt   why it may be something in no catalogue; empty: the torque's noise
    laws    whether a law was found; else what is named is a fault of the record
    """
    if verdict == "named" and not laws:
        return "Mend the channel, in the drive's logger or by the channel map, and run greybox on the record again."
    if UNLISTED in between and verdict == "undetermined" and not doubt:
        return ("Hold the torque for some seconds at several levels: a noise of the torque is there too, the "
                f"effect of a law that is missing is not.{_further(shafts, logged)}")
    if verdict == "undetermined" and not doubt:
        return experiment_between(between)
    if verdict == "unexplained" or doubt:
        return ("Repeat the record at other levels, and look at the residual over speed, torque and angle in the "
                f"report.{_further(shafts, logged)}")
    if verdict == "nothing-found":
        return "Larger torque, more reversals or a longer record would show smaller effects."
    return "Repeat the diagnosis on a fresh record of the machine with the extended file as its base."


def experiment_between(codes: Sequence[str]) -> str:
    """What to record to decide between causes."""
    found = [DECIDES[frozenset((a, b))] for i, a in enumerate(codes) for b in codes[i + 1:]
             if frozenset((a, b)) in DECIDES]
    if found:
        return " ".join(dict.fromkeys(found))
    needs = "; ".join(f"for {code} {needs_of(CAUSES[code])}" for code in codes)
    return f"Record what tells them apart: {needs}."


def _further(shafts: bool, logged: Sequence[str]) -> str:
    """The sensors behind the shaft that the records do not have yet."""
    roles = {"load speed": ("load_speed", "load_angle"), "shaft torque": ("shaft_torque",)}
    lacking = [words for words, any_of in roles.items() if not set(any_of) & set(logged)] if shafts else []
    return f" Log the {' or the '.join(lacking)} too." if lacking else ""


def sentence_of(verdict: str, codes: tuple[Sequence[str], Sequence[str], Sequence[str]], unasked: str, gain: Gain,
                share: float, met: float = np.inf, doubt: str = "", had: Sequence[str] = (),
                sizes: Mapping[str, str] = MappingProxyType({})) -> str:
    """The verdict for a plant engineer.

    codes    what is certain, what it is between, and all that was found, in the order found
    unasked  what explains the record but was not to be looked for
    share    std of the torque's noise over the spread of the torque
    met      rms error of free runs of what was fitted to the whole record
    doubt    why it may yet be something that is in no catalogue; empty: the torque's noise
    had      causes that the base has already
    sizes    cause -> how large it is, in words
    """
    causes, between, found = codes
    words = _and(causes)
    way = "falls" if gain.held_out_rmse_after < gain.held_out_rmse_before else "goes"
    where = "in free runs of {:.3g} s over data held out the error" if gain.of == "motion" else (
        "over data held out the error of the torque that the motion asks for")
    better = (f"{where.format(gain.segment)} {way} from "
              f"{gain.held_out_rmse_before:.4g} to {gain.held_out_rmse_after:.4g} {gain.unit}")
    if verdict == "named":
        left = "" if not gain.unexplained_percent >= 1.0 else (
            f"; {gain.unexplained_percent:.0f} % of what the base left unexplained is still there")
        faults = _and([c for c in causes if c not in found])
        if not found:
            return (f"The record is at fault, not the simulation: {faults}. Apart from that it holds nothing "
                    "beyond noise that a cause in the catalogue would explain.")
        laws = [c for c in causes if c in found]
        told = " and ".join(_said(c) + (f", {sizes[c]}" if c in sizes else "") for c in laws)
        first = f"The record is at fault: {faults}. Beside that the" if faults else "The"
        return f"{first} simulation lacks {told}. {_off(gain, len(laws))}{left}{_loud(gain, met, share)}."
    if verdict == "undetermined":
        if doubt:
            faults, laws = ([c for c in causes if (c in found) == law] for law in (False, True))
            first = f"The record is at fault: {_and(faults)}. Beside that the" if faults else "The"
            certain = f"{_and(laws)}, and " if laws else ""
            maybe = _and([c for c in found if c in between])
            rivals = [_said(c) for c in between if c not in found and c != UNLISTED]
            maybe += f" (or {' or '.join(rivals)} in place of one of them)" if rivals else ""
            return (f"{first} simulation lacks {certain}{maybe}, or something in no catalogue that this is part "
                    f"of: {better}, but {doubt}.")
        either = " or ".join(_said(c) for c in between if c != UNLISTED)
        first = f"The simulation lacks {words or 'something'}{', and one thing more' * bool(causes)}: "
        if UNLISTED in between:
            return (f"{first}{either} explains it best, but {better}, {_times(gain):.0f} times the sensor's own "
                    f"noise: either the torque has noise of {100.0 * share:.0f} % of its spread, or another law is "
                    "at work.")
        return f"{first}{either} explain the record equally well; {better}."
    if verdict == "unexplained":
        return _unexplained(found, unasked, gain, better)
    own = f" The drive it was given has {_and(had)} already." if had else ""
    return ("Nothing was found: the record holds nothing beyond noise that a cause in the catalogue would "
            f"explain.{own}")


def _unexplained(found: Sequence[str], unasked: str, gain: Gain, better: str) -> str:
    """What is said where something is left that no cause is; better: what those that were found bring."""
    closest = ", then ".join(map(_said, found))
    near = (f" {closest[:1].upper()}{closest[1:]} come{'s' * (len(found) == 1)} closest ({better}), but"
            if closest else "")
    if unasked:
        known = _said(unasked)
        return f"Something is missing that none of the candidates explains;{near} {known} would."
    rest = f" {gain.unexplained_percent:.0f} % of what could be explained is left."
    if not np.isfinite(gain.unexplained_percent):
        rest, near = "", near.removesuffix(", but") + "." * bool(near)
    return f"Something is missing that no cause in the catalogue explains.{near}{rest}"


def _off(gain: Gain, laws: int) -> str:
    """How far off the simulation is without what was found, and with it."""
    what = "position" if "/" not in gain.unit else "speed"
    them = "it" if laws == 1 else "them"
    before, after = (f"{e:.3g} {gain.unit}" for e in (gain.held_out_rmse_before, gain.held_out_rmse_after))
    if gain.of == "torque":
        return (f"Without {them} the torque that the motion asks for is off by {before} over data held out, with "
                f"{them} by {after}")
    return (f"Without {them} the simulated {what} is off by {before} over data held out, with {them} by {after}, "
            f"in free runs of {gain.segment:.3g} s")


def _said(code: str) -> str:
    """A cause in the words of the plant, and by its code."""
    name = CAUSES[code].name
    return name if name == code.replace("-", " ") else f"{name} ({code})"


def _and(codes: Sequence[str]) -> str:
    return " and ".join(map(_said, codes))


def _times(gain: Gain) -> float:
    """Error of free runs over the sensor's noise."""
    return gain.held_out_rmse_after / gain.noise_floor if gain.noise_floor > 0.0 else 0.0


def _loud(gain: Gain, met: float, share: float) -> str:
    """What a cause that is in no catalogue may hide behind, or that half a record is too little."""
    if not np.isfinite(_times(gain)) or _times(gain) < LOUD:
        return ""
    if met < LOUD * gain.noise_floor:
        return (f"; that is still {_times(gain):.0f} times the sensor's own noise, though the drive that is fitted "
                "to all of the record meets it: half of it tells too little of the other half")
    return (f"; what is left, {_times(gain):.0f} times the sensor's own noise, the model puts down to a noise of "
            f"the torque of {100.0 * share:.2g} % of its spread")
