"""The grey box by inverse dynamics: the parameters by which the motion asks for the torque that was logged.

For motions that are imposed or well known: there the torque is the answer. No start states, no noise model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import TOTALS, Drive, shared
from drivetool.errors import BadOption, Finding
from drivetool.identify.channels import feedback_in
from drivetool.identify.estimate import (
    Z95,
    Covariance,
    Estimate,
    Exhibit,
    FoundLaw,
    Parameter,
    covariance_of,
    parameters_of,
)
from drivetool.identify.inverse.missing_laws import own_of, solved_with_laws, with_laws
from drivetool.identify.inverse.regression import (
    Inverse,
    Solved,
    in_narrower_band,
    recorded,
    solved,
    strength,
    with_instruments,
)
from drivetool.identify.laws import SLACK, model_error, sandwich, weighty
from drivetool.identify.motion import (
    NOISE_SHARE,
    Rows,
    TorqueFit,
    beyond_stationary,
    change_of,
    covariance_of as covariance_of_rows,
    influence_of,
    inverse_of,
    logged_as_it_acts,
    reference_of,
    torque_fit,
    torque_picture,
)
from drivetool.identify.outcome import Told, repeats_of, tells, with_scatter
from drivetool.identify.problem import Normal, Point, Solution
from drivetool.identify.setup import Options, Roles, Start
from drivetool.logs import Experiment

WEAK = 10.0  # first-stage F below which instruments are weak (Staiger and Stock 1997)
NARROWER = 2.0  # by which the band is narrower that shows what depends on the band
DOUBLED = 2.0  # half-widths that a disagreement adds: half of it is seen, at best
NEW = 1e-3  # of a torque's power that its past does not foretell: with less a loop without noise looks open
NOTHING = 0.9  # of the torque's standard deviation, from which the motion explains nothing of it


@dataclass(frozen=True)
class Linear:
    """What the table of a regression asks of its problem, see `interval_and_status.parameters_of`."""

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    count: int
    unknowns: int


def greybox_by_inverse(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], roles: Roles,
                       options: Options, lead: tuple[np.ndarray, ...] | None = None) -> Estimate:
    """Physical parameters from the torque that the motor's motion asks for.

    experiments  motor_torque and the motor's speed or angle; with reference_angle, reference_speed or
                 reference_torque of the loop, what that foretells of the motion is the instrument
    drive        with start values; of a chain the motor is moved as measured, and the rest of it simulated
    free         parameter names
    lead         per recording (n,) samples that are left out; None: as long as the chain remembers how it began
    returns      Estimate; std_noise under stationary errors of any spectrum, std_structure by what else shows
    raises       BadOption: a path between torque and body, or a start state; NotEnoughData
    source       Gautier, Janot and Vandanjon 2013, the filters; Janot, Vandanjon and Gautier 2014, instruments
    """
    askable(drive, free, options)
    sensor, inputs = roles.outputs[0], roles.inputs[1:]
    reference, why = reference_of(experiments, sensor)
    first = recorded(experiments, drive, free, sensor, inputs, lead)
    record, findings = first, []
    if reference is None:
        findings.append(_no_instrument(why))
    else:
        record = with_instruments(first, sensor, reference)
        if (first_stage := strength(record)) < WEAK:
            findings.append(_weak(reference, first_stage))
            record, reference = first, None
    fit = solved_with_laws(record)
    line, own = own_of(fit)
    alone, laws = fit.at.alone(own), _laws(fit)
    structure = _structure(fit, line, sensor, reference)
    lines, covariance, more = _lines(fit, drive, alone.drive, line, _held(fit, options.known), structure)
    repeats = repeats_of(told_by_each(fit), line)
    lines, covariance, varies = with_scatter(lines, covariance, alone.own, repeats, alone.drive)
    more = (*more, *varies)
    f, figures, exhibits = _torque_figures(fit, alone)
    heavy = weighty(laws, experiments)
    findings += [*more, *([model_error(heavy, next(iter(heavy)))] if heavy else []),
                 *(() if reference else _of_feedback(experiments, sensor))]
    if f.over_sd > NOTHING:
        findings.append(_nothing(f.over_sd))
        lines, covariance = tuple(_without(p) for p in lines), None
    return Estimate(
        "greybox", alone.drive, lines, _outcome(fit, reference), figures, covariance, {},
        {"criterion": "inverse", "outputs": ["motor_torque"], "instruments": reference or "none"}, tuple(findings),
        tuple(e.source for e in experiments), {}, exhibits, None, _sentence(laws), laws)


def askable(drive: Drive, free: Sequence[str], options: Options) -> None:
    """Raise BadOption where the torque of the motor's body is not what a motion asks for."""
    logged_as_it_acts(drive, free)
    sums = [n for n in free if n in TOTALS]
    if sums:
        raise BadOption("the friction of each body for --criterion inverse", ", ".join(sums),
                        f"Free {drive.bodies[0]}.{TOTALS[sums[0]]}: the motion of its body is known.")
    if options.start != Start():
        raise BadOption("a criterion that simulates for --start", "inverse, which asks for no start state",
                        "Leave --start out, or take --criterion auto.")


def _laws(fit: Solved) -> tuple[FoundLaw, ...]:
    """The laws that were taken out, with their factors."""
    found, k, std = [], len(fit.at.own), np.sqrt(np.diag(fit.covariance))
    for law in fit.at.laws[0]:
        part = slice(k, k + law.size)
        found.append(FoundLaw(law.name, tuple(fit.values[part].tolist()), tuple(std[part].tolist())))
        k += law.size
    return tuple(found)


def _sentence(laws: Sequence[FoundLaw]) -> str:
    """What was taken out, in words."""
    if not laws:
        return ""
    return f"{len(laws)} law{'s' if len(laws) > 1 else ''} that the motion foretells taken out of the torque."


def _structure(fit: Solved, line: np.ndarray, sensor: str, reference: str | None) -> np.ndarray:
    """(k,) standard deviations by what stationary noise of the torque does not explain.

    Blocks of the record that disagree, another band that does, and what the torque's noise may have moved, unless
    instruments have cured that.
    """
    r = fit.at
    other = in_narrower_band(r.alone(fit.values[:len(r.own)]), sensor, NARROWER)
    if reference:
        other = with_instruments(other, sensor, reference)
    narrow = solved(with_laws(other, [law.name for law in r.laws[0]]))
    other_line, _ = own_of(narrow)
    influence, other_influence = fit.influence @ line.T, narrow.influence @ other_line.T
    off = np.abs(line @ fit.values - other_line @ narrow.values)
    by_noise = np.sqrt(np.diag(sandwich(influence - other_influence))) / SLACK
    by_band = DOUBLED / Z95 * np.maximum(off - by_noise, 0.0)
    by_motion = np.abs(line) @ _moved_by_noise(fit, fit.rows, fit.inverse) / Z95
    return np.sqrt(by_band**2 + by_motion**2 + beyond_stationary(influence, line @ fit.covariance @ line.T) ** 2)


def told_by_each(fit: Solved) -> list[Told]:
    """What each recording says by itself."""
    found = []
    for number in dict.fromkeys(e.number for e in fit.at.experiments):
        rows = [r for r, e in zip(fit.rows, fit.at.experiments, strict=True) if e.number == number]
        matrix, inverse = sum(r.instruments.T @ r.slopes for r in rows), inverse_of(rows)
        change = change_of(rows, inverse)
        own = [replace(r, residual=r.residual - r.slopes @ change) for r in rows]
        covariance = covariance_of_rows(own, inverse)
        beyond = np.hypot(beyond_stationary(influence_of(own, inverse), covariance),
                          _moved_by_noise(fit, own, inverse) / Z95)  # one that hardly accelerates tells no inertia
        found.append(Told(change, fit.inverse @ matrix, np.diag(covariance) + beyond**2,
                          covariance_of_rows(own, fit.inverse), tells(matrix, inverse)))
    return found


def _moved_by_noise(fit: Solved, rows: Sequence[Rows], inverse: np.ndarray) -> np.ndarray:
    """(n,) by how much the fit may err at most, since noise moves what it takes for given.

    Nothing with instruments, but behind shafts: through gaps and friction noise of the motion does not come in
    proportion, and they do not cure it.

    What the motor's torque has too much accelerates the body at most as it would alone; the sensor's noise in the
    acceleration may go through the controller into the torque. That noise is as large in a recording of its own
    inertia, which may hardly accelerate.

    rows  of the fit, or of some of its recordings; inverse: (n, n) by these
    """
    free, found = fit.at.free, np.zeros(len(fit.at.free))
    if fit.at.foreseen and not fit.at.drive.shafts:
        return found
    columns = [j for j, n in enumerate(free) if shared(n) == f"{fit.at.drive.bodies[0]}.inertia"]
    every = np.concatenate([r.slopes[:, columns] for r in fit.rows])
    noise = NOISE_SHARE * np.sum(every**2) / max(np.count_nonzero(every.any(axis=1)), 1)  # of one value
    residual, slopes = (np.concatenate([getattr(r, n) for r in rows]) for n in ("residual", "slopes"))
    for j in columns:
        inertia, here = fit.at.drive.values[free[j]], slopes[:, j] != 0.0
        error, power = float(np.sum(residual[here] ** 2)), noise * np.count_nonzero(here)
        # Of a body without mass nothing follows: then it is as much as both can have in common.
        moment = min(error / max(inertia, 1e-300), np.sqrt(error * float(np.sum(slopes[here, j] ** 2))))
        found += np.abs(inverse[:, j]) * (moment + np.sqrt(power * error) + inertia * power)
    return found


def _held(fit: Solved, known: Covariance | None) -> np.ndarray:
    """(k, k) what the uncertainty of held values adds."""
    names = [n for n in (known.names if known else ()) if n in fit.at.drive.values and n not in fit.at.free]
    if known is None or not names:
        return np.zeros_like(fit.covariance)
    slopes = replace(fit.at, free=tuple(names)).rows()
    gain = fit.inverse @ sum(r.instruments.T @ s.slopes for r, s in zip(fit.rows, slopes, strict=True))
    index = [known.names.index(n) for n in names]
    return gain @ known.matrix[np.ix_(index, index)] @ gain.T


def _lines(fit: Solved, before: Drive, after: Drive, line: np.ndarray, held: np.ndarray,
           structure: np.ndarray) -> tuple[tuple[Parameter, ...], Covariance | None, tuple[Finding, ...]]:
    """The lines of the table, with both parts of their std.

    held  (n, n) what the uncertainty of held values adds; structure: (k,) standard deviations
    """
    names, own, k = fit.at.free, fit.at.own, len(fit.at.free)
    drive = replace(before, known_torques=fit.at.drive.known_torques)
    x, z, r = (np.concatenate([getattr(q, n) for q in fit.rows]) for n in ("slopes", "instruments", "residual"))
    # By what the instruments see of the slopes; without instruments those themselves.
    seen = z @ np.linalg.lstsq(z, x, rcond=1e-12)[0] if k else x
    low, high = (np.array([drive.quantity(n).bounds[i] for n in names]) for i in (0, 1))
    problem = Linear(names, low, high, int(np.count_nonzero(x.any(axis=1))), k)
    normal = Normal(seen.T @ seen, (), (), -seen.T @ r, (), float(r @ r))
    solution = Solution(Point(fit.values, ()), normal, fit.steps, fit.converged)
    plain, inside = covariance_of(problem, solution)[0], fit.inverse.any(axis=1)
    noise, parts = fit.covariance + held, np.zeros((k, k))
    parts[range(len(own)), range(len(own))] = structure**2
    extra = np.where(inside[:, None] & inside & np.isfinite(plain), noise + parts - plain, 0.0)
    lines, _, findings = parameters_of(problem, solution, drive, fit.at.drive, extra)
    noise, found, kept = line @ noise @ line.T, [], []
    for p in lines:
        if p.name in drive.known_torques:
            continue
        if p.status == "fitted" and p.name in own:
            j, value = own.index(p.name), after.values[p.name]
            std = float(np.hypot(np.sqrt(max(noise[j, j], 0.0)), structure[j]))
            lowest, highest = after.quantity(p.name).bounds
            p = replace(p, value=value, std=std, std_noise=float(np.sqrt(max(noise[j, j], 0.0))),
                        std_structure=float(structure[j]),
                        ci95=(max(value - Z95 * std, lowest), min(value + Z95 * std, highest)))
            kept.append(j)
        found.append(replace(p, value=after.values.get(p.name, p.value)))
    matrix = (noise + np.diag(structure**2))[np.ix_(kept, kept)]
    covariance = Covariance(tuple(own[j] for j in kept), matrix) if kept else None
    return tuple(found), covariance, tuple(f for f in findings if not any(n in f.text for n in drive.known_torques))


def _torque_figures(fit: Solved, alone: Inverse,
                    ) -> tuple[TorqueFit, dict[str, float | int | None], tuple[Exhibit, ...]]:
    """How well the motion asks for the torque, over what the filter lets pass, and its picture.

    alone  the drive without laws
    """
    found, e = alone.with_motion(), fit.at.experiments[0]
    f, best = torque_fit(found), torque_fit(fit.at.with_motion())
    figures: dict[str, float | int | None] = {
        "torque_fit_percent": f.fit_percent, "torque_rmse": f.rmse,
        "torque_rmse_over_rms_percent": 100.0 * f.over_rms, "torque_rmse_over_sd": f.over_sd,
        **({"torque_fit_percent_with_laws": best.fit_percent} if fit.at.laws[0] else {}),
        "band_hz": fit.at.seen.each[0].smoothing.cutoff / e.step, "every_sample": fit.at.kept, "n": f.n}
    return best, figures, tuple(torque_picture(e, q, f"{e.name}: torque that the motion asks for")
                             for e, q in zip(fit.at.experiments, found, strict=True))


def _outcome(fit: Solved, reference: str | None) -> str:
    how = "converged" if fit.converged else "stopped"
    band = fit.at.seen.each[0].smoothing.cutoff / fit.at.experiments[0].step
    by = f"with instruments from {reference}" if fit.at.foreseen else "by least squares"
    return f"{how} after {fit.steps} steps, {by}, torque over motion up to {band:.3g} Hz"


def _without(p: Parameter) -> Parameter:
    why = "the motion explains nothing of the torque"
    return p if p.status == "held" else p.untold(why)


def _no_instrument(why: str) -> Finding:
    return Finding(
        "note", "no-instrument",
        f"There is no valid instrument, since {why}: noise that the loop feeds back is in the motion as well as in "
        "the torque. The parameters are those of least squares, and std_structure has "
        "what that may do to them.", {},
        "Log what the outermost loop is asked for: reference_angle, reference_speed or reference_torque.")


def _weak(reference: str, f: float) -> Finding:
    return Finding(
        "warning", "weak-instrument",
        f"{reference} foretells too little of the acceleration to be an instrument (first-stage F {f:.3g}, "
        f"{WEAK:g} is enough). The parameters are those of least squares.",
        {"first_stage_f": f}, "Record a reference that the drive follows, or a larger excitation.")


def _of_feedback(experiments: Sequence[Experiment], sensor: str) -> list[Finding]:
    """A command that does not answer the motion is its cause: then the motion is the question."""
    f = feedback_in(experiments, sensor)
    if f.there or f.new < NEW or any(e.torque_is != "command" for e in experiments):
        return []
    return [Finding(
        "note", "torque-is-the-cause",
        "The torque does not answer the motion: it was given, and the motion followed. A fit that simulates the "
        "motion uses more of this record.", {}, "Compare with --criterion auto.")]


def _nothing(relative: float) -> Finding:
    return Finding(
        "failure", "explains-nothing",
        f"The motion explains nothing of the logged torque: what is left has {relative:.2f} of its standard "
        "deviation.", {"error_over_sd": relative}, "Check the channels, units and signs; run drivetool inspect.")
