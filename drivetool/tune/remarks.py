"""Findings on a result of tune, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance
from drivetool.quantity import quantity_of
from drivetool.tune.gains import Design, TuneOptions
from drivetool.tune.optimisation import Draws
from drivetool.tune.speed_loop import FLAT_AT_STANDSTILL, acting_effects, left_out_parameters

SLIGHT_MS_EXCESS = 1.03  # times the limit, in 95 % of the draws. A choice: less changes no margin noticeably.
LOOP_SUFFIXES = ("inertia", "stiffness", "damping", "dead_time", "bandwidth")  # suffixes that shape a loop


def outcome_sentence(drive: Drive, designs: Sequence[Design], options: TuneOptions) -> str:
    """One sentence: the settings, the criterion and the active limit."""
    best = min(designs, key=lambda each: each.value)
    limit = options.limits.sensitivity
    active_limit = {
        "sensitivity": f"the Ms limit {limit:g} is active", "gain": "the gain limit is active",
        "confidence": f"Ms stays within {limit:g} in {100 * (options.confidence or 0):g} % of the draws",
        "nothing": f"Ms {best.margins.max_sensitivity:.3g}, the limit {limit:g} is not active"}[best.active]
    unit = gain_unit(drive)
    name = f"{best.wiring.configuration}: " if len(designs) > 1 else ""
    return (f"{name}Kp {best.settings.gain:.5g} {unit}, Ti {1e3 * best.settings.integral_time:.4g} ms minimise "
            f"{options.criterion.name}; {active_limit}.")


def gain_unit(drive: Drive) -> str:
    """Unit of Kp."""
    return f"{drive.torque_unit} s/{drive.motion_unit}"


def mimo_left_out_finding() -> Finding:
    """The finding that the mimo configuration is left out."""
    return Finding("note", "shaft-feedback-not-evaluated",
                   "The configuration with shaft-torque feedback was left out, as no shaft torque is measured.",
                   {}, "Name its channel as shaft_torque in a channel map and give it with --map.")


def loop_findings(drive: Drive, options: TuneOptions) -> list[Finding]:
    """Effects of the drive that are not in the loop, or are there in an unexpected way."""
    found = []
    if reasons := left_out_parameters(drive):
        named = "; ".join(f"{', '.join(names)} ({reason})" for reason, names in reasons.items())
        found.append(Finding(
            "note", "not-in-loop", f"The loop model does not include {named}.",
            {"parameters": sum(map(len, reasons.values()))},
            "If one matters to the controller, give its equivalent value with --set."))
    codes = acting_effects(drive)
    flat = [name for code in FLAT_AT_STANDSTILL for name in codes.get(code, ())]
    if flat and options.speed == 0.0:
        falls = "stribeck" in codes
        found.append(Finding(
            "warning" if falls else "note", "friction-linearised",
            f"{', '.join(flat)} {'have' if len(flat) > 1 else 'has'} zero slope at the working point (slow "
            "motion)" + ("; around the Stribeck speed the friction falls with speed, which destabilises." if falls
                        else "; at higher speed drag adds damping."),
            {"parameters": len(flat)}, "Give the working speed with --speed."))
    if options.speed_filter > 0.0 and "speed-filter" in codes:
        found.append(Finding(
            "note", "two-speed-filters",
            "The loop has two filters of the speed in series: sensor.bandwidth of the parameter file, and the "
            "speed filter of the controller.", {"time_constant": options.speed_filter},
            "If both are one and the same, leave one of them out."))
    return found


def spread_findings(drive: Drive, options: TuneOptions, covariance: Covariance | None,
                draws: Draws | None) -> list[Finding]:
    """What the spread includes and what it does not."""
    if covariance is None or draws is None:
        return [Finding("note", "covariance-incomplete",
                        "The parameter file states no uncertainty, so that the spread of the "
                        "figures is not known.", {}, "Use the file of an estimator.")]
    found = []
    if draws.unphysical:
        share = draws.unphysical / options.draws
        found.append(Finding(
            "warning" if share > 0.05 else "note", "unphysical-draws",
            f"{draws.unphysical} of {options.draws} draws of the parameters are not physical and are left out.",
            {"unphysical": draws.unphysical, "draws": options.draws},
            "Identify the drive more accurately: the normal distribution of a parameter reaches beyond its "
            "bounds."))
    without_std = [n for n in drive.values if n not in covariance.names and quantity_of(n) in LOOP_SUFFIXES]
    if without_std:
        found.append(Finding(
            "note", "covariance-incomplete",
            f"The quantiles do not include the uncertainty of {', '.join(without_std)}, which the file does not "
            "state.",
            {"parameters": len(without_std)}, "See the variations, which change them one at a time."))
    uncorrelated = [n for n in covariance.names if options.known is not None and n not in options.known.names]
    if uncorrelated:
        found.append(Finding(
            "note", "covariance-incomplete",
            f"{', '.join(uncorrelated)} were drawn independently: the file states no correlations for them.",
            {}, ""))
    return found


def design_findings(drive: Drive, design: Design, options: TuneOptions) -> list[Finding]:
    """Robustness, limit cycles and limits of one design."""
    found, name = [], design.wiring.configuration
    prefix = f"{name}: " if len(design.wiring.motors) > 1 else ""
    spread, limit = design.spread, options.limits.sensitivity
    if (spread and options.confidence is None
            and spread.quantiles["max_sensitivity"]["0.95"] > SLIGHT_MS_EXCESS * limit):
        high = spread.quantiles["max_sensitivity"]["0.95"]
        stays = f"; in 95 % it stays below {high:.3g}" if isfinite(high) else ""
        found.append(Finding(
            "warning", "limit-uncertain",
            f"{prefix}Ms exceeds {limit:g} in {100 * spread.above_limit:.0f} % of the drives drawn from the "
            f"parameter covariance{stays}.", {"above_limit": spread.above_limit, "ms_95": high},
            "Tune with --confidence 0.95."))
    if spread and spread.unstable:
        found.append(Finding(
            "warning", "unstable-draws",
            f"{prefix}The loop is unstable for {spread.unstable} of "
            f"{spread.draws - spread.unphysical} drives drawn from the parameter covariance.",
            {"unstable": spread.unstable}, "Identify the drive more closely, or tune with " + (
                "a higher --confidence." if options.confidence else "--confidence.")))
    if design.kept is not None and design.kept < (options.confidence or 0.0) - 0.05:
        found.append(Finding(
            "warning", "limit-uncertain",
            f"{prefix}On new draws Ms is within its limit in only {100 * design.kept:.0f} % of the drives.",
            {"kept": design.kept}, "Raise --draws."))
    found += limit_cycle_findings(drive, design, prefix)
    if design.wiring.configuration == "mimo" and not design.watches and design.safe_gain is not None:
        found.append(Finding(
            "note", "shaft-feedback-not-evaluated",
            f"{prefix}The shaft-torque feedback was not simulated across the gap.", {},
            "Check the design with a reduced shaft stiffness (describing function), and on the machine."))
    return found


def limit_cycle_findings(drive: Drive, design: Design, prefix: str) -> list[Finding]:
    """Limit cycles of the simulated nonlinear drive, and the result of the describing function."""
    speed = f"{drive.motion_unit}/s"
    advice = "Lower the gain, or eliminate the backlash."
    if design.safe_gain:
        advice = (f"At Kp up to {design.safe_gain:.4g} {gain_unit(drive)} the loop is stable for every effective "
                  "stiffness of the gap: reduce Kp, or eliminate the backlash.")
    found = [Finding(
        "warning", "limit-cycle",
        f"{prefix}The backlash causes a limit cycle ({watch.situation}): the motor speed oscillates by "
        f"+-{watch.amplitude:.3g} {speed} at {watch.frequency_hz:.3g} Hz, the torque by "
        f"+-{watch.torque_amplitude:.3g} {drive.torque_unit}. It starts after an impact that changes the "
        f"load speed by {watch.kick:.2g} {speed}.",
        {"amplitude": watch.amplitude, "frequency_hz": watch.frequency_hz, "load_amplitude": watch.load_amplitude,
         "torque_amplitude": watch.torque_amplitude, "kick": watch.kick,
         "gain_without_cycle": design.safe_gain or 0.0}, advice) for watch in design.watches if watch.hunts]
    if design.safe_gain is not None and not found:
        found.append(Finding(
            "note", "limit-cycle",
            f"{prefix}The describing function of the gap allows a limit cycle; no simulated impact excites one.",
             {"gain_without_cycle": design.safe_gain}, advice))
    return found
