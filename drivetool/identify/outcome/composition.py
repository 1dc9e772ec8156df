"""An outcome of the engine as an Estimate: figures, noise, findings, exhibits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.errors import Finding
from drivetool.identify.estimate import (
    Covariance,
    Estimate,
    Exhibit,
    Parameter,
    Starts,
    covariance_of,
    explains,
    fit_percent,
    moved_by_held,
    parameters_of,
    rounding_alone,
    without_intervals,
)
from drivetool.identify.fit import free_run, looks_coloured
from drivetool.identify.identifiability import on_the_last, only_ratios, told_together, without_sizes
from drivetool.identify.laws import Explanation, told
from drivetool.identify.noise import normal_under
from drivetool.identify.outcome.noise_doubt import from_noise_doubt
from drivetool.identify.outcome.repeats import repeats_of, told_by_each, with_scatter
from drivetool.identify.problem import Point, schur
from drivetool.identify.setup import EVERY, Outcome, Task, contradicted_start, problem_of
from drivetool.identify.starts import CONFIRMED, agrees
from drivetool.logs import sources

CONTRADICTED = 8.0  # standard deviations between what two steps found
OF_A_SIDE = 3.0  # the same of a body's own friction: chance alone tops it in one of 370
STILL = 2.0  # log likelihood gained in three rounds by a fit that has not settled
CORRELATED = Finding(
    "warning", "innovations-correlated",
    "One-step errors are still correlated: the model leaves something out, and the intervals are conditional on "
    "its structure.", {}, "Run validate, then diagnose.")


def compose(step: str, before: Drive, outcome: Outcome, findings: Sequence[Finding] = (),
            details: Mapping[str, object] | None = None,
            fit: Mapping[str, float | int | None] | None = None,
            known: Covariance | None = None, explanation: Explanation | None = None,
            correlated: Finding = CORRELATED) -> Estimate:
    """The Estimate of a step.

    before    the drive with its start values
    findings  what the step itself found; those of the fit are added
    fit       further figures
    known     covariance of the values the step was given
    explanation  of which the outcome is the fit; the drive is reported without its laws
    correlated   what is said where one-step errors are still correlated
    """
    task, own = outcome.task, outcome.task.at_point(outcome.solution.point)
    if explanation is not None:
        own = explanation.own
    lines, covariance, more = _lines(before, own, outcome, known, explanation)
    _, _, runs = free_run(own, noise=outcome.fit.noise if outcome.fit else None)
    traces = own.problem(free=()).traces
    y = np.concatenate([t.outputs[:, 0] for t in traces])
    simulated = np.concatenate([r[:, 0] for r in runs])
    figures = {
        "simulation_fit_percent": fit_percent(y, simulated), **(explanation.figures if explanation else {}),
        "one_step_fit_percent": one_step_percent(outcome, y),
        "rmse": float(np.sqrt(np.nanmean((y - simulated) ** 2))),
        "n": int(np.isfinite(y).sum()),
        **(fit or {}),
    }
    noise, noise_findings = noise_figures(outcome)
    exact = explains(traces, runs)
    repeats = not exact and still_correlated(outcome)
    if exact:
        role, unit = task.roles.outputs[0], _unit(task.roles.outputs[0], task.experiments[0])
        noise_findings.append(rounding_alone(f"the {role.replace('_', ' ')}", figures["rmse"], unit))
    if repeats:
        noise_findings.append(correlated)
    return Estimate(
        step, own.drive, lines, how_it_ended(outcome), figures, covariance, noise,
        {**(details or {}), "starts": list(outcome.starts), "outputs": list(task.roles.outputs),
         **_known_start(task)},
        (*findings, *more, *noise_findings),
        sources(task.experiments), {},
        record_exhibits(outcome, traces, runs), starts_of(outcome),
        *(("", ()) if explanation is None else (explanation.sentence, explanation.laws)),
        repeats=repeats)


def _lines(before: Drive, own: Task, outcome: Outcome, known: Covariance | None, explanation: Explanation | None,
           ) -> tuple[tuple[Parameter, ...], Covariance | None, tuple[Finding, ...]]:
    """The lines of the table, their covariance, and what could not be told.

    own  the task at the reported values
    """
    problem, after = outcome.problem, outcome.drive
    extra, held = _from_held(outcome, known)
    extra = _plus(extra, _from_sharing(outcome))
    if outcome.fit is not None:
        extra = _plus(extra, from_noise_doubt(problem, outcome.fit))
    known_too = replace(before, known_torques=after.known_torques)
    lines, covariance, untold = parameters_of(problem, outcome.solution, known_too, after, extra)
    own_sides = any(r.endswith("_torque") for r in outcome.task.roles.outputs)
    more = [*contradicted(known, before, after, covariance, own_sides), *_not_begun_so(outcome)]
    line, names = None, problem.names
    if explanation is not None:
        lines, covariance = told(lines, explanation, extra)
        line, names = explanation.line, own.free
    repeats = repeats_of([] if unsettled(outcome) else told_by_each(outcome), line)
    lines, covariance, varies = with_scatter(lines, covariance, names, repeats, own.drive)
    more += varies
    if only_ratios(outcome):
        lines, ratios = without_sizes(lines, outcome)
        untold, more = (), [*more, ratios]
    lines, covariance = told_together(lines, covariance, own, known)
    if unsettled(outcome):
        lines, covariance, more = without_intervals(lines), None, [*more, _not_settled(outcome)]
    if explanation is not None and explanation.worthless:
        lines, covariance = without_intervals(lines, "the logged torque explains nothing"), None
    return lines, covariance, (*untold, *more, *held)


def _known_start(task: Task) -> dict[str, object]:
    """What was known of the start states: of all recordings, and of those that differ by their names."""
    found = dict(task.start.get(EVERY, {}))
    found |= {e.name: dict(task.start[e.number]) for e in task.experiments if e.number in task.start}
    return {"known_start": found} if task.start else {}


def contradicted(known: Covariance | None, before: Drive, after: Drive, now: Covariance | None,
                 own_sides: bool = False) -> list[Finding]:
    """What came out far from where the step before, by its own interval, had found it.

    known, now  covariance of the values that the step was given, and of those that it found
    own_sides   whether a shaft torque tells each body's friction by itself: then no other law is in it
    """
    if known is None or now is None:
        return []
    off = {}
    for was, std in zip(known.names, np.sqrt(np.diag(known.matrix)), strict=True):
        # A sum that was parted is held against the sum of its parts.
        parts = [f"{b}.{TOTALS[was]}" for b in after.bodies] if was in TOTALS and was not in now.names else [was]
        shares = np.array([after.felt_share(n) if len(parts) > 1 else 1.0 for n in parts])
        if was not in before.values or not set(parts) <= set(now.names):
            continue
        index = [now.names.index(n) for n in parts]
        value = float(shares @ [after.values[n] for n in parts])
        total = std**2 + float(shares @ now.matrix[np.ix_(index, index)] @ shares)
        z = (value - before.values[was]) / np.sqrt(total)
        friction = own_sides and was.rpartition(".")[2] in TOTALS.values()
        if abs(z) > (OF_A_SIDE if friction else CONTRADICTED):
            off[was] = f"{was} is {value:.4g}, and was {before.values[was]:.4g} +- {std:.2g}", float(z)
    if not off:
        return []
    return [Finding(
        "warning", "contradicts-the-file",
        f"{'; '.join(text for text, _ in off.values())} in the file: what one of the two steps left out is in "
        "these values.",
        {name: z for name, (_, z) in off.items()},
        "Run diagnose on both recordings; friction of the load, say, is fitted with --free load.coulomb "
        "--set load.coulomb=1. Friction and load of another day may be others: this record's values hold for it.")]


def _not_begun_so(outcome: Outcome) -> list[Finding]:
    """Known start states that the record contradicts."""
    problem, solution, fit = outcome.problem, outcome.solution, outcome.fit
    variance = solution.cost / max(problem.count - problem.unknowns, 1)
    return contradicted_start(
        outcome.drive, outcome.task.roles, problem, solution.point, fit and fit.noise, variance)


def starts_of(outcome: Outcome) -> Starts:
    """How many starts came to the best value, and how far apart their parameters ended."""
    ends = [s["reached"] for s in outcome.starts if agrees(outcome, s)]
    spread = {n: max(e[n] for e in ends) - min(e[n] for e in ends) for n in ends[0]} if ends else {}
    return Starts(len(outcome.starts), len(ends), spread)


def unsettled(outcome: Outcome) -> bool:
    """Whether the fit was still finding better values when stopped, or no other start confirms it."""
    if outcome.fit is None or not outcome.task.free:
        return False
    if outcome.starts and "apart" in outcome.starts[0] and sum(agrees(outcome, s) for s in outcome.starts) < 2:
        return True
    if outcome.fit.converged:
        return False
    others = sorted(s["minus_log_likelihood_above_best"] for s in outcome.starts)
    return outcome.fit.gain > STILL or (len(others) > 1 and others[1] > CONFIRMED)


def _not_settled(outcome: Outcome) -> Finding:
    return Finding(
        "warning", "not-settled",
        "The fit did not settle: it was still finding better values when it was stopped, or no second start "
        "ended at the same ones. No intervals are given.",
        {"log_likelihood_gain": float(outcome.fit.gain), "rounds": outcome.fit.rounds},
        "Start nearer with --set, hold what is known with --hold, or use a livelier or a gap-free record.")


def moved_with(outcome: Outcome, known: Covariance | None) -> tuple[np.ndarray, Covariance] | None:
    """((k, m) how the k fitted values move with each of m held ones, their covariance); None: none has one."""
    task = outcome.task
    names = tuple(n for n in known.names if n not in task.free and n in task.drive.quantities) if known else ()
    total = [n for n in names if n in task.drive.values]
    if known is None or not total or not task.free or outcome.fit is None:
        return None
    index = [known.names.index(n) for n in total]
    held = Covariance(tuple(total), known.matrix[np.ix_(index, index)])
    task = task.at_point(outcome.solution.point)
    problem = problem_of(task.drive, (*task.free, *total), task.roles, outcome.problem.traces)
    values = np.array([task.drive.value(n) for n in problem.names])
    point = Point(values, outcome.solution.point.starts)
    return moved_by_held(normal_under(problem, point, outcome.fit.noise), len(task.free)), held


def _from_held(outcome: Outcome, known: Covariance | None) -> tuple[np.ndarray | None, list[Finding]]:
    """What the uncertainty of held values adds to the covariance, and whether it dominates."""
    found = moved_with(outcome, known)
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
        f"The interval of {', '.join(heavy)} comes mostly from the uncertainty of the values that were held.",
        heavy, f"This record may know them better: add --free {' --free '.join(held.names[:4])}.")]


def _plus(a: np.ndarray | None, b: np.ndarray | None) -> np.ndarray | None:
    return b if a is None else a if b is None else a + b


def _from_sharing(outcome: Outcome) -> np.ndarray | None:
    """Covariance from not knowing how viscous friction is shared between the bodies.

    A sum shared out by rule damps the resonance a little more or less than the true one does,
    which the shaft damping takes up.
    """
    if outcome.fit is None:
        return None
    ways = [*_of_the_sum(outcome), *_behind_the_shaft(outcome)]
    return np.sum([np.outer(way, way) for way in ways], axis=0) if ways else None


def _of_the_sum(outcome: Outcome) -> list[np.ndarray]:
    """Where a sum over all bodies is fitted: the load's share is taken as uniform between none and all."""
    task, total = outcome.task, "total.viscous"
    if total not in task.free or len(task.drive.bodies) < 2:
        return []
    whole = abs(float(outcome.drive.values[total]))
    first, last = (f"{task.drive.bodies[i]}.viscous" for i in (0, -1))
    turns = task.drive.turns()[-1]
    drive = outcome.drive.with_values(outcome.drive.parts(total, whole))
    names = tuple(first if n == total else n for n in task.free)
    (shift,) = _shifts(outcome, drive, names, (last,))
    shift[names.index(first)] += 1.0 / turns**2  # the sum is the motor's part plus what is felt of the load's
    return [shift * turns**2 * whole / np.sqrt(12.0)]


def _behind_the_shaft(outcome: Outcome) -> list[np.ndarray]:
    """Where all behind the motor's shaft is fitted on the last body: one between may have none of it or all.

    The fit is at one end of what is uniform, which is off by its mean square, a third of the whole.
    """
    drive, free = outcome.drive, outcome.task.free
    if not on_the_last(drive, free, "viscous"):
        return []
    last, between = f"{drive.bodies[-1]}.viscous", tuple(f"{b}.viscous" for b in drive.bodies[1:-1])
    felt, found = drive.felt_share(last), []
    for name, shift in zip(between, _shifts(outcome, drive, free, between), strict=True):
        share = drive.felt_share(name) / felt
        shift[free.index(last)] += share  # what is told there is all together
        found.append(shift * abs(drive.values[last]) / share / np.sqrt(3.0))
    return found


def _shifts(outcome: Outcome, drive: Drive, free: Sequence[str], more: Sequence[str]) -> list[np.ndarray]:
    """How the free values move for a unit of each further one: (n free,) for each of `more`."""
    problem = problem_of(drive, (*free, *more), outcome.task.roles, outcome.problem.traces)
    point = Point(np.array([drive.value(n) for n in problem.names]), outcome.solution.point.starts)
    matrix, _, _ = schur(normal_under(problem, point, outcome.fit.noise))
    k = len(free)
    moved = -np.linalg.pinv(matrix[:k, :k], hermitian=True) @ matrix[:k, k:]
    return list(moved.T.copy())


def one_step_percent(outcome: Outcome, y: np.ndarray) -> float | None:
    if outcome.fit is None:
        return None
    predicted = np.concatenate([t.outputs[:, 0] - f.innovations[:, 0] for t, f in zip(
        outcome.problem.traces, outcome.fit.passes, strict=True)])
    return fit_percent(y, predicted)


def how_it_ended(outcome: Outcome) -> str:
    """How the fit ended, in one sentence."""
    n = len(outcome.starts)
    if outcome.fit is not None:
        ended = "settled" if outcome.converged else "did not quite settle"
        return f"The innovations fit {ended} after {outcome.fit.rounds} rounds; best of {n} start(s)."
    ended = "converged" if outcome.converged else "did not converge; give other start values with --set"
    return f"The simulation-error fit {ended} after {outcome.solution.iterations} iterations; best of {n} start(s)."


def noise_figures(outcome: Outcome) -> tuple[dict[str, float], list[Finding]]:
    """Noise figures in SI, and what they mean."""
    problem, solution, task = outcome.problem, outcome.solution, outcome.task
    sigma = float(np.sqrt(solution.cost / max(problem.count - problem.unknowns, 1)))
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
            "warning", "torque-is-measured",
            "The logged torque is a measurement: its noise was not applied to the drive, and no weighting "
            "repairs that.", {"torque_std": noise["torque_std"]},
            "Log the torque command if the drive offers it."))
    elif all(e.torque_is == "unknown" for e in task.experiments):
        findings.append(Finding(
            "note", "torque-command-assumed",
            "The logged torque is taken as the command, with the noise between it and the shaft.", {},
            "State torque_is: command or measurement in the channel map."))
    return noise, findings


def still_correlated(outcome: Outcome) -> bool:
    """Whether one-step errors are correlated with each other: the model leaves something out."""
    return outcome.fit is not None and looks_coloured(outcome.fit.passes)


def record_exhibits(outcome: Outcome, traces, runs) -> tuple[Exhibit, ...]:
    task = outcome.task
    unit = _unit(task.roles.outputs[0], task.experiments[0])
    label = task.roles.outputs[0].replace("_", " ")
    found, done = [], 0
    for e in task.experiments:
        count = sum(b - a >= 10 for a, b in e.segments)  # traces come in this order
        mine = range(done, done + count)
        done += count
        y = np.concatenate([traces[i].outputs[:, 0] for i in mine])
        s = np.concatenate([runs[i][:, 0] for i in mine])
        u = np.concatenate([traces[i].inputs[:, 0] for i in mine])
        t = np.concatenate([e.time[a:b] for a, b in e.segments if b - a >= 10])
        found.append(Exhibit("record", f"{e.name}: measured and simulated", "time [s]", f"{label} [{unit}]", {
            "measured": (t, y), "simulated": (t, s), "residual": (t, y - s),
            f"torque [{e.torque_unit}]": (t, u)}))
    return tuple(found)


def _unit(role: str, experiment) -> str:
    if role.endswith("speed"):
        return f"{experiment.motion_unit}/s"
    return experiment.motion_unit if role.endswith("angle") else experiment.torque_unit
