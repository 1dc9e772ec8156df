"""What a coast-down says: ratios, what differs between run-downs, findings and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2

from drivetool.drive import AT, Drive
from drivetool.drive.effects import steady_torque
from drivetool.errors import Finding
from drivetool.identify.coast_down.laws import UNLIKELY, Further
from drivetool.identify.coast_down.run_down_fit import GROUPS, NOTHING, Fitted, Run, fit
from drivetool.identify.coast_down.stretches import Stretch, acting
from drivetool.identify.estimate import Z95, Exhibit, Parameter
from drivetool.identify.plateaus import record_with
from drivetool.identify.setup import supply_of
from drivetool.logs import Experiment

INERTIA = "motor.inertia"
STEPS = 200  # speeds below the synchronous one, between which a motor without load runs
TURNS = 2.0 * np.pi * 1e-3  # of a turn, by which a supply may leave its frame: a thousandth of the frequency
DELTA = 1e-3  # rad/s, over which its torque is a straight line
FRICTION = ("inertia", "viscous", "coulomb", "idle_torque")  # what is stated however small
# Share of a value that its standard deviation must be below, to be more than a guess: at half, zero is two away.
TELLS = 0.5
# Unit of a parameter -> unit of it over the inertia.
OVER_INERTIA = {"{T}": "{q}/s^2", "{T} s/{q}": "1/s", "{T} s^2/{q}^2": "1/{q}", "{T} s^2/{q}": ""}
# Factor of the friction from run-down to run-down beyond which a wrong inertia is likelier: between records that
# follow each other a bearing that warms up loses some ten per cent.
HEATED = 2.0
WORDS = {"drag": "drag of the air", "stribeck": "Stribeck friction", "breakaway": "breakaway friction"}


@dataclass(frozen=True)
class Spread:
    """How run-downs differ: probability by chance, changes of the ratios from the first to the last in per cent.

    added  (k, k) covariance of the mean that it adds
    first  the first run-down with its own fit, where they differ: the law is judged by it alone
    """

    probability: float
    changes: Mapping[str, float]
    added: np.ndarray
    first: tuple[Run, Fitted] | None = None


def ratio_lines(drive: Drive, free: Sequence[str], fitted: Fitted) -> tuple[Parameter, ...]:
    """Every torque that was fitted over the inertia, with its interval."""
    found = []
    inertia = drive.values[INERTIA]
    for i, name in enumerate(free):
        if name == INERTIA or "{T}" not in drive.quantity(name).unit:
            continue
        value, slope = drive.values[name] / inertia, np.zeros(len(free))
        slope[i] = 1.0 / inertia
        if INERTIA in free:
            slope[free.index(INERTIA)] = -value / inertia
        variances = fitted.covariance[np.ix_(slope != 0.0, slope != 0.0)]
        std = float(np.sqrt(max(slope[slope != 0.0] @ variances @ slope[slope != 0.0], 0.0)))
        if untold(name, free, fitted):
            continue
        found.append(Parameter(
            ratio_name(name), value, ratio_unit(drive, name), None, std,
            (max(value - Z95 * std, drive.quantity(name).bounds[0]), value + Z95 * std)))
    return tuple(found)


def no_load_speed(drive: Drive, free: Sequence[str], fitted: Fitted, runs: Sequence[Run]) -> tuple[Parameter, ...]:
    """The speed at which an induction motor's steady torque is viscous and Coulomb friction, at its last voltage.

    None where the friction has further laws, or no motor is fed. The interval is by that of the friction.
    """
    fed = [run for run in runs if run.inputs.shape[1] > 1]
    names = ("motor.viscous", "motor.coulomb")
    if not fed or set(free) - {INERTIA, *names} or not set(names) <= set(free):
        return ()
    vector = fed[-1].inputs[:, 1] + 1j * fed[-1].inputs[:, 2]
    later = vector[len(vector) // 2:]
    if abs(np.angle(np.mean(later[1:] * later[:-1].conj()))) > TURNS * drive.value("motor.supply_frequency") \
            * fed[-1].reading.step:
        return ()  # it ended at another frequency than that of the frame
    peak = float(np.mean(np.abs(later)))
    viscous, coulomb = (drive.values[n] for n in names)

    def left(w: float) -> float:
        return steady_torque(drive, peak, w) - viscous * w - coulomb

    fastest = 2.0 * np.pi * drive.value("motor.supply_frequency") / drive.value("motor.pole_pairs")
    speeds = np.linspace(fastest, 0.0, STEPS)
    driven = next((i for i, w in enumerate(speeds) if left(w) > 0.0), 0)
    if not driven:
        return ()
    speed = float(brentq(left, speeds[driven], speeds[driven - 1], xtol=1e-12))
    slope = (left(speed + DELTA) - left(speed - DELTA)) / (2.0 * DELTA)
    by, at = np.array([speed, 1.0]) / slope, [free.index(n) for n in names]
    std = float(np.sqrt(by @ fitted.covariance[np.ix_(at, at)] @ by))
    return (Parameter("no_load_speed", speed, "rad/s", None, std, (speed - Z95 * std, speed + Z95 * std)),)


def ratio_covariance(drive: Drive, free: Sequence[str], fitted: Fitted) -> dict[str, object]:
    """Names and covariance of what a fit without a scale tells: its inertia is one, its torques are ratios."""
    told = [i for i, n in enumerate(free) if not untold(n, free, fitted)]
    names = [ratio_name(n) if "{T}" in drive.quantity(n).unit else n for n in (free[i] for i in told)]
    return {"names": names, "matrix": fitted.covariance[np.ix_(told, told)].tolist()}


def untold(name: str, free: Sequence[str], fitted: Fitted) -> bool:
    """Whether the run-downs hardly tell a further law, by any of its parameters."""
    body, _, suffix = name.partition(".")
    law = [n for n in free if n.startswith(f"{body}.{suffix.partition('_')[0]}")] if suffix not in FRICTION else []
    return any(not fitted.std(n) < TELLS * abs(fitted.values[free.index(n)]) for n in law)


def ratio_name(name: str) -> str:
    """What a parameter over the inertia is called under derived."""
    return f"{name.partition('.')[2].replace('@', '_in_')}_over_inertia"


def ratio_unit(drive: Drive, name: str) -> str:
    """The unit of a parameter over that of the inertia."""
    unit = drive.quantity(name).unit
    return OVER_INERTIA[unit].replace("{q}", drive.motion_unit) if unit in OVER_INERTIA else \
        f"{drive.unit(name)}/({drive.unit(INERTIA)})"


def between_runs(start: Drive, free: Sequence[str], runs: Sequence[Run], stretches: Sequence[Stretch],
                 fitted: Fitted) -> Spread:
    """Whether run-downs have one friction: each is fitted by itself, with the inertia of all.

    The chi-square of the single values about their mean says how likely chance makes them differ so.
    """
    k, none = len(free), np.zeros((len(free), len(free)))
    own = [n for n in free if n in ("motor.viscous", "motor.coulomb")]
    alone = [r for r, s in zip(runs, stretches, strict=True) if s.off]
    if len(alone) < 2 or not own:
        return Spread(1.0, {}, none)
    ended = start.with_values(fitted.found)
    singles = [fit(ended, own, [run], NOTHING) for run in alone]
    weights = [np.linalg.pinv(f.covariance, hermitian=True) for f in singles]
    mean = np.linalg.pinv(np.sum(weights, axis=0), hermitian=True) @ np.sum(
        [w @ f.values for w, f in zip(weights, singles, strict=True)], axis=0)
    square = sum(float((f.values - mean) @ w @ (f.values - mean)) for w, f in zip(weights, singles, strict=True))
    probability = float(chi2.sf(square, (len(alone) - 1) * len(own)))
    if probability > UNLIKELY:
        return Spread(probability, {}, none)
    values = np.array([f.values for f in singles])
    added, at = np.zeros((k, k)), [free.index(n) for n in own]
    added[np.ix_(at, at)] = np.cov(values.T).reshape(len(own), len(own)) / len(alone)
    if len(alone) == len(runs):  # else the torque is a scale too
        scatter = float(np.sqrt(np.mean((values.std(axis=0, ddof=1) / values.mean(axis=0)) ** 2)))
        added += _through_added(ended, free, [r.name for r in alone], scatter)
    speed = float(np.median(np.abs(fitted.speed)))
    brakes = values @ np.array([speed if n == "motor.viscous" else 1.0 for n in own])
    changes = {n.partition(".")[2]: 100.0 * float(v[-1] / v[0] - 1.0)
               for n, v in zip(own, values.T, strict=True) if v[0]}
    return Spread(probability, changes | {"together": 100.0 * float(brakes[-1] / brakes[0] - 1.0)}, added,
                  (alone[0], singles[0]))


def _through_added(drive: Drive, free: Sequence[str], names: Sequence[str], scatter: float) -> np.ndarray:
    """(k, k) covariance of what an added inertia tells by run-downs whose frictions scatter.

    A factor of both frictions looks like another inertia. It is taken to scatter as they do beside one another.

    names  of the recordings of the run-downs; scatter: of a friction, over its mean
    """
    found, own = np.zeros((len(free), len(free))), drive.values[INERTIA]
    for name in [n for n in drive.values if f".added_inertia{AT}" in n and (n in free or drive.value(n))]:
        size, on = drive.values[name], sum(n == name.partition(AT)[2] for n in names)
        if not 0 < on < len(names):
            continue
        ratio = scatter * np.sqrt(1.0 / on + 1.0 / (len(names) - on))  # of (J + J_added) over J
        way = np.zeros(len(free))
        if name in free:
            way[free.index(name)] = (own + size) * ratio
        elif INERTIA in free:  # all that is a torque follows the scale
            way = np.array([drive.values[n] if "{T}" in drive.quantity(n).unit else 0.0 for n in free])
            way *= ratio * (own + size) / size
        found += np.outer(way, way)
    return found


def outcome(stretches: Sequence[Stretch], experiments: Sequence[Experiment], by: Sequence[str]) -> str:
    """One sentence."""
    off = [s for s in stretches if s.off]
    seconds = sum((s.last - s.first) * experiments[s.recording].step for s in off)
    scale = f"torques by {' and '.join(by)}" if by else "only ratios to the inertia, as no torque is known"
    return f"{len(off)} run-down{'s' if len(off) > 1 else ''} without torque, {seconds:.4g} s; {scale}."


def figures(fitted: Fitted, stretches: Sequence[Stretch]) -> dict[str, float | int | None]:
    """Figures of the fit: the errors of the run-downs in the sensor's unit."""
    raw = np.concatenate([e * r.std[r.known] for e, r in zip(fitted.by_run, fitted.readings, strict=True)])
    about = np.concatenate([r.values[r.known] - r.values[r.known].mean() for r in fitted.readings])
    return {"simulation_fit_percent": 100.0 * (1.0 - float(np.sqrt(np.mean(raw**2) / np.mean(about**2)))),
            "one_step_fit_percent": None, "rmse": float(np.sqrt(np.mean(raw**2))), "n": len(raw),
            "run_downs": sum(s.off for s in stretches), "chi2": fitted.chi_square, "chi2_dof": fitted.dof}


def findings(fitted: Fitted, judged: Fitted, stretches: Sequence[Stretch], experiments: Sequence[Experiment],
             by: Sequence[str], spread: Spread, further: Further | None) -> list[Finding]:
    """What a person should know of it.

    judged  the fit that tells whether the friction follows its law; further: the law that it lacks
    """
    found = []
    if not by:
        found.append(Finding(
            "note", "ratios-only", "Nothing here fixes the scale of the torques: inertia and friction multiplied "
            "by one number run down alike, so only the ratios under derived have intervals.", {},
            "Record a stretch under a logged torque too, or repeat with a known inertia added (--record FILE "
            "motor.added_inertia=VALUE), or hold a known inertia or friction (--set, --hold)."))
    found += switched_off_assumed([experiments[s.recording] for s in stretches])
    if judged.misfit < UNLIKELY:
        found.append(_incomplete(judged, further))
    elif fitted.misfit < UNLIKELY:
        found.append(_torque_differs(fitted, stretches, experiments))
    if spread.changes:
        told = ", ".join(f"{n} by {v:+.2g} %" for n, v in spread.changes.items() if n != "together")
        found.append(Finding(
            "warning", "run-downs-differ", f"From the first run-down to the last the friction changes: {told}, "
            f"together by {spread.changes['together']:+.2g} %. Chance would do that with a probability of "
            f"{spread.probability:.1g}. The intervals are of the mean of runs like these; an added inertia is told "
            "as well as runs are alike.",
            dict(spread.changes) | {"probability": spread.probability},
            "A machine that warms up loses friction: record when its temperature has settled, or note it too."
            if 1.0 / HEATED < 1.0 + 0.01 * spread.changes["together"] < HEATED else
            "Warmth hardly does that: check the inertia that was added or is held, and its unit."))
    return found


def switched_off_assumed(experiments: Sequence[Experiment]) -> list[Finding]:
    """That nobody logged when the torque ended, where that is so."""
    if all(acting(e) is not None for e in experiments):
        return []
    return [Finding(
        "note", "switched-off-assumed", "No torque was logged: the drive is taken to run down without one from "
        "where its speed has left the highest value.", {},
        "Leave out what belongs to the switching with --flux-decay, or --condition 'keep from=..'.")]


def _incomplete(fitted: Fitted, further: Further | None) -> Finding:
    """That the friction follows another law, and which."""
    text = ("What is left of the run-down depends on the speed (probability "
            f"{fitted.misfit:.1g} by chance): the friction follows another law. ")
    evidence: dict[str, float | int | str] = {"probability": fitted.misfit}
    if further is None:
        tried = " and ".join(WORDS.values())
        return Finding("warning", "friction-law-incomplete", f"{text}Of {tried} none explains it.", evidence,
                       "Look at the picture: an edge over the speed is a load that changes, waves are the encoder.")
    gain, options = further.gain, " ".join(f"--free {n}" for n in further.names)
    words = " or ".join(" with ".join(WORDS[law] for law in laws) for laws in further.laws)
    text += f"{words[0].upper()}{words[1:]} explains {'it' if further.misfit >= UNLIKELY else 'part of it'}"
    text += (f". On another run-down from the same speed the simulation errs by {gain.percent:.3g} % less "
             f"({gain.low:.3g} to {gain.high:.3g} %).")
    evidence |= {"law": " ".join(further.laws[0]), "gain_percent": gain.percent, "gain_low": gain.low,
                 "gain_high": gain.high}
    return Finding("warning", "friction-law-incomplete", text, evidence,
                   f"Fit it with --drive one-body {options}." if len(further.laws) == 1 else
                   f"Record until the drive stands, which tells them apart; fit the likelier with {options}.")


def _torque_differs(fitted: Fitted, stretches: Sequence[Stretch], experiments: Sequence[Experiment]) -> Finding:
    """That the run-downs follow the friction, and what was driven does not follow its torque."""
    fed = any(supply_of(experiments[s.recording]) is not None for s in stretches if not s.off)
    what = "the motor's electrical values or its voltage" if fed else "the logged torque"
    return Finding(
        "warning", "torque-not-explained", "The run-downs follow the friction, but where the drive is driven its "
        f"motion is another one (probability {fitted.misfit:.1g} by chance). Then {what} is wrong there, and the "
        "inertia by as much.", {"probability": fitted.misfit},
        "Check resistances, inductances and voltage of the motor at its temperature." if fed else
        "Check the scale of the torque and its delay; leave the switching out.")


def exhibits(experiments: Sequence[Experiment], stretches: Sequence[Stretch], fitted: Fitted,
             drive: Drive) -> tuple[Exhibit, ...]:
    """The recordings with the run-downs marked, and what is left over the speed."""
    shown = [_left(fitted, drive)]
    off = [s for s in stretches if s.off]
    shown += [record_with("run-downs", e, [(s.first, s.last) for s in off if s.recording == k], drive)
              for k, e in enumerate(experiments)]
    return tuple(shown)


def _left(fitted: Fitted, drive: Drive) -> Exhibit:
    """Residuals over the speed, means of groups of samples with their standard error."""
    order = np.argsort(fitted.speed)
    groups = [g for g in np.array_split(order, GROUPS) if len(g)]
    speed = np.array([fitted.speed[g].mean() for g in groups])
    left = np.array([fitted.left[g].mean() for g in groups])
    std = np.array([fitted.left[g].std() / np.sqrt(len(g)) for g in groups])
    return Exhibit("steady", "Run-down: simulated less measured, means", f"speed [{drive.motion_unit}/s]",
                   "error over its standard deviation", {"points": (speed, left), "std": (speed, std)})
