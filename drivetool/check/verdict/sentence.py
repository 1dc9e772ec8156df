"""The verdict as a sentence, and what to record next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from drivetool.check.causes import CAUSES, DECISIVE_EXPERIMENTS
from drivetool.check.outcome import LARGE_ERROR_TO_NOISE, OUTSIDE_CATALOGUE, Gain
from drivetool.check.search import needs_of


def experiment_of(between: Sequence[str], verdict: str, shafts: bool = True, logged: Sequence[str] = (),
                  doubt: str = "", laws: bool = True) -> str:
    """The experiment that would decide, or reveal more.

    shafts  whether the drive has more than one body; logged: roles of the sensors that the records have
    doubt   why it may be something in no catalogue; empty: the torque noise
    laws    whether a law was found; else the cause is a fault of the record
    """
    if verdict == "named" and not laws:
        return ("Correct the channel in the drive's logger or in the channel map, and run greybox on the record "
                "again.")
    if OUTSIDE_CATALOGUE in between and verdict == "undetermined" and not doubt:
        return ("Hold the torque constant for some seconds at several levels: torque noise then persists, the "
                f"effect of an unmodelled law disappears.{_sensors_to_add(shafts, logged)}")
    if verdict == "undetermined" and not doubt:
        return experiment_between(between)
    if verdict == "unexplained" or doubt:
        return ("Repeat the record at other speeds and torques, and look at the residual over speed, torque and "
                f"angle in the report.{_sensors_to_add(shafts, logged)}")
    if verdict == "nothing-found":
        return "Larger torque, more reversals or a longer record would make smaller effects detectable."
    return "Repeat the diagnosis on a fresh record of the machine with the extended file as its base."


def experiment_between(codes: Sequence[str]) -> str:
    """What to record to decide between causes."""
    found = [DECISIVE_EXPERIMENTS[frozenset((a, b))] for i, a in enumerate(codes) for b in codes[i + 1:]
             if frozenset((a, b)) in DECISIVE_EXPERIMENTS]
    if found:
        return " ".join(dict.fromkeys(found))
    needs = "; ".join(f"for {code} {needs_of(CAUSES[code])}" for code in codes)
    return f"Record data that distinguish them: {needs}."


def _sensors_to_add(shafts: bool, logged: Sequence[str]) -> str:
    """The sensors behind the shaft that the records do not have yet."""
    roles = {"load speed": ("load_speed", "load_angle"), "shaft torque": ("shaft_torque",)}
    lacking = [words for words, any_of in roles.items() if not set(any_of) & set(logged)] if shafts else []
    return f" Log the {' or the '.join(lacking)} too." if lacking else ""


def sentence_of(verdict: str, codes: tuple[Sequence[str], Sequence[str], Sequence[str]], not_requested: str,
                gain: Gain, share: float, full_record_rmse: float = np.inf, doubt: str = "",
                in_base: Sequence[str] = (), sizes: Mapping[str, str] = MappingProxyType({})) -> str:
    """The verdict for a plant engineer.

    codes             what is certain, what it is between, and all that was found, in the order found
    not_requested     a cause that explains the record but was not among the requested candidates
    share             std of the torque noise over the std of the torque
    full_record_rmse  rms free-run error of the drive fitted to the whole record
    doubt             why it may be something that is in no catalogue; empty: the torque noise
    in_base           causes that the base has already
    sizes             cause -> how large it is, in words
    """
    causes, between, found = codes
    laws, faults = [c for c in causes if c in found], _joined_causes([c for c in causes if c not in found])
    first = f"The record is at fault: {faults}. In addition, the model" if faults else "The model"
    way = "falls" if gain.held_out_rmse_after < gain.held_out_rmse_before else "goes"
    where = "on held-out data the error of free runs of {:.3g} s" if gain.of == "motion" else (
        "on held-out data the error of the required torque")
    better = (f"{where.format(gain.segment)} {way} from "
              f"{gain.held_out_rmse_before:.4g} to {gain.held_out_rmse_after:.4g} {gain.unit}")
    if verdict == "named":
        left = "" if not gain.unexplained_percent >= 1.0 else (
            f"; {gain.unexplained_percent:.0f} % of the explainable residual remains")
        if not found:
            return (f"The record is at fault, not the simulation: {faults}. No cause of the catalogue "
                    "explains anything further in the record.")
        laws_text = " and ".join(_cause_text(c) + (f", {sizes[c]}" if c in sizes else "") for c in laws)
        return (f"{first} lacks {laws_text}. {_error_text(gain, len(laws))}{left}"
                f"{_noise_text(gain, full_record_rmse, share)}.")
    if verdict == "undetermined":
        if doubt:
            certain = f"{_joined_causes(laws)}, and " if laws else ""
            maybe = _joined_causes([c for c in found if c in between])
            rivals = [_cause_text(c) for c in between if c not in found and c != OUTSIDE_CATALOGUE]
            maybe += f" (or {' or '.join(rivals)} in place of one of them)" if rivals else ""
            return (f"{first} lacks {certain}{maybe}, or an effect outside the catalogue of which this is "
                    f"a part: {better}, but {doubt}.")
        either = " or ".join(_cause_text(c) for c in between if c != OUTSIDE_CATALOGUE)
        lacks = f"{first} lacks {_joined_causes(laws) or 'an effect'}{', and one further cause' * bool(laws)}: "
        if OUTSIDE_CATALOGUE in between:
            return (f"{lacks}{either} explains it best, but {better}, {_error_to_noise(gain):.0f} times the "
                    f"sensor's own noise: either the torque has noise of {100.0 * share:.0f} % of its standard "
                    "deviation, or another law is at work.")
        return f"{lacks}{either} explain the record equally well; {better}."
    if verdict == "unexplained":
        return _unexplained_text(found, not_requested, gain, better)
    own = f" The base model already contains {_joined_causes(in_base)}." if in_base else ""
    return ("Nothing was found: no cause of the catalogue explains anything in the record beyond noise."
            f"{own}")


def _unexplained_text(found: Sequence[str], not_requested: str, gain: Gain, better: str) -> str:
    """The sentence where no cause explains the residual; better: the gain by the causes found."""
    closest = " and then ".join(map(_cause_text, found))
    near = (f" {closest[:1].upper()}{closest[1:]} {'is' if len(found) == 1 else 'are'} the closest "
            f"candidate{'s' * (len(found) > 1)} ({better}), but" if closest else "")
    if not_requested:
        return ("The model lacks an effect that none of the requested candidates explains"
                f"{'.' if near else ';'}{near} {_cause_text(not_requested)}, which was not requested, explains it.")
    rest = f" {gain.unexplained_percent:.0f} % of the explainable residual remains."
    if not np.isfinite(gain.unexplained_percent):
        rest, near = "", near.removesuffix(", but") + "." * bool(near)
    return f"The model lacks an effect that no cause of the catalogue explains.{near}{rest}"


def _error_text(gain: Gain, laws: int) -> str:
    """The error of the simulation without the causes found, and with them."""
    what = "position" if "/" not in gain.unit else "speed"
    pronoun = "it" if laws == 1 else "them"
    before, after = (f"{e:.3g} {gain.unit}" for e in (gain.held_out_rmse_before, gain.held_out_rmse_after))
    if gain.of == "torque":
        return (f"Without {pronoun} the required torque has an rms error of {before} on held-out data, "
                f"with {pronoun} of {after}")
    return (f"Without {pronoun} the simulated {what} has an rms error of {before} on held-out data, "
            f"with {pronoun} of {after}, in free runs of {gain.segment:.3g} s")


def _cause_text(code: str) -> str:
    """A cause in plain words, with its code."""
    name = CAUSES[code].name
    return name if name == code.replace("-", " ") else f"{name} ({code})"


def _joined_causes(codes: Sequence[str]) -> str:
    return " and ".join(map(_cause_text, codes))


def _error_to_noise(gain: Gain) -> float:
    """Free-run error over the sensor's noise."""
    return gain.held_out_rmse_after / gain.noise_floor if gain.noise_floor > 0.0 else 0.0


def _noise_text(gain: Gain, full_record_rmse: float, share: float) -> str:
    """The torque noise that may hide a cause in no catalogue, or that half a record is too little."""
    if not np.isfinite(_error_to_noise(gain)) or _error_to_noise(gain) < LARGE_ERROR_TO_NOISE:
        return ""
    if full_record_rmse < LARGE_ERROR_TO_NOISE * gain.noise_floor:
        return (f"; that is still {_error_to_noise(gain):.0f} times the sensor's own noise, although a "
                "fit to the whole record reaches this noise: half of the record is too short to predict the other "
                "half")
    return (f"; the remaining error is {_error_to_noise(gain):.0f} times the sensor's own noise, and the model "
            f"attributes it to torque noise of {100.0 * share:.2g} % of the torque's standard deviation")
