"""A diagnosis in the words of the plant; the terminal and the page share them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from drivetool.check.causes import CAUSES, size_parameters
from drivetool.check.outcome import OUTSIDE_CATALOGUE, CandidateResult, CandidateSection, Diagnosis, Gain, Round
from drivetool.files.tables.number_format import rounded, short
from drivetool.identify.estimate import Parameter

VERDICTS = {"nothing-found": "Nothing found", "named": "Cause found", "undetermined": "Cause undetermined",
            "unexplained": "Residual not fully explained"}
STATES = {"named": "named", "possible": "as good as the best", "worse": "worse than the best",
          "no-gain": "no gain", "not-shown": "not identifiable", "in-the-model": "already in the model",
          "failed": "failed"}
CAPTIONS = {  # in the order of the page
    "diagnosis-record": "Grey: measurement; orange: base model; blue: model with the causes found. "
                        "Where orange departs from grey, the base model is wrong. The shaded part is enlarged "
                        "at the bottom.",
    "diagnosis-candidates": "Increase of the held-out log likelihood with each cause added. A bar whose "
                            "error bar reaches zero shows no significant gain.",
    "diagnosis-residual-time": "An error that recurs at the same events is a property of the machine; one that "
                               "begins once is an event; one that decays is a drift. Free runs start anew "
                               "where the error jumps.",
    "diagnosis-residual-reversal": "All reversals superimposed, the downward ones mirrored. A ringing "
                                   "that starts there is backlash, a ramp that starts there is dry friction.",
    "diagnosis-residual-speed": "A step at zero is dry friction, a hump near zero breakaway friction, a parabola "
                                "drag. A flat curve means that the friction model is correct.",
    "diagnosis-residual-torque": "A slope indicates a wrong stiffness, inertia or torque scale; growth towards the "
                                 "ends indicates a hardening or softening shaft; a bump around zero indicates "
                                 "backlash.",
    "diagnosis-residual-order": "A single peak that the extended model removes is a torque that repeats with the "
                                "angle: ripple, or imbalance at one per turn. With an elastic shaft the "
                                "amplitudes are approximate.",
    "diagnosis-order-map": "An upright ridge is a torque that repeats with the motor's angle, at every speed: "
                           "ripple or cogging. A ridge whose order falls as the speed rises is a disturbance of "
                           "fixed frequency. White is within the noise, or too fast for the sampling rate.",
}


def cause_words(found: CandidateResult, final: Mapping[str, Parameter] = MappingProxyType({}),
               ) -> tuple[str, str, str]:
    """(headline, sentence with its size, what to do) of a cause.

    final  parameters of the extended drive, where it has the cause: rounds after its own have moved its size
    """
    if found.code == OUTSIDE_CATALOGUE:
        return ("Or an effect outside the catalogue", "The residual is larger than the usual noise of sensors "
                "and torques.", "")
    cause = CAUSES.get(found.code)
    name = cause.name if cause else found.code
    sizes = size_parameters(found.code, tuple(found.parameters.values()))
    estimates = [estimate_text(final.get(p.name, p)) for p in sizes]
    # The twist at which the parameter applies.
    estimates += [f"at {estimate_text(final[n])}" for p in sizes if (n := f"{p.name}_twist") in final]
    size = f" The fit gives {', '.join(estimates)}." if estimates else ""
    text = cause.text if cause else f"The model lacks {found.law or found.code}."
    where = found.reason.rstrip(".") if found.state in ("named", "possible") else ""
    where = f" {where[0].upper()}{where[1:]}." if where else ""
    return name[0].upper() + name[1:], text + size + where, cause.look if cause else ""


def estimate_text(parameter: Parameter) -> str:
    """'shaft.half_gap 0.00322 +- 0.00002 rad', with +- only where there is one."""
    value, std = rounded(parameter.value if math.isfinite(parameter.value) else None, parameter.std)
    plus = f" +- {std}" if parameter.std is not None else ""
    return f"{parameter.name} {value}{plus} {parameter.unit}".strip()


def round_words(one: Round) -> str:
    """The decision of one round."""
    if one.cause is None:
        return f"Round {one.round}: no further cause."
    gain = f": {gain_words(one.gain)}" if one.gain else ""
    return f"Round {one.round} added {CAUSES[one.cause].name if one.cause in CAUSES else one.cause}{gain}."


def gain_words(gain: Gain) -> str:
    """'the error of free runs of 2 s over data held out fell from 0.22 to 0.021 rad/s (noise 0.02)'."""
    before, after = short(gain.held_out_rmse_before, 3), short(gain.held_out_rmse_after, 3)
    verb = "fell" if gain.held_out_rmse_after < gain.held_out_rmse_before else "rose"
    noise = f"; the sensor's own noise is {short(gain.noise_floor, 2)}" if math.isfinite(gain.noise_floor) else ""
    what = f"free runs of {gain.segment:g} s" if gain.of == "motion" else "the torque that the motion requires"
    return (f"the error of {what} over data held out {verb} from {before} to {after} "
            f"{gain.unit}{noise}")


def reported_candidates(diagnosis: Diagnosis) -> list[CandidateResult]:
    """The candidates of the causes found, then of equally good ones, then of those that come closest."""
    found = {}
    for one in diagnosis.rounds:
        for each in one.candidates:
            # Later rounds have no result for a cause that is already in the model.
            if (each.code == one.cause or each.code in diagnosis.between) and (
                    each.parameters or each.code not in found):
                found[each.code] = each
    codes = dict.fromkeys([*diagnosis.causes, *diagnosis.between, *diagnosis.closest])
    return [found.get(code, CandidateResult(code, "named")) for code in codes]


def detection_limits(candidate: CandidateSection, names: bool = True) -> str:
    """'shaft.half_gap 0.0002 rad', or without the name; empty where it is not known."""
    return ", ".join(f"{name if names else ''} {short(size.value, 2)} {size.unit or ''}".strip()
                     for name, size in candidate.smallest.items() if size.value is not None)


def with_std(value: float | None, std: float | None) -> str:
    """'0.5871 +- 0.0012'; '-' where there is none."""
    if value is None:
        return "-"
    digits, std_digits = rounded(value, std)
    return digits if std is None else f"{digits} +- {std_digits}"
