"""Values that a record identifies only jointly: an interval of one of them alone would be wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive, is_constant
from drivetool.finding import Finding
from drivetool.identify.estimate import (
    MAX_INFLATION,
    Estimate,
    Parameter,
    Verdict,
    covariance_of,
    sensitivity_to_held,
)
from drivetool.identify.fit import segment_states
from drivetool.identify.noise import filtered_normal_equations
from drivetool.identify.problem import Point, Solution, schur
from drivetool.identify.setup import Options, Outcome, has_gap, problem_of, run_length
from drivetool.quantity import name_of, names_of, owner_of, parse_name, quantity_of

CONSTANT_TORQUES = ("idle_torque", "coulomb")  # in one direction of motion
# Change of a constant torque per change of the other, which it imitates one for one. A choice: half of that.
MIN_IMITATION = 0.5
# Fitted names; (k, m) how these move with each of m further values; (m,) std of a further value if it were free,
# infinite where the fitted ones imitate it.
Freed = tuple[tuple[str, ...], np.ndarray, np.ndarray]

# Relative rounding of a quadratic form whose terms cancel. A choice: far above eps times the number of terms, far
# below the smallest information that a record has.
CANCELLATION_TOLERANCE = 1e-9


def ratios_of_torques(estimate: Estimate, outcome: Outcome) -> Verdict:
    """No interval of any torque where only their ratios are identifiable."""
    if not only_ratios(outcome):
        return Verdict()
    torques = sorted(n for n in outcome.task.free if _scales_with_torque(n, outcome.drive))
    reason = "only its ratio to the other torques is identifiable: no torque of known size acts"
    return Verdict([Finding(
        "warning", "not-identifiable",
        f"This record identifies only the ratios of {', '.join(torques)}: no torque of known size acts.", {},
        "Record while the motor drives, or hold one of them at a known value with --hold.",
        torques[0] if len(torques) == 1 else None)],
        [p.without_interval(reason, "not-identifiable") for p in estimate.parameters if p.name in torques])


def only_ratios(outcome: Outcome) -> bool:
    """Whether only ratios of torques are identifiable: no torque of known size acts on the drive.

    Then all inertias, stiffnesses and frictions may be multiplied by one number without any change.
    """
    problem, point, drive = outcome.problem, outcome.solution.point, outcome.drive
    torques = np.array([_scales_with_torque(n, drive) for n in problem.names], bool)
    held = [n for n, v in drive.values.items()
            if v and n not in problem.names and _scales_with_torque(n, drive) and not is_constant(n)]
    if held or not torques.any():
        return False
    # By free runs: frozen gains turn a torque noise of absolute size into information on the scale. Across a gap a
    # long one does not follow the record, and its error would hide what the torque does.
    problem = replace(problem, memory=None)
    if has_gap(outcome.task):
        problem = outcome.fitted.problem(run_length(outcome.task, np.inf), problem.names)
        point = replace(point, starts=segment_states(outcome.fitted, problem.traces))
    normal = problem.normal(point)
    matrix, _, _ = schur(normal)
    scale = np.where(torques, point.values, 0.0)
    variance = problem.variance(normal.cost)
    information, size = scale @ matrix @ scale, np.abs(scale) @ np.abs(matrix) @ np.abs(scale)
    return bool(information < max(variance, CANCELLATION_TOLERANCE * size))


def _scales_with_torque(name: str, drive: Drive) -> bool:
    """Whether a parameter is measured in torques, alone or over motions."""
    return drive.quantity(name).unit.startswith("{T}")


def sums_of_constant_torques(estimate: Estimate, free: Sequence[str], options: Options,
                             by_fit: Callable[[tuple[str, ...]], Freed]) -> Verdict:
    """Idle torque and Coulomb friction of a body, of which one is fitted: as their sum, where it tells no more.

    The other is freed in thought: if its interval were wider than the sum, the record identifies the sum alone.

    free     fitted parameters of the drive; options: which values are stated, so that the intervals contain their
             uncertainty, if they have one
    by_fit   what the fit says of further parameters
    """
    drive, known = estimate.drive, (*(options.known.names if options.known else ()), *options.hold)
    partners = {n: _other_constant_torque(n, drive) for n in free if quantity_of(n) in CONSTANT_TORQUES}
    partners = {n: other for n, other in partners.items() if other not in (*free, *known)}
    if not partners:
        return Verdict()
    further = tuple(dict.fromkeys(partners.values()))
    names, moved, stds = by_fit(further)
    changed, sums = {}, []
    for p in estimate.parameters:
        other = partners.get(p.name)
        if other is None or p.std is None or stds[further.index(other)] < abs(p.value):
            continue
        by = moved[names.index(p.name), further.index(other)]
        if abs(by) < MIN_IMITATION:  # another value imitates it, as that of the whole drive does
            continue
        sign = "-" if by > 0.0 else "+"
        value = drive.value(other) or 0.0
        total = p.replace(name=f"{p.name} {sign} {other}", value=p.value + float(f"{sign}1") * value, start=None)
        # Of a friction on its bound: the sum may lie beyond.
        sums.append(total.with_interval(p.std) if p.ci95 is None or p.status == "fitted" else total)
        reason = f"the drive turns one way, which identifies only {_stated(total)}"
        changed |= {name: reason for name in (p.name, other)}
    return Verdict(_sum_findings(sums), [p.without_interval(changed[p.name], "not-identifiable")
                                         for p in estimate.parameters if p.name in changed], ratios=sums)


def _stated(total: Parameter) -> str:
    return f"{total.name} = {total.value:.4g} +- {total.std:.2g} {total.unit}"


def _sum_findings(sums: Sequence[Parameter]) -> list[Finding]:
    return [Finding(
        "note", "idle-torque-not-separable",
        "The drive turns one way, where idle torque and Coulomb friction act alike. This record identifies only "
        f"{' and '.join(map(_stated, sums))}.", {s.name: s.value for s in sums},
        "Reverse the drive, if it may turn the other way; or state one of them with --hold.")] if sums else []


def _other_constant_torque(name: str, drive: Drive) -> str:
    """Of the idle torque of a body its Coulomb friction, and the other way round; a sum is one of the motor."""
    owner = drive.bodies[0] if name in TOTALS else owner_of(name)
    if quantity_of(name) == "idle_torque":
        return name_of(owner, "coulomb")
    return "total.idle_torque" if "total.idle_torque" in drive.values and owner == drive.bodies[0] else name_of(
        owner, "idle_torque")


def if_freed(outcome: Outcome, further: Sequence[str]) -> Freed:
    """Of further values, by an outcome of the engine."""
    problem, k = outcome.problem, len(outcome.problem.names)
    more = problem_of(outcome.drive, (*problem.names, *further), outcome.task.roles, problem.traces)
    point = Point(np.array([outcome.drive.value(n) or 0.0 for n in more.names]), outcome.solution.point.starts)
    normal = more.normal(point) if outcome.fit is None else filtered_normal_equations(more, point,
                                                                                      outcome.fit.noise)
    free = replace(more, low=np.full_like(more.low, -np.inf))
    covariance, inflation, _ = covariance_of(free, Solution(point, normal, 0, True))
    # A drive that trembles about standstill moves the other way for an instant, which tells nothing in truth.
    stds = np.where(inflation[k:] < MAX_INFLATION, np.sqrt(np.diag(covariance)[k:]), np.inf)
    return problem.names, sensitivity_to_held(normal, k), stds


def lumped_friction(estimate: Estimate, free: Sequence[str]) -> Verdict:
    """No interval of the friction of a chain that is identified at the motor and, lumped, on the last body."""
    drive, found = estimate.drive, []
    between, last = drive.bodies[1:-1], drive.bodies[-1]
    for line in estimate.parameters:
        body, suffix, _ = parse_name(line.name)
        if suffix not in TOTALS.values() or not lumped_on_last_body(drive, free, suffix):
            continue
        if body in between and line.std is None:
            found.append(line.replace(
                reason=f"contained in the value of {last}; the record identifies only their sum"))
        elif body == last and line.std is not None:
            found.append(line.without_interval(
                f"includes the friction of {' and '.join(between)}, which the record does not distinguish; std of "
                f"their sum {line.std:.2g}"))
    return Verdict(lines=found)


def lumped_on_last_body(drive: Drive, free: Sequence[str], suffix: str) -> bool:
    """Whether the friction behind the motor's shaft is fitted as one value, on the last body."""
    if len(drive.bodies) < 3:
        return False
    first, *between, last = names_of(drive.bodies, suffix)
    return {first, last} <= set(free) and not any(n in free or drive.value(n) for n in between)
