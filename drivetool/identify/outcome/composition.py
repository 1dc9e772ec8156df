"""An outcome of the engine as an Estimate: figures, noise, findings, exhibits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.drive.simulation import Trace
from drivetool.finding import Finding
from drivetool.identify.estimate import (
    NOT_CONVERGED_TEXT,
    Check,
    Covariance,
    Estimate,
    Parameter,
    PlotData,
    StartsSection,
    Verdict,
    covariance_of,
    estimate_from_fit,
    explains_to_rounding,
    fit_percent,
    free_run_figures,
    masked,
    parameters_of,
    record_picture,
    rounding_finding,
    sensitivity_to_held,
)
from drivetool.identify.fit import free_run, looks_coloured, whole_run_findings
from drivetool.identify.identifiability import (
    if_freed,
    lumped_friction,
    lumped_on_last_body,
    ratios_of_torques,
    sums_of_constant_torques,
)
from drivetool.identify.laws import Explanation, with_total_uncertainty
from drivetool.identify.noise import filtered_normal_equations
from drivetool.identify.outcome.noise_ratio_uncertainty import noise_ratio_covariance
from drivetool.identify.outcome.repeats import recording_estimates, repeatability_of, with_scatter
from drivetool.identify.problem import Point
from drivetool.identify.setup import (
    UNNAMED_RECORDINGS,
    Options,
    Outcome,
    Task,
    contradicted_start_findings,
    problem_of,
)
from drivetool.identify.starts import MAX_AGREEING_LOSS, start_agrees
from drivetool.quantity import name_of, names_of, quantity_of

# Standard deviations between the values of two steps. A choice: far beyond chance, since model errors differ, too.
MAX_PRIOR_DEVIATION = 8.0
# The same of a body's own friction: chance alone exceeds it in one of 370 (normal distribution)
MAX_FRICTION_DEVIATION = 3.0
# Log likelihood gained in three rounds by a fit that has not converged. A choice: 2 moves a parameter by two of its
# standard deviations.
MAX_CONVERGED_GAIN = 2.0
CORRELATED = Finding(
    "warning", "innovations-correlated",
    "One-step prediction errors are still correlated: the model lacks an effect, and the intervals are conditional "
    "on its structure.", {}, "Run validate, then diagnose.")


def compose(step: str, before: Drive, outcome: Outcome, options: Options, findings: Sequence[Finding] = (),
            details: Mapping[str, object] | None = None,
            fit: Mapping[str, float | int | None] | None = None, explanation: Explanation | None = None,
            correlated: Finding = CORRELATED, alone: str = "", checks: Iterable[Check] = ()) -> Estimate:
    """The Estimate of a step.

    before    the drive with its start values
    options   known, hold: which values are stated
    findings  what the step itself found; those of the fit are added
    fit       further figures
    explanation  whose fit the outcome is; the drive is reported without its laws
    correlated   the finding where one-step prediction errors are still correlated
    alone        without an explanation: why there is none
    checks       of the step, after those of every fit
    """
    task, own = outcome.task, outcome.fitted if explanation is None else explanation.own
    lines, covariance, more = _parameter_lines(before, own, outcome, options, explanation)
    _, begun, runs = free_run(own, noise=outcome.fit.noise if outcome.fit else None)
    traces = own.problem(free=()).traces
    figures = outcome_figures(outcome, traces, runs, explanation.figures if explanation else None)
    exact = explains_to_rounding(traces, runs)
    repeats = not exact and still_correlated(outcome)
    last = [correlated] if repeats else []
    if exact:
        role, unit = task.roles.outputs[0], task.experiments[0].unit(task.roles.outputs[0])
        last = [rounding_finding(f"the {role.replace('_', ' ')}", figures["rmse"], unit)]
    elif not (explanation and explanation.torque_explains_nothing):
        last += whole_run_findings(own, outcome, begun, figures["simulation_fit_percent"], options.seed, covariance)
    return estimate_from_outcome(
        step, own.drive, lines, covariance, outcome, fit=figures | dict(fit or {}), details=details or {},
        findings=(*findings, *more, *last), exhibits=record_plots(outcome, traces, runs),
        starts=starts_of(outcome), repeats=repeats, explanation=explanation.sentence if explanation else alone,
        laws=explanation.laws if explanation else (), checks=(
            lambda e: _convergence(e, outcome, explanation),
            lambda e: ratios_of_torques(e, outcome),
            lambda e: sums_of_constant_torques(e, own.free, options, lambda further: if_freed(outcome, further)),
            lambda e: lumped_friction(e, own.free), *checks))


def _convergence(estimate: Estimate, outcome: Outcome, explanation: Explanation | None) -> Verdict:
    """Nothing has an interval after a fit that has not converged, or whose torque explains nothing."""
    ended = [_not_converged_finding(outcome)] if not_converged(outcome) else []
    if explanation is not None and explanation.torque_explains_nothing:
        return Verdict(ended, masked(estimate, "the logged torque explains nothing"))
    return Verdict(ended, masked(estimate, NOT_CONVERGED_TEXT, None) if ended else ())


def estimate_from_outcome(step: str, drive: Drive, lines: Sequence[Parameter], covariance: Covariance | None,
                          outcome: Outcome, *, details: Mapping[str, object], findings: Sequence[Finding],
                          **more: Any) -> Estimate:
    """The estimate of a step, with what every outcome of the engine states: its noise, its starts, how it ended.

    more  further arguments of `estimate_from_fit`
    """
    noise, noise_findings = noise_parameters(outcome)
    return estimate_from_fit(
        step, outcome.task.experiments, drive, lines, covariance, outcome=how_it_ended(outcome), noise=noise,
        details={**details, "starts": list(outcome.starts), "outputs": list(outcome.task.roles.outputs),
                 **_known_start_details(outcome.task)},
        findings=(*findings, *noise_findings), **more)


def _parameter_lines(before: Drive, own: Task, outcome: Outcome, options: Options,
                     explanation: Explanation | None,
                     ) -> tuple[tuple[Parameter, ...], Covariance | None, tuple[Finding, ...]]:
    """The lines of the table, their covariance, and what is not identifiable or contradicts a given value.

    own  the task at the reported values
    """
    problem, after, known = outcome.problem, outcome.drive, options.known
    by_held, held = _held_value_covariance(outcome, known)
    parts = (by_held, _friction_split_covariance(outcome),
             outcome.fit and noise_ratio_covariance(problem, outcome.fit))
    known_parts = [part for part in parts if part is not None]
    extra = reduce(np.add, known_parts) if known_parts else None
    known_too = replace(before, known_torques=after.known_torques)
    lines, covariance, findings = parameters_of(problem, outcome.solution, known_too, after, extra)
    own_sides = any(r.endswith("_torque") for r in outcome.task.roles.outputs)
    line, names = None, problem.names
    if explanation is not None:
        lines, covariance = with_total_uncertainty(lines, explanation, extra)
        line, names = explanation.line, own.free
    more = [*inconsistent_with_prior(known, before, own.drive, covariance, own_sides),
            *contradicted_start_findings(after, outcome.task.roles, problem, outcome.solution.point,
                                         outcome.fit and outcome.fit.noise,
                                         problem.variance(outcome.solution.cost))]
    repeats = repeatability_of([] if not_converged(outcome) else recording_estimates(outcome), line)
    lines, covariance, varies = with_scatter(lines, covariance, names, repeats, own.drive)
    return lines, covariance, (*findings, *more, *varies, *held)


def _known_start_details(task: Task) -> dict[str, object]:
    """What was known of the start states: of all recordings, and of those that differ by their names."""
    found = dict(task.start.get(UNNAMED_RECORDINGS, {}))
    found |= {e.name: dict(task.start[e.number]) for e in task.experiments if e.number in task.start}
    return {"known_start": found} if task.start else {}


def inconsistent_with_prior(known: Covariance | None, before: Drive, after: Drive, now: Covariance | None,
                 own_sides: bool = False) -> list[Finding]:
    """Findings on estimates that are inconsistent with their prior from the step before.

    known, now  covariance of the given values, and of the estimates
    after       the drive that is reported, without the laws of a default fit
    own_sides   whether a shaft torque identifies each body's friction by itself: then no other law biases it
    """
    if known is None or now is None:
        return []
    off = {}
    for was, std in zip(known.names, np.sqrt(np.diag(known.matrix)), strict=True):
        # A split sum is compared with the sum of its parts.
        parts = names_of(after.bodies, TOTALS[was]) if was in TOTALS and was not in now.names else [was]
        shares = np.array([after.referred_share(n) if len(parts) > 1 else 1.0 for n in parts])
        if was not in before.values or not set(parts) <= set(now.names):
            continue
        value = float(shares @ [after.values[n] for n in parts])
        total = std**2 + float(shares @ now.part(parts).matrix @ shares)
        z = (value - before.values[was]) / np.sqrt(total)
        friction = own_sides and quantity_of(was) in TOTALS.values()
        if abs(z) > (MAX_FRICTION_DEVIATION if friction else MAX_PRIOR_DEVIATION):
            off[was] = f"{was} is {value:.4g}, and was {before.values[was]:.4g} +- {std:.2g}", float(z)
    if not off:
        return []
    behind = name_of(after.load, "coulomb")
    example = (f"; for example, fit the friction of the {after.load} with --free {behind} --set {behind}=1"
               if after.shafts else "")
    return [Finding(
        "warning", "inconsistent-with-prior",
        f"{'; '.join(text for text, _ in off.values())} in the parameter file. One of the two fits lacks an "
        "effect and is biased.",
        {name: z for name, (_, z) in off.items()},
        f"Run diagnose on both recordings{example}. Friction and load may change between days: the values fitted "
        "here are valid for this record.")]


def starts_of(outcome: Outcome) -> StartsSection:
    """How many starts reached the best value, and the range of their parameters."""
    ends = [s["reached"] for s in outcome.starts if start_agrees(outcome, s)]
    ranges = {n: max(e[n] for e in ends) - min(e[n] for e in ends) for n in ends[0]} if ends else {}
    return StartsSection(len(outcome.starts), len(ends), ranges)


def not_converged(outcome: Outcome) -> bool:
    """Whether the fit did not converge: it was still improving when stopped, or no other start confirms it."""
    if outcome.fit is None or not outcome.task.free:
        return False
    if outcome.starts and "apart" in outcome.starts[0] and sum(start_agrees(outcome, s)
                                                               for s in outcome.starts) < 2:
        return True
    if outcome.fit.converged:
        return False
    others = sorted(s["minus_log_likelihood_above_best"] for s in outcome.starts)
    return outcome.fit.gain > MAX_CONVERGED_GAIN or (len(others) > 1 and others[1] > MAX_AGREEING_LOSS)


def _not_converged_finding(outcome: Outcome) -> Finding:
    return Finding(
        "warning", "not-converged",
        "The fit did not converge: it was still improving when it was stopped, or no second start "
        "reached the same optimum. No intervals are given.",
        {"log_likelihood_gain": float(outcome.fit.gain), "rounds": outcome.fit.rounds},
        "Give better start values with --set, hold what is known with --hold, or use a record with more "
        "excitation or without gap crossings.")


def held_value_sensitivity(outcome: Outcome, known: Covariance | None) -> tuple[np.ndarray, Covariance] | None:
    """((k, m) how the k fitted values move with each of m held ones, their covariance); None: none has one."""
    task = outcome.task
    held = known and known.part(n for n in known.names if n not in task.free and n in task.drive.quantities
                                and n in task.drive.values)
    if held is None or not task.free or outcome.fit is None:
        return None
    return _sensitivity_to_further(outcome, outcome.drive, task.free, held.names), held


def _sensitivity_to_further(outcome: Outcome, drive: Drive, free: Sequence[str], more: Sequence[str]) -> np.ndarray:
    """(k, m) how the k free values of a drive move for a unit of each of m further ones."""
    problem = problem_of(drive, (*free, *more), outcome.task.roles, outcome.problem.traces)
    point = Point(np.array([drive.value(n) for n in problem.names]), outcome.solution.point.starts)
    return sensitivity_to_held(filtered_normal_equations(problem, point, outcome.fit.noise), len(free))


def _held_value_covariance(outcome: Outcome, known: Covariance | None) -> tuple[np.ndarray | None, list[Finding]]:
    """The covariance that the uncertainty of held values adds, and a finding where it dominates."""
    found = held_value_sensitivity(outcome, known)
    if found is None:
        return None, []
    moved, held = found
    extra = moved @ held.matrix @ moved.T
    own, _, _ = covariance_of(outcome.problem, outcome.solution)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.sqrt(np.diag(extra) / np.diag(own))
    heavy = {n: float(r) for n, r in zip(outcome.task.free, share, strict=True) if np.isfinite(r) and r > 2.0}
    if not heavy:
        return extra, []
    return extra, [Finding(
        "note", "held-values-dominate",
        f"The uncertainty of held values dominates the interval of {', '.join(heavy)}.",
        heavy, f"This record may identify them better: add --free {' --free '.join(held.names[:4])}.")]


def _friction_split_covariance(outcome: Outcome) -> np.ndarray | None:
    """Covariance from the unknown split of viscous friction between the bodies.

    A sum split by rule damps the resonance a little more or less than the true split, and the shaft damping
    compensates for it.
    """
    if outcome.fit is None:
        return None
    ways = [*_total_split_shifts(outcome), *_lumped_split_shifts(outcome)]
    return np.sum([np.outer(way, way) for way in ways], axis=0) if ways else None


def _total_split_shifts(outcome: Outcome) -> list[np.ndarray]:
    """Where a sum over all bodies is fitted: the load's share has a uniform prior between none and all."""
    task, total = outcome.task, "total.viscous"
    if total not in task.free or len(task.drive.bodies) < 2:
        return []
    whole = abs(float(outcome.drive.values[total]))
    first, last = (name_of(task.drive.bodies[i], "viscous") for i in (0, -1))
    turns = task.drive.gear_ratios()[-1]
    drive = outcome.drive.with_values(outcome.drive.parts(total, whole))
    names = tuple(first if n == total else n for n in task.free)
    shift = _sensitivity_to_further(outcome, drive, names, (last,))[:, 0].copy()
    shift[names.index(first)] += 1.0 / turns**2  # the sum: the motor's part plus the load's, referred
    return [shift * turns**2 * whole / np.sqrt(12.0)]


def _lumped_split_shifts(outcome: Outcome) -> list[np.ndarray]:
    """Where all behind the motor's shaft is lumped on the last body: one between may have none of it or all.

    The fit is at one end of a uniform prior, whose mean square about that end is a third of the whole squared.
    """
    drive, free = outcome.drive, outcome.task.free
    if not lumped_on_last_body(drive, free, "viscous"):
        return []
    last, between = name_of(drive.bodies[-1], "viscous"), tuple(names_of(drive.bodies[1:-1], "viscous"))
    last_share, found = drive.referred_share(last), []
    for name, shift in zip(between, _sensitivity_to_further(outcome, drive, free, between).T.copy(), strict=True):
        share = drive.referred_share(name) / last_share
        shift[free.index(last)] += share  # there the sum of all is identified
        found.append(shift * abs(drive.values[last]) / share / np.sqrt(3.0))
    return found


def outcome_figures(outcome: Outcome, traces: Sequence[Trace], runs: Sequence[np.ndarray],
                    more: Mapping[str, float | int | None] | None = None) -> dict[str, float | int | None]:
    """Figures of the first output: of free runs, (n, ny) of each trace, with further ones, and of one step."""
    y, simulated = (np.concatenate([each[:, 0] for each in table]) for table in ([t.outputs for t in traces], runs))
    passes = outcome.fit and zip(outcome.problem.traces, outcome.fit.passes, strict=True)
    one_step = passes and fit_percent(y, np.concatenate([
        t.outputs[:, 0] - f.innovations[:, 0] for t, f in passes]))
    return free_run_figures(y, simulated, one_step, more)


def how_it_ended(outcome: Outcome) -> str:
    """How the fit ended, in one sentence."""
    n = len(outcome.starts)
    if outcome.fit is not None:
        ended = "converged" if outcome.converged else "did not fully converge"
        return f"The innovations fit {ended} after {outcome.fit.rounds} rounds; best of {n} start(s)."
    ended = "converged" if outcome.converged else "did not converge; give other start values with --set"
    return f"The simulation-error fit {ended} after {outcome.solution.iterations} iterations; best of {n} start(s)."


def noise_parameters(outcome: Outcome) -> tuple[dict[str, float], list[Finding]]:
    """Noise parameters in SI, and the findings on them."""
    problem, task = outcome.problem, outcome.task
    sigma = outcome.sensor_std
    noise = {f"sensor_std.{role}": sigma * float(s) for role, s in zip(
        task.roles.outputs, problem.scale if outcome.fit is None else outcome.fit.noise.scale, strict=True)}
    findings = []
    if outcome.fit is None:
        return noise, [Finding(
            "note", "simulation-criterion",
            "The intervals assume that the torque is known exactly and only the sensors are noisy; under "
            "torque noise they are too narrow.", {}, "Use --criterion innovations for intervals that hold.")]
    model = outcome.fit.noise
    noise["torque_std"] = model.ratio * sigma
    if model.memory is not None:
        noise["torque_correlation_time"] = -problem.step / float(np.log(model.memory))
    if model.slow is not None:
        noise["torque_slow_share"] = model.slow
    if any(e.torque_is == "measurement" for e in task.experiments):
        findings.append(Finding(
            "warning", "torque-source",
            "The logged torque is a measurement: its noise does not act on the drive, and weighting "
            "cannot remove the bias.", {"torque_std": noise["torque_std"]},
            "Log the torque command if the drive offers it."))
    elif all(e.torque_is == "unknown" for e in task.experiments):
        findings.append(Finding(
            "note", "torque-source",
            "The logged torque is taken as the command, with torque noise acting on the drive.", {},
            "State torque_is: command or measurement in the channel map."))
    return noise, findings


def still_correlated(outcome: Outcome) -> bool:
    """Whether one-step prediction errors are correlated with each other: the model lacks an effect."""
    return outcome.fit is not None and looks_coloured(outcome.fit.passes)


def record_plots(outcome: Outcome, traces: Sequence[Trace], runs: Sequence[np.ndarray]) -> tuple[PlotData, ...]:
    """Measured and simulated of every sensor; those of the second and further ones have its name and unit."""
    task = outcome.task
    names = [f"{role.replace('_', ' ')} [{task.experiments[0].unit(role)}]" for role in task.roles.outputs]
    found, done = [], 0
    for e in task.experiments:
        count = sum(b - a >= 10 for a, b in e.segments)  # traces come in this order
        mine = range(done, done + count)
        done += count
        y = np.concatenate([traces[i].outputs for i in mine])
        s = np.concatenate([runs[i] for i in mine])
        u = np.concatenate([traces[i].inputs[:, 0] for i in mine])
        t = np.concatenate([e.time[a:b] for a, b in e.segments if b - a >= 10])
        found.append(record_picture(f"{e.name}: measured and simulated", names[0], t, y[:, 0], s[:, 0], {
            f"{word} {name}": values[:, k] for k, name in enumerate(names[1:], 1)
            for word, values in (("measured", y), ("simulated", s), ("residual", y - s))} | {
            f"torque [{e.torque_unit}]": u}))
    return tuple(found)
