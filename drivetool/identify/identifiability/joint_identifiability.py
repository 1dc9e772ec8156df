"""Values that a record identifies only jointly: an interval of one of them alone would be wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive, is_constant
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance, Parameter
from drivetool.identify.problem import schur
from drivetool.identify.setup import Outcome, Task, reverses
from drivetool.quantity import names_of, parse_name, quantity_of

# Relative rounding of a quadratic form whose terms cancel. A choice: far above eps times the number of terms, far
# below the smallest information that a record has.
CANCELLATION_TOLERANCE = 1e-9


def without_joint_intervals(lines: Sequence[Parameter], task: Task,
                            known: Covariance | None) -> tuple[Parameter, ...]:
    """The lines without the intervals that hold for a sum only; the reason states that sum.

    task   at the estimate
    known  covariance of the given values: the intervals already contain a friction of known uncertainty
    """
    lines = _unidirectional_idle_torque(lines, task, () if known is None else known.names)
    return tuple(_lumped_friction_line(p, task) for p in lines)


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
    # By free runs: frozen gains turn a torque noise of absolute size into information on the scale.
    normal = replace(problem, memory=None).normal(point)
    matrix, _, _ = schur(normal)
    scale = np.where(torques, point.values, 0.0)
    variance = problem.variance(normal.cost)
    information, size = scale @ matrix @ scale, np.abs(scale) @ np.abs(matrix) @ np.abs(scale)
    return bool(information < max(variance, CANCELLATION_TOLERANCE * size))


def _scales_with_torque(name: str, drive: Drive) -> bool:
    """Whether a parameter is measured in torques, alone or over motions."""
    return drive.quantity(name).unit.startswith("{T}")


def without_torque_intervals(lines: Sequence[Parameter], outcome: Outcome) -> tuple[tuple[Parameter, ...], Finding]:
    """The lines without an interval of any torque, and the finding."""
    torques = {n for n in outcome.task.free if _scales_with_torque(n, outcome.drive)}
    found = tuple(
        p.without_interval("only its ratio to the other torques is identifiable: no torque of known size acts",
                           "not-identifiable") if p.name in torques else p for p in lines)
    return found, Finding(
        "warning", "not-identifiable",
        f"This record identifies only the ratios of {', '.join(sorted(torques))}: no torque of known size acts.",
        {}, "Record while the motor drives, or hold one of them at a known value with --hold.",
        next((p.name for p in lines if {p.name} == torques), None))


def _unidirectional_idle_torque(lines: Sequence[Parameter], task: Task,
                                known: Sequence[str]) -> tuple[Parameter, ...]:
    """Idle torque beside a Coulomb friction that is held at a rough value, where the motor turns one way only."""
    drive = task.drive
    held = [n for n in names_of(drive.bodies, "coulomb")
            if (drive.value(n) or 0.0) > 0.0 and n not in task.free and n not in known]
    if not held or reverses(task.experiments):
        return tuple(lines)
    return tuple(p.replace(std=None, ci95=None,
                           reason=f"identifiable only jointly with {' and '.join(held)}, held at "
                           f"{drive.referred_to_motor('coulomb'):.4g} referred "
                           f"to the motor; std of their sum {p.std:.2g}")
                 if quantity_of(p.name) == "idle_torque" and p.std is not None else p for p in lines)


def _lumped_friction_line(line: Parameter, task: Task) -> Parameter:
    """A line of a chain whose friction is identified at the motor and, lumped, on the last body."""
    body, suffix, _ = parse_name(line.name)
    drive, between = task.drive, task.drive.bodies[1:-1]
    if suffix not in TOTALS.values() or body == drive.bodies[0] or not lumped_on_last_body(drive, task.free,
                                                                                           suffix):
        return line
    last, others = drive.bodies[-1], " and ".join(between)
    if body in between and line.std is None:
        return line.replace(reason=f"contained in the value of {last}; the record identifies only their sum")
    if body == last and line.std is not None:
        return line.replace(std=None, ci95=None, reason=f"includes the friction of {others}, which the record "
                            f"does not distinguish; std of their sum {line.std:.2g}")
    return line


def lumped_on_last_body(drive: Drive, free: Sequence[str], suffix: str) -> bool:
    """Whether the friction behind the motor's shaft is fitted as one value, on the last body."""
    if len(drive.bodies) < 3:
        return False
    first, *between, last = names_of(drive.bodies, suffix)
    return {first, last} <= set(free) and not any(n in free or drive.value(n) for n in between)
