"""The grey box by inverse dynamics: the parameters at which the motion requires the logged torque.

For motions that are imposed or well known: there the torque responds to the motion. No start state, no noise model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.errors import BadOption
from drivetool.finding import Finding
from drivetool.identify.channels import feedback_in
from drivetool.identify.estimate import (
    MAX_INFLATION,
    Z95,
    Covariance,
    Estimate,
    FoundLaw,
    Parameter,
    PlotData,
    Verdict,
    covariance_of,
    estimate_from_fit,
    masked,
    parameters_of,
)
from drivetool.identify.identifiability import Freed, sums_of_constant_torques
from drivetool.identify.inverse.missing_laws import own_parameters_of, solve_with_laws, with_laws
from drivetool.identify.inverse.regression import (
    InverseFit,
    InverseRegression,
    TorqueProblem,
    first_stage_f,
    in_narrower_band,
    regression_of,
    solve_inverse,
    with_instruments,
)
from drivetool.identify.laws import FEW_BLOCKS_FACTOR, model_error, sandwich_covariance, significant_laws
from drivetool.identify.motion import (
    NOISE_SHARE,
    Rows,
    TorqueFit,
    between_block_std,
    change_of,
    check_no_signal_path,
    covariance_of as covariance_of_rows,
    influence_of,
    inverse_of,
    reference_of,
    torque_fit,
    torque_picture,
)
from drivetool.identify.outcome import RecordingEstimate, identifiable_alone, repeatability_of, with_scatter
from drivetool.identify.problem import Normal, Point, Solution
from drivetool.identify.setup import KnownStart, Options, Roles
from drivetool.logs import Experiment
from drivetool.quantity import name_of, shared

MIN_FIRST_STAGE_F = 10.0  # first-stage F below which instruments are weak (Staiger and Stock 1997)
# Factor by which the comparison band is narrower. A choice: an octave moves what depends on the band, and still
# leaves half of the samples.
COMPARISON_BAND_FACTOR = 2.0
# Half-widths that a disagreement of two bands adds: a comparison sees at best half of the error
HALF_WIDTHS_PER_DISAGREEMENT = 2.0
# Share of the torque's power that its own past does not predict; below it, a closed loop without noise looks open.
MIN_UNPREDICTED_POWER = 1e-3
# Residual over the torque's standard deviation from which the motion explains nothing. A choice: at 0.9 it explains
# a fifth of the power, no more than a wrong channel may by chance.
MAX_RESIDUAL_OVER_SD = 0.9


def greybox_by_inverse(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], roles: Roles,
                       options: Options, transient: tuple[np.ndarray, ...] | None = None) -> Estimate:
    """Physical parameters from the torque that the motor's motion requires.

    experiments  motor_torque and the motor's speed or angle; with reference_angle, reference_speed or
                 reference_torque of the loop, the motion that it predicts is the instrument
    drive        with start values; of a chain the motor is moved as measured, and the rest of it simulated
    free         parameter names
    lead         per recording (n,) samples that are left out; None: the initial transient of the chain
    returns      Estimate; std_noise under stationary errors of any spectrum, std_structure by all other errors
    raises       BadOption: a path between torque and body, or a start state; NotEnoughData
    source       Gautier, Janot and Vandanjon 2013, the filters; Janot, Vandanjon and Gautier 2014, instruments
    """
    check_inverse_options(drive, free, options)
    sensor, inputs = roles.outputs[0], roles.inputs[1:]
    reference, why = reference_of(experiments, sensor)
    first = regression_of(experiments, drive, free, sensor, inputs, transient)
    record, findings = first, []
    if reference is None:
        findings.append(_no_instrument_finding(why))
    else:
        record = with_instruments(first, sensor, reference)
        if (first_stage := first_stage_f(record)) < MIN_FIRST_STAGE_F:
            findings.append(_weak_instrument_finding(reference, first_stage))
            record, reference = first, None
    fit = solve_with_laws(record)
    line, own = own_parameters_of(fit)
    alone, laws = fit.at.alone(own), _found_laws(fit)
    structure = _structural_std(fit, line, sensor, reference)
    lines, covariance, more = _parameter_lines(
        fit, drive, alone.drive, line, _held_value_covariance(fit, options.known), structure)
    repeats = repeatability_of(recording_estimates(fit), line)
    lines, covariance, varies = with_scatter(lines, covariance, alone.own, repeats, alone.drive)
    more = (*more, *varies)
    f, figures, exhibits = _torque_figures(fit, alone)
    heavy = significant_laws(laws, experiments)
    findings += [*more, *([model_error(heavy, next(iter(heavy)))] if heavy else []),
                 *(() if reference else _open_loop_findings(experiments, sensor))]
    return estimate_from_fit(
        "greybox", experiments, alone.drive, lines, covariance, outcome=_outcome_sentence(fit, reference),
        fit=figures, findings=findings, exhibits=exhibits, laws=laws,
        explanation=f"{len(laws)} further effect{'s' if len(laws) > 1 else ''} fitted in addition to the drive "
        "model." if laws else "",
        details={"criterion": "inverse", "outputs": ["motor_torque"], "instruments": reference or "none"}, checks=(
            lambda e: _explained_torque(e, f.over_sd),
            lambda e: sums_of_constant_torques(e, alone.own, options, lambda further: _if_freed(fit, further))))


def check_inverse_options(drive: Drive, free: Sequence[str], options: Options) -> None:
    """Raise BadOption where a motion does not determine the torque of the motor's body."""
    check_no_signal_path(drive, free)
    sums = [n for n in free if n in TOTALS]
    if sums:
        raise BadOption("the friction of each body for --criterion inverse", ", ".join(sums),
                        f"Free {drive.bodies[0]}.{TOTALS[sums[0]]}: the motion of its body is known.")
    if options.start != KnownStart():
        raise BadOption("a criterion that simulates for --start", "inverse, which uses no start state",
                        "Leave --start out, or take --criterion auto.")


def _found_laws(fit: InverseFit) -> tuple[FoundLaw, ...]:
    """The laws that were fitted beside the drive, with their factors."""
    found, k, std = [], len(fit.at.own), np.sqrt(np.diag(fit.covariance))
    for law in fit.at.laws[0]:
        part = slice(k, k + law.size)
        found.append(FoundLaw.of(law.name, fit.values[part], std[part]))
        k += law.size
    return tuple(found)


def _structural_std(fit: InverseFit, line: np.ndarray, sensor: str, reference: str | None) -> np.ndarray:
    """(k,) standard deviations by errors that stationary noise of the torque does not explain.

    Their sources: blocks of the record that disagree, another band that disagrees, and torque noise in the motion,
    unless instruments remove its bias.
    """
    r = fit.at
    other = in_narrower_band(r.alone(fit.values[:len(r.own)]), sensor, COMPARISON_BAND_FACTOR)
    if reference:
        other = with_instruments(other, sensor, reference)
    narrow = solve_inverse(with_laws(other, [law.name for law in r.laws[0]]))
    other_line, _ = own_parameters_of(narrow)
    influence, other_influence = fit.influence @ line.T, narrow.influence @ other_line.T
    off = np.abs(line @ fit.values - other_line @ narrow.values)
    by_noise = np.sqrt(np.diag(sandwich_covariance(influence - other_influence))) / FEW_BLOCKS_FACTOR
    by_band = HALF_WIDTHS_PER_DISAGREEMENT / Z95 * np.maximum(off - by_noise, 0.0)
    by_motion = np.abs(line) @ _max_noise_bias(fit, fit.rows, fit.inverse) / Z95
    return np.sqrt(by_band**2 + by_motion**2 + between_block_std(influence, line @ fit.covariance @ line.T) ** 2)


def recording_estimates(fit: InverseFit) -> list[RecordingEstimate]:
    """The estimate of each recording by itself."""
    found = []
    for number in dict.fromkeys(e.number for e in fit.at.experiments):
        rows = [r for r, e in zip(fit.rows, fit.at.experiments, strict=True) if e.number == number]
        matrix, inverse = sum(r.instruments.T @ r.slopes for r in rows), inverse_of(rows)
        change = change_of(rows, inverse)
        own = [replace(r, residual=r.residual - r.slopes @ change) for r in rows]
        covariance = covariance_of_rows(own, inverse)
        beyond = np.hypot(between_block_std(influence_of(own, inverse), covariance),
                          _max_noise_bias(fit, own, inverse) / Z95)  # without acceleration no inertia shows
        found.append(RecordingEstimate(change, fit.inverse @ matrix, np.diag(covariance) + beyond**2,
                          covariance_of_rows(own, fit.inverse), identifiable_alone(matrix, inverse)))
    return found


def _max_noise_bias(fit: InverseFit, rows: Sequence[Rows], inverse: np.ndarray) -> np.ndarray:
    """(n,) largest bias of the fit by noise in its regressors.

    Zero with instruments, except behind shafts: gaps and friction pass noise of the motion nonlinearly, and
    instruments do not remove its bias.

    A disturbance of the motor's torque accelerates the body at most as if it acted alone. The sensor's noise in the
    acceleration may pass through the controller into the torque. That noise is as large in a recording with an
    inertia of its own, which may hardly accelerate.

    rows  of the fit, or of some of its recordings; inverse: (n, n) by these
    """
    free, found = fit.at.free, np.zeros(len(fit.at.free))
    if fit.at.predicted and not fit.at.drive.shafts:
        return found
    columns = [j for j, n in enumerate(free) if shared(n) == name_of(fit.at.drive.bodies[0], "inertia")]
    every = np.concatenate([r.slopes[:, columns] for r in fit.rows])
    noise = NOISE_SHARE * np.sum(every**2) / max(np.count_nonzero(every.any(axis=1)), 1)  # of one value
    residual, slopes = (np.concatenate([getattr(r, n) for r in rows]) for n in ("residual", "slopes"))
    for j in columns:
        inertia, here = fit.at.drive.values[free[j]], slopes[:, j] != 0.0
        error, power = float(np.sum(residual[here] ** 2)), noise * np.count_nonzero(here)
        # A body without mass gives no limit: then the limit is that of Cauchy and Schwarz.
        moment = min(error / max(inertia, 1e-300), np.sqrt(error * float(np.sum(slopes[here, j] ** 2))))
        found += np.abs(inverse[:, j]) * (moment + np.sqrt(power * error) + inertia * power)
    return found


def _if_freed(fit: InverseFit, further: tuple[str, ...]) -> Freed:
    """Of further values, by the regression."""
    slopes = replace(fit.at, free=further).rows()
    moved = -fit.inverse @ sum(r.instruments.T @ s.slopes for r, s in zip(fit.rows, slopes, strict=True))
    own, other = (np.concatenate([r.slopes for r in rows]) for rows in (fit.rows, slopes))
    left = np.sum((other - own @ np.linalg.lstsq(own, other, rcond=1e-12)[0]) ** 2, axis=0)
    variance = float(np.mean(np.concatenate([r.residual for r in fit.rows]) ** 2))
    imitated = np.sum(other**2, axis=0) > MAX_INFLATION * left
    return fit.at.free, moved, np.where(imitated, np.inf, np.sqrt(variance / np.where(imitated, 1.0, left)))


def _held_value_covariance(fit: InverseFit, known: Covariance | None) -> np.ndarray:
    """(k, k) covariance that the uncertainty of held values adds."""
    held = known and known.part(n for n in known.names if n in fit.at.drive.values and n not in fit.at.free)
    if held is None:
        return np.zeros_like(fit.covariance)
    slopes = replace(fit.at, free=held.names).rows()
    gain = fit.inverse @ sum(r.instruments.T @ s.slopes for r, s in zip(fit.rows, slopes, strict=True))
    return gain @ held.matrix @ gain.T


def _parameter_lines(fit: InverseFit, before: Drive, after: Drive, line: np.ndarray, held: np.ndarray,
           structure: np.ndarray) -> tuple[tuple[Parameter, ...], Covariance | None, tuple[Finding, ...]]:
    """The lines of the table, with both parts of their std.

    held  (n, n) what the uncertainty of held values adds; structure: (k,) standard deviations
    """
    own, k = fit.at.own, len(fit.at.free)
    drive = replace(before, known_torques=fit.at.drive.known_torques)
    x, z, r = (np.concatenate([getattr(q, n) for q in fit.rows]) for n in ("slopes", "instruments", "residual"))
    # The projection of the slopes on the instruments; without instruments the slopes themselves.
    seen = z @ np.linalg.lstsq(z, x, rcond=1e-12)[0] if k else x
    problem = TorqueProblem(fit.at, int(np.count_nonzero(x.any(axis=1))))
    normal = Normal(seen.T @ seen, (), (), -seen.T @ r, (), float(r @ r))
    solution = Solution(Point(fit.values, ()), normal, fit.steps, fit.converged)
    plain, off_bound = covariance_of(problem, solution)[0], fit.inverse.any(axis=1)
    noise, parts = fit.covariance + held, np.zeros((k, k))
    parts[range(len(own)), range(len(own))] = structure**2
    extra = np.where(off_bound[:, None] & off_bound & np.isfinite(plain), noise + parts - plain, 0.0)
    lines, _, findings = parameters_of(problem, solution, drive, fit.at.drive, extra)
    noise, found = line @ noise @ line.T, []
    for p in lines:
        if p.name in drive.known_torques:
            continue
        if p.status == "fitted" and p.name in own:
            j = own.index(p.name)
            by_noise = np.sqrt(max(noise[j, j], 0.0))
            p = p.replace(value=after.values[p.name]).with_interval(
                float(np.hypot(by_noise, structure[j])), after.quantity(p.name).bounds, std_noise=float(by_noise),
                std_structure=float(structure[j]))
        found.append(p.replace(value=after.values.get(p.name, p.value)))
    covariance = Covariance(tuple(own), noise + np.diag(structure**2)).part(
        [p.name for p in found if p.name in own and p.std is not None])
    return tuple(found), covariance, tuple(f for f in findings if not any(n in f.text for n in drive.known_torques))


def _torque_figures(fit: InverseFit, alone: InverseRegression,
                    ) -> tuple[TorqueFit, dict[str, float | int | None], tuple[PlotData, ...]]:
    """How well the required torque fits the logged one, in the filter's passband, and its picture.

    alone  the drive without laws
    """
    found, full, e = alone.with_motion(), fit.at.with_motion(), fit.at.experiments[0]
    f, best = torque_fit(found), torque_fit(full)
    figures: dict[str, float | int | None] = {
        "torque_fit_percent": f.fit_percent, "torque_rmse": f.rmse,
        "torque_rmse_over_rms_percent": 100.0 * f.over_rms, "torque_rmse_over_sd": f.over_sd,
        **({"torque_fit_percent_with_laws": best.fit_percent} if fit.at.laws[0] else {}),
        "band_hz": fit.at.seen.each[0].smoothing.cutoff / e.step, "every_sample": fit.at.kept, "n": f.n}
    return best, figures, tuple(
        torque_picture(e, {"with further effects": one, "by the drive alone": drive} if fit.at.laws[0] else {
            "": drive}, f"{e.name}: torque that the motion requires")
        for e, one, drive in zip(fit.at.experiments, full, found, strict=True))


def _outcome_sentence(fit: InverseFit, reference: str | None) -> str:
    how = "converged" if fit.converged else "stopped"
    band = fit.at.seen.each[0].smoothing.cutoff / fit.at.experiments[0].step
    by = f"with instruments from {reference}" if fit.at.predicted else "by least squares"
    return f"{how} after {fit.steps} steps, {by}, torque regressed on the motion up to {band:.3g} Hz"


def _no_instrument_finding(why: str) -> Finding:
    return Finding(
        "note", "weak-instrument",
        f"There is no valid instrument, since {why}. Noise fed back by the loop affects both motion and torque. "
        "The parameters are those of least squares, and std_structure includes a bound on their bias.", {},
        "Log the reference of the outermost loop: reference_angle, reference_speed or reference_torque.")


def _weak_instrument_finding(reference: str, f: float) -> Finding:
    return Finding(
        "warning", "weak-instrument",
        f"{reference} predicts too little of the acceleration to be an instrument (first-stage F {f:.3g}, "
        f"{MIN_FIRST_STAGE_F:g} is enough). The parameters are those of least squares.",
        {"first_stage_f": f}, "Record a reference that the drive follows, or a larger excitation.")


def _open_loop_findings(experiments: Sequence[Experiment], sensor: str) -> list[Finding]:
    """A torque command without feedback from the motion is its cause: then simulating the motion fits better."""
    f = feedback_in(experiments, sensor)
    if f.significant or f.innovation_share < MIN_UNPREDICTED_POWER or any(e.torque_is != "command"
                                                                          for e in experiments):
        return []
    return [Finding(
        "note", "torque-without-feedback",
        "The torque does not depend on the motion: it was commanded open loop. A fit that simulates the "
        "motion is more efficient.", {}, "Compare with --criterion auto.")]


def _explained_torque(estimate: Estimate, relative: float) -> Verdict:
    """Nothing is identified by a motion that explains nothing; relative: the residual over the torque's std."""
    if relative <= MAX_RESIDUAL_OVER_SD:
        return Verdict()
    return Verdict([Finding(
        "failure", "explains-nothing",
        f"The inverse model explains none of the logged torque: the residual is {relative:.2f} times the standard "
        "deviation of the torque.", {"error_over_sd": relative},
        "Check the channels, units and signs; run drivetool inspect.")],
        masked(estimate, "the inverse model explains none of the torque"))
