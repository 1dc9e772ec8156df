"""From an identified drive to controller settings: the whole of `drivetool tune`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import BadOption, BadParameters, nearest
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance
from drivetool.progress import counted
from drivetool.tune import remarks
from drivetool.tune.gains import Design, Gains, TuneOptions
from drivetool.tune.optimisation import (
    Draws,
    Optimum,
    TuneLimits,
    TuningProblem,
    allowed_gains,
    check_gain_is_limited,
    depends_on,
    draw_drives,
    factors,
    grid_shapes,
    joint_covariance,
    lowest_sensitivity,
    optimum,
    robust_optimum,
    share_within_limit,
    spread_of_figures,
    tuning_problem,
    variation_study,
)
from drivetool.tune.pictures import pictures
from drivetool.tune.simulation import disturbance_responses, has_gap, safe_gain
from drivetool.tune.speed_loop import Configuration, Wiring, build, check_wiring, margins, max_sensitivity

# Added to the seed for draws on which a robust design is validated. Any number but 0: a prime far from usual seeds.
FRESH_DRAWS_SEED = 7919


def tune(drive: Drive, options: TuneOptions, draw_pictures: bool = False) -> Gains:
    """The best settings of a speed controller for steps of load torque.

    drive          identified; inertias and stiffnesses known
    draw_pictures  whether the data of the pictures are computed, which takes longer than the design
    returns        Gains with one Design per configuration
    raises         BadParameters: a value is missing, nothing limits the gain, a configuration that
                   does not fit the drive; BadOption: limits that no settings keep
    source         Tallfors 2005, ch. 2 to 4
    """
    if not options.limits.sensitivity > 1.0:
        raise BadOption("a limit of the sensitivity above 1", f"{options.limits.sensitivity:g}",
                        "No feedback loop has a lower Ms; 1.4 to 2 is usual.")
    if not options.limits.gain > 0.0:
        raise BadOption("a largest gain above zero", f"{options.limits.gain:g}", "Correct --max-gain.")
    if options.confidence is not None and not 0.0 < options.confidence < 1.0:
        raise BadOption("a confidence between 0 and 1", f"{options.confidence:g}", "Write for example 0.95.")
    drive.require(drive.missing(), "a controller")
    _require_identified(drive, options, [n for n in options.unidentified if drive.quantity(n).neutral is None])
    chosen, notes = wirings_to_tune(drive, options)
    known = ("load_speed", "motor_speed", *(f"{motor}_torque" for motor in chosen[0].motors))
    for name in options.criterion.weights:
        if name not in known:
            raise BadOption("weights of signals of this drive", f"'{name}'", nearest(name, known), known)
    covariance = joint_covariance(drive, options.known, options.stds)
    draws = draw_drives(drive, covariance, options.draws, options.seed) if covariance else None
    if options.confidence is not None and draws is None:
        raise BadParameters("standard deviations or a covariance for a design with --confidence",
                            "none in the parameter file", "Use a file that an estimator wrote, or leave it out.")
    designs = tuple(_tune_configuration(drive, wiring, options, covariance, draws)
                    for wiring in counted("designs", chosen, len(chosen)))
    _require_identified(drive, options, [n for n in options.unidentified if any(
        depends_on(drive, n, each.wiring, each.settings) for each in designs)])
    findings = (*notes, *remarks.loop_findings(drive, options),
                *remarks.spread_findings(drive, options, covariance, draws),
                *(f for each in designs for f in remarks.design_findings(drive, each, options)))
    gains = Gains(drive, designs, options, remarks.outcome_sentence(drive, designs, options), findings)
    return replace(gains, exhibits=pictures(gains, draws)) if draw_pictures else gains


def _require_identified(drive: Drive, options: TuneOptions, names: Sequence[str]) -> None:
    """Raise BadParameters where a design depends on values that no recording identifies."""
    if names:
        raise BadParameters(
            f"known values of {', '.join(names)}, on which the controller depends",
            "start values, which no recording identifies ("
            + "; ".join(f"{n}: {options.unidentified[n] or 'no reason stated'}" for n in names) + ")",
            f"Record what identifies them, or state what is known: --set {names[0]}=VALUE.",
            [n for n in drive.values if n not in options.unidentified])


def wirings_to_tune(drive: Drive, options: TuneOptions) -> tuple[tuple[Wiring, ...], tuple[Finding, ...]]:
    """The configurations to design, and findings on those left out."""
    motors = options.motors or tuple(
        b for k, b in enumerate(drive.bodies) if k == 0 or (b.startswith("motor") and k < len(drive.bodies) - 1))
    wanted: tuple[Configuration, ...] = options.configurations or (
        ("siso", "miso", "mimo") if len(motors) == 2 and len(drive.bodies) > 2 else ("siso",))
    notes: tuple[Finding, ...] = ()
    if "mimo" in wanted and not options.shaft_torque:
        if options.configurations:
            raise BadParameters(
                "a measured shaft torque for the feedback K3 of a mimo configuration", "no shaft_torque role",
                "Name its channel as role shaft_torque in a channel map and give it with --map, "
                "or leave mimo out.")
        wanted = tuple(each for each in wanted if each != "mimo")
        notes = (remarks.mimo_left_out_finding(),)
    found = tuple(Wiring(each, motors, options.speed_filter, options.dead_time, options.speed) for each in wanted)
    for wiring in found:
        check_wiring(drive, wiring)
    return found, notes


def _tune_configuration(drive: Drive, wiring: Wiring, options: TuneOptions, covariance: Covariance | None,
                        draws: Draws | None) -> Design:
    """The optimum of one configuration with all its figures."""
    loop = build(drive, wiring)
    nominal = tuning_problem(loop, options.criterion, options.limits)
    check_gain_is_limited(nominal)
    robust = options.confidence is not None
    found = robust_optimum(nominal, draws, options.confidence) if robust else optimum(nominal)
    if found is None:
        raise _infeasible_error(nominal, options, draws)
    settings = found.settings
    fresh_share = share_within_limit(
        draw_drives(drive, covariance, options.draws, options.seed + FRESH_DRAWS_SEED), nominal,
        settings) if robust else None
    return Design(
        wiring, settings, found.value, _active_limit(nominal, found, options), factors(loop, settings),
        margins(nominal.plant, settings), variation_study(drive, wiring, settings),
        spread_of_figures(draws, wiring, settings, options.limits.sensitivity) if draws else None, fresh_share,
        disturbance_responses(loop, settings), safe_gain(loop, settings) if has_gap(drive) else None)


def _active_limit(nominal: TuningProblem, found: Optimum, options: TuneOptions) -> str:
    """The active limit at the optimum."""
    if found.settings.gain >= options.limits.gain * (1.0 - 1e-6):
        return "gain"
    if max_sensitivity(nominal.plant, found.settings)[0] >= options.limits.sensitivity * (1.0 - 1e-4):
        return "sensitivity"
    return "nothing" if options.confidence is None else "confidence"


def _infeasible_error(nominal: TuningProblem, options: TuneOptions, draws: Draws | None) -> BadOption:
    """The error that names the limit that cannot be kept, and the nearest one that can."""
    limits = options.limits
    free = replace(nominal, limits=TuneLimits(limits.sensitivity))
    if np.isfinite(limits.gain) and (found := _least_gain(free)) is not None:
        return BadOption(
            f"settings with Kp up to {limits.gain:g} and Ms up to {limits.sensitivity:g}",
            f"none. With this Ms limit and an integral time of up to {free.times[1]:.3g} s the gain is at least "
            f"{found:.4g}", f"Raise --max-gain to {found:.3g} or the Ms limit.")
    lowest = lowest_sensitivity(free)
    if lowest > limits.sensitivity:
        return BadOption(
            f"settings with Ms up to {limits.sensitivity:g}", f"none; the lowest attainable Ms is {lowest:.3g}",
            f"Give --max-sensitivity {lowest * 1.005:.3g} or more, or shorten the lags in the loop.")
    for wider in (1.1, 1.25, 1.5, 2.0, 3.0, 5.0):
        limit = 1.0 + (limits.sensitivity - 1.0) * wider
        trial = replace(nominal, limits=replace(limits, sensitivity=limit))
        if robust_optimum(trial, draws, options.confidence) is not None:
            return BadOption(
                f"settings with Ms up to {limits.sensitivity:g} in {100 * options.confidence:g} % of the draws",
                f"none; Ms up to {limit:.3g} is attainable",
                f"Give --max-sensitivity {limit:.3g}, a lower --confidence, or identify the drive more closely.")
    return BadOption(
        f"settings with Ms up to {limits.sensitivity:g} in {100 * options.confidence:g} % of the draws",
        f"none, not even with Ms up to {limit:.3g}",
        "The parameters are too uncertain; identify the drive more closely.")


def _least_gain(free: TuningProblem) -> float | None:
    """The smallest gain that the sensitivity limit allows at any integral time."""
    ends = [allowed_gains(free, *shape) for shape in grid_shapes(free)]
    return min((float(each[0, 0]) for each in ends if len(each)), default=None)
