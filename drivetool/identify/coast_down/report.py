"""The report of a coast-down fit: ratios, differences between coast-downs, findings and plots."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from drivetool.drive import Drive
from drivetool.drive.effects import steady_torque
from drivetool.finding import Finding
from drivetool.identify.coast_down.coast_down_fit import (
    KNOWN_VARIANCE_DOF,
    LONG_RUN_DOF,
    NO_PRIOR,
    SPEED_GROUPS,
    CoastDownFit,
    Run,
    fit,
)
from drivetool.identify.coast_down.laws import MISFIT_SIGNIFICANCE, AdditionalFrictionLaw
from drivetool.identify.coast_down.stretches import Stretch, driving_input
from drivetool.identify.estimate import Parameter, PlotData
from drivetool.identify.plateaus import record_plot
from drivetool.identify.setup import supply_of
from drivetool.logs import Experiment
from drivetool.quantity import owner_of, parse_name, quantity_of, record_of

INERTIA = "motor.inertia"
NO_LOAD_GRID = 200  # grid of speeds that brackets the no-load speed. A choice: finer than the slip of usual motors
# Rad per period by which the supply may leave its frame: a thousandth of the frequency.
MAX_FRAME_ROTATION = 2.0 * np.pi * 1e-3
SLOPE_STEP = 1e-3  # rad/s of the central difference: the torque is linear over it, and rounding stays small
ALWAYS_STATED = ("inertia", "viscous", "coulomb", "idle_torque")  # stated however small
# Standard deviation over its value, below which a parameter counts as identified: at half, zero is two of them
# away.
MAX_STD_TO_VALUE = 0.5
# Unit of a parameter -> unit of it over the inertia.
OVER_INERTIA = {"{T}": "{q}/s^2", "{T} s/{q}": "1/s", "{T} s^2/{q}^2": "1/{q}", "{T} s^2/{q}": ""}
# Factor of the friction between coast-downs beyond which a wrong inertia is likelier: between consecutive records a
# bearing that warms up loses some ten per cent.
MAX_THERMAL_FACTOR = 2.0
LAW_TEXTS = {"drag": "air drag", "stribeck": "Stribeck friction", "breakaway": "breakaway friction"}


@dataclass(frozen=True)
class CoastDownScatter:
    """Differences of coast-downs: probability by chance, changes of the ratios from the first to the last in %.

    added  (k, k) covariance that the scatter adds to the mean
    first  the first coast-down with its own fit, where they differ: only it tests the friction law
    """

    probability: float
    changes: Mapping[str, float]
    added: np.ndarray
    first: tuple[Run, CoastDownFit] | None = None


def ratio_lines(drive: Drive, free: Sequence[str], fitted: CoastDownFit) -> tuple[Parameter, ...]:
    """The ratio of every fitted torque to the inertia, with its interval."""
    found = []
    inertia = drive.values[INERTIA]
    for i, name in enumerate(free):
        if name == INERTIA or "{T}" not in drive.quantity(name).unit or unidentified(name, free, fitted):
            continue
        value, slope = drive.values[name] / inertia, np.zeros(len(free))
        slope[i] = 1.0 / inertia
        if INERTIA in free:
            slope[free.index(INERTIA)] = -value / inertia
        variances = fitted.covariance[np.ix_(slope != 0.0, slope != 0.0)]
        std = float(np.sqrt(max(slope[slope != 0.0] @ variances @ slope[slope != 0.0], 0.0)))
        found.append(Parameter(name=ratio_name(name), value=value, unit=ratio_unit(drive, name)).with_interval(
            std, (drive.quantity(name).bounds[0], np.inf)))
    return tuple(found)


def no_load_speed(
        drive: Drive, free: Sequence[str], fitted: CoastDownFit, runs: Sequence[Run]) -> tuple[Parameter, ...]:
    """The speed at which an induction motor's steady torque equals its friction, at its last voltage.

    None where the friction has laws besides viscous and Coulomb, or no motor is supplied. The interval follows from
    that of the friction.
    """
    supplied = [run for run in runs if run.inputs.shape[1] > 1]
    names = ("motor.viscous", "motor.coulomb")
    if not supplied or set(free) - {INERTIA, *names} or not set(names) <= set(free):
        return ()
    vector = supplied[-1].inputs[:, 1] + 1j * supplied[-1].inputs[:, 2]
    later = vector[len(vector) // 2:]
    if abs(np.angle(np.mean(later[1:] * later[:-1].conj()))) > MAX_FRAME_ROTATION * drive.value(
            "motor.supply_frequency") * supplied[-1].reading.step:
        return ()  # the supply ended at another frequency than that of the frame
    peak = float(np.mean(np.abs(later)))
    viscous, coulomb = (drive.values[n] for n in names)

    def net_torque(w: float) -> float:
        return steady_torque(drive, peak, w) - viscous * w - coulomb

    fastest = 2.0 * np.pi * drive.value("motor.supply_frequency") / drive.value("motor.pole_pairs")
    speeds = np.linspace(fastest, 0.0, NO_LOAD_GRID)
    driven = next((i for i, w in enumerate(speeds) if net_torque(w) > 0.0), 0)
    if not driven:
        return ()
    speed = float(scipy.optimize.brentq(net_torque, speeds[driven], speeds[driven - 1], xtol=1e-12))
    slope = (net_torque(speed + SLOPE_STEP) - net_torque(speed - SLOPE_STEP)) / (2.0 * SLOPE_STEP)
    by, at = np.array([speed, 1.0]) / slope, [free.index(n) for n in names]
    std = float(np.sqrt(by @ fitted.covariance[np.ix_(at, at)] @ by))
    return (Parameter(name="no_load_speed", value=speed, unit="rad/s").with_interval(std),)


def ratio_covariance(drive: Drive, free: Sequence[str], fitted: CoastDownFit) -> dict[str, object]:
    """Names and covariance of what a fit without scale identifies: with inertia one, torques are ratios."""
    identified = [i for i, n in enumerate(free) if not unidentified(n, free, fitted)]
    names = [ratio_name(n) if "{T}" in drive.quantity(n).unit else n for n in (free[i] for i in identified)]
    return {"names": names, "matrix": fitted.covariance[np.ix_(identified, identified)].tolist()}


def unidentified(name: str, free: Sequence[str], fitted: CoastDownFit) -> bool:
    """Whether the coast-downs do not identify a further law, by any of its parameters."""
    body, quantity, _ = parse_name(name)
    law = [] if quantity in ALWAYS_STATED else [
        n for n in free if owner_of(n) == body and quantity_of(n).startswith(quantity.partition("_")[0])]
    return any(not fitted.std(n) < MAX_STD_TO_VALUE * abs(fitted.values[free.index(n)]) for n in law)


def ratio_name(name: str) -> str:
    """The name of a parameter over the inertia under derived."""
    _, quantity, record = parse_name(name)
    return f"{quantity}{record and f'_in_{record}'}_over_inertia"


def ratio_unit(drive: Drive, name: str) -> str:
    """The unit of a parameter over that of the inertia."""
    unit = drive.quantity(name).unit
    return OVER_INERTIA[unit].replace("{q}", drive.motion_unit) if unit in OVER_INERTIA else \
        f"{drive.unit(name)}/({drive.unit(INERTIA)})"


def scatter_between_runs(start: Drive, free: Sequence[str], runs: Sequence[Run], stretches: Sequence[Stretch],
                 fitted: CoastDownFit) -> CoastDownScatter:
    """Whether coast-downs have one friction: each is fitted separately, with the common inertia.

    The chi-square of the single values about their mean gives the probability of such differences by chance.
    """
    k, none = len(free), np.zeros((len(free), len(free)))
    own = [n for n in free if n in ("motor.viscous", "motor.coulomb")]
    unpowered = [r for r, s in zip(runs, stretches, strict=True) if s.off]
    if len(unpowered) < 2 or not own:
        return CoastDownScatter(1.0, {}, none)
    ended = start.with_values(fitted.found)
    singles = [fit(ended, own, [run], NO_PRIOR) for run in unpowered]
    weights = [np.linalg.pinv(f.covariance, hermitian=True) for f in singles]
    mean = np.linalg.pinv(np.sum(weights, axis=0), hermitian=True) @ np.sum(
        [w @ f.values for w, f in zip(weights, singles, strict=True)], axis=0)
    square = sum(float((f.values - mean) @ w @ (f.values - mean)) for w, f in zip(weights, singles, strict=True))
    dof, sensors = (len(unpowered) - 1) * len(own), sum(not r.reading.count for r in unpowered)
    probability = float(scipy.stats.f.sf(square / dof, dof, sensors * LONG_RUN_DOF or KNOWN_VARIANCE_DOF))
    if probability > MISFIT_SIGNIFICANCE:
        return CoastDownScatter(probability, {}, none)
    values = np.array([f.values for f in singles])
    added, at = np.zeros((k, k)), [free.index(n) for n in own]
    added[np.ix_(at, at)] = np.cov(values.T).reshape(len(own), len(own)) / len(unpowered)
    if len(unpowered) == len(runs):  # else the torque gives the scale too
        scatter = float(np.sqrt(np.mean((values.std(axis=0, ddof=1) / values.mean(axis=0)) ** 2)))
        added += _covariance_by_added_inertia(ended, free, [r.name for r in unpowered], scatter)
    speed = float(np.median(np.abs(fitted.speed)))
    torques = values @ np.array([speed if n == "motor.viscous" else 1.0 for n in own])
    changes = {quantity_of(n): 100.0 * float(v[-1] / v[0] - 1.0)
               for n, v in zip(own, values.T, strict=True) if v[0]}
    return CoastDownScatter(
        probability, changes | {"together": 100.0 * float(torques[-1] / torques[0] - 1.0)}, added,
        (unpowered[0], singles[0]))


def _covariance_by_added_inertia(
        drive: Drive, free: Sequence[str], names: Sequence[str], scatter: float) -> np.ndarray:
    """(k, k) covariance of the scale by an added inertia, from coast-downs whose frictions scatter.

    A common factor of both frictions looks like another inertia. It is assumed to scatter as the frictions do.

    names  of the recordings of the coast-downs; scatter: of a friction, over its mean
    """
    found, own = np.zeros((len(free), len(free))), drive.values[INERTIA]
    for name in [n for n in drive.values if quantity_of(n) == "added_inertia" and record_of(n)
                 and (n in free or drive.value(n))]:
        size, on = drive.values[name], sum(n == record_of(name) for n in names)
        if not 0 < on < len(names):
            continue
        ratio = scatter * np.sqrt(1.0 / on + 1.0 / (len(names) - on))  # of (J + J_added) over J
        direction = np.zeros(len(free))
        if name in free:
            direction[free.index(name)] = (own + size) * ratio
        elif INERTIA in free:  # every torque follows the scale
            direction = np.array([drive.values[n] if "{T}" in drive.quantity(n).unit else 0.0 for n in free])
            direction *= ratio * (own + size) / size
        found += np.outer(direction, direction)
    return found


def outcome_text(stretches: Sequence[Stretch], experiments: Sequence[Experiment], by: Sequence[str]) -> str:
    """One sentence."""
    off = [s for s in stretches if s.off]
    seconds = sum((s.last - s.first) * experiments[s.recording].step for s in off)
    scale = f"torque scale from {' and '.join(by)}" if by else "only ratios to the inertia, as no torque is known"
    return f"{len(off)} coast-down{'s' if len(off) > 1 else ''} without torque, {seconds:.4g} s; {scale}."


def fit_figures(fitted: CoastDownFit, stretches: Sequence[Stretch]) -> dict[str, float | int | None]:
    """Figures of the fit: the errors of the coast-downs in the sensor's unit."""
    raw = np.concatenate([e * r.std[r.known] for e, r in zip(fitted.by_run, fitted.readings, strict=True)])
    about = np.concatenate([r.values[r.known] - r.values[r.known].mean() for r in fitted.readings])
    return {"simulation_fit_percent": 100.0 * (1.0 - float(np.sqrt(np.mean(raw**2) / np.mean(about**2)))),
            "one_step_fit_percent": None, "rmse": float(np.sqrt(np.mean(raw**2))), "n": len(raw),
            "run_downs": sum(s.off for s in stretches), "chi2": fitted.chi_square, "chi2_dof": fitted.dof}


def coast_down_findings(
        fitted: CoastDownFit, tested: CoastDownFit, stretches: Sequence[Stretch], experiments: Sequence[Experiment],
        by: Sequence[str], spread: CoastDownScatter, further: AdditionalFrictionLaw | None,
        held: Collection[str] = ()) -> list[Finding]:
    """The findings on a fit.

    tested  the fit that tests whether the friction follows its law; further: the missing law
    held    names of the parameters that are held
    """
    found = []
    if not by:
        found.append(Finding(
            "note", "ratios-only", "The records do not determine the scale of the torques: inertia and friction "
            "times a common factor give the same coast-down. Only the ratios in the section `derived` have "
            "intervals.", {},
            "Record a stretch under a logged torque too, or repeat with a known inertia added (--record FILE "
            "motor.added_inertia=VALUE), or hold a known inertia or friction (--set, --hold)."))
    found += coast_down_assumed([experiments[s.recording] for s in stretches])
    found += [Finding(
        "note", "speed-drops-to-zero", f"The speed of {experiments[s.recording].name} drops to zero from "
        f"{s.dropped:.4g}, much faster than the friction before decelerates it. What follows is left out.",
        {"speed": s.dropped},
        "A sensor that measures the time between pulses reports zero below its lowest speed: log its counts. Where "
        "a brake stops the drive, ignore this.") for s in stretches if s.dropped]
    if tested.misfit < MISFIT_SIGNIFICANCE:
        found.append(_missing_law_finding(tested, further, held))
    elif fitted.misfit < MISFIT_SIGNIFICANCE:
        found.append(_torque_finding(fitted, stretches, experiments))
    if spread.changes:
        listed = ", ".join(f"{n} by {v:+.2g} %" for n, v in spread.changes.items() if n != "together")
        found.append(Finding(
            "warning", "scatter-beyond-noise",
            f"From the first coast-down to the last the friction changes: {listed}, "
            f"together by {spread.changes['together']:+.2g} %. The p-value of this change is "
            f"{spread.probability:.1g}. The intervals describe the mean over such runs; the scatter between runs "
            "limits the accuracy of an added inertia.",
            dict(spread.changes) | {"probability": spread.probability},
            "A machine that warms up loses friction: record when its temperature has settled, or log it."
            if 1.0 / MAX_THERMAL_FACTOR < 1.0 + 0.01 * spread.changes["together"] < MAX_THERMAL_FACTOR else
            "Temperature hardly explains this change: check the inertia that was added or is held, and its unit."))
    return found


def coast_down_assumed(experiments: Sequence[Experiment]) -> list[Finding]:
    """A finding where no record of the torque says when it ended."""
    if all(driving_input(e) is not None for e in experiments):
        return []
    return [Finding(
        "note", "coast-down-assumed", "No torque was logged: the drive is assumed to coast down without torque "
        "from the time at which its speed begins to fall from its maximum.", {},
        "Exclude the switching transient with --flux-decay, or --condition 'keep from=..'.")]


def _missing_law_finding(
        fitted: CoastDownFit, further: AdditionalFrictionLaw | None, held: Collection[str]) -> Finding:
    """That the friction follows another law, and which."""
    also = f", or a held value is wrong ({', '.join(sorted(held))})" if held else ""
    biased = f"The error of {', '.join(fitted.names)} is systematic. " if fitted.names else ""
    text = ("The residual of the coast-down depends on the speed (p-value "
            f"{fitted.misfit:.1g}): the friction follows another law{also}. {biased}")
    evidence: dict[str, float | int | str] = {"probability": fitted.misfit}
    if further is None:
        tried = ", ".join(LAW_TEXTS.values())
        return Finding("warning", "nonlinear-friction", f"{text}No tested law ({tried}) explains it.", evidence,
                       "Look at the picture: a jump over the speed indicates a load change, a periodic residual an "
                       "encoder error.")
    gain, options = further.gain, " ".join(f"--free {n}" for n in further.names)
    words = " or ".join(" with ".join(LAW_TEXTS[law] for law in laws) for laws in further.laws)
    text += (f"{words[0].upper()}{words[1:]} explains "
             f"{'it' if further.misfit >= MISFIT_SIGNIFICANCE else 'part of it'}. On another coast-down from the "
             f"same speed the simulation errs by {gain.percent:.3g} % less ({gain.low:.3g} to {gain.high:.3g} %).")
    evidence |= {"law": " ".join(further.laws[0]), "gain_percent": gain.percent, "gain_low": gain.low,
                 "gain_high": gain.high}
    return Finding("warning", "nonlinear-friction", text, evidence,
                   f"Fit it with --drive one-body {options}." if len(further.laws) == 1 else
                   f"Record until standstill to distinguish these laws; fit the most likely one with {options}.")


def _torque_finding(
        fitted: CoastDownFit, stretches: Sequence[Stretch], experiments: Sequence[Experiment]) -> Finding:
    """That the coast-downs follow the friction, and the motion under torque does not follow the torque."""
    fed = any(supply_of(experiments[s.recording]) is not None for s in stretches if not s.off)
    what = "the motor's electrical values or its voltage" if fed else "the logged torque"
    return Finding(
        "warning", "torque-contradicts-motion",
        "The coast-downs agree with the fitted friction, but the motion under torque contradicts the torque "
        f"(p-value {fitted.misfit:.1g}). There is an error in {what}, and the inertia has the same relative error.",
        {"probability": fitted.misfit},
        "Check resistances, inductances and voltage of the motor at its temperature." if fed else
        "Check the scale of the torque and its delay; exclude the switching transient.")


def coast_down_plots(experiments: Sequence[Experiment], stretches: Sequence[Stretch], fitted: CoastDownFit,
             drive: Drive) -> tuple[PlotData, ...]:
    """The residual over the speed, and the recordings with the coast-downs marked, simulated, and their errors."""
    plots = [_residual_plot(fitted, drive)]
    for k, e in enumerate(experiments):
        own = [(s, s.first + reading.known, speed, error) for s, reading, speed, error in zip(
            stretches, fitted.readings, fitted.speeds, fitted.by_run, strict=True) if s.recording == k]
        simulated, error = curves = np.full((2, e.size), np.nan)
        for s, at, *of_readings in own:
            inside = np.arange(s.first, s.last)
            curves[:, inside] = [np.interp(inside, at, values) for values in of_readings]
        plot = record_plot("coast-downs", e, [(s.first, s.last) for s, *_ in own if s.off], drive)
        plots.append(replace(plot, curves={**plot.curves, "simulated speed": (e.time, simulated),
                                           "error [std]": (e.time, error)}))
    return tuple(plots)


def _residual_plot(fitted: CoastDownFit, drive: Drive) -> PlotData:
    """Residuals over the speed, means of groups of samples with their standard error."""
    order = np.argsort(fitted.speed)
    groups = [g for g in np.array_split(order, SPEED_GROUPS) if len(g)]
    speed = np.array([fitted.speed[g].mean() for g in groups])
    residual = np.array([fitted.weighted_residuals[g].mean() for g in groups])
    std = np.array([fitted.weighted_residuals[g].std() / np.sqrt(len(g)) for g in groups])
    return PlotData("steady", "Coast-down: simulated minus measured, means of speed groups",
                    f"speed [{drive.motion_unit}/s]", "error over its standard deviation",
                    {"points": (speed, residual), "std": (speed, std)})
