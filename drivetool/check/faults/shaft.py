"""The shaft torque sensor against what the motor's torque and motion say the shaft carries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from drivetool.check.faults.record_faults import Fault
from drivetool.check.fit import Model, from_start
from drivetool.drive import Assembly, Drive, Layout, closed_shaft
from drivetool.errors import Finding
from drivetool.identify.noise import filtered, normal_under
from drivetool.identify.problem import schur
from drivetool.identify.setup import Roles, Task, roles_of
from drivetool.identify.starts import KNOWN, totals
from drivetool.logs import Experiment

BLAMED = 4.0  # standard errors of the scale from which the sensor is blamed
SURE = 0.5 * BLAMED**2  # the same in log likelihood
SCALE = 0.02  # relative error of the shaft torque below which it is not blamed
PIECE = 0.25  # s of record that count as independent of the next
STRAIGHT = 0.02  # relative change of a parameter over which all that follows from it is a straight line
# Where to start from besides the base, which may have been bent to a wrong sensor: shares of the load in
# the inertia, and resonances [Hz].
SHARES, RESONANCES = (0.15, 0.5, 0.85), (8.0, 20.0, 50.0)


def shaft_fault(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], wanted: Sequence[str],
                begun: Mapping[str, float] = MappingProxyType({}),
                ) -> tuple[tuple[Experiment, ...], Drive, list[Fault]]:
    """(mended experiments, drive to start from, faults): sign and scale of the shaft torque.

    The drive is fitted to the motor alone, which knows the shaft torque up to the scale of the motor
    torque; which of the two channels is wrong, only a known inertia tells.

    begun  values that the fit of the drive started from: a wrong sensor may have led it far astray
    """
    roles = roles_of(experiments, drive)
    alone = Roles(roles.inputs, tuple(r for r in roles.outputs if r != "shaft_torque"))
    asked = {"wrong-sign", "wrong-scale"} & set(wanted)
    if len(alone.outputs) == len(roles.outputs) or not alone.outputs or not asked:
        return tuple(experiments), drive, []
    task = Task(drive, tuple(n for n in drive.quantities if n in free), alone, tuple(experiments))
    first = {n: begun[n] for n in task.free if n in begun}
    models = _by_the_motor(task, first)
    found = _blamed(models, replace(task, roles=roles), first) if models else None
    if found is None:
        return tuple(experiments), drive, []
    factor, error, model = found
    fault = scale_fault(factor, error)
    if fault.code not in wanted:
        return tuple(experiments), drive, []
    return rescaled(experiments, factor), model.fitted.drive, [fault]


def _by_the_motor(task: Task, first: Mapping[str, float]) -> list[Model]:
    """The drive fitted to the motor alone, from its own values, those its fit began with, and others."""
    models = []
    for values in ({}, *([first] if first else ()), *_elsewhere(task)):
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            models.append(from_start(task.at(values)))
    return models


def _blamed(models: Sequence[Model], whole: Task, first: Mapping[str, float]) -> tuple[float, float, Model] | None:
    """(factor of the sensor, its error, the drive by the motor alone), None if the sensor is to be trusted.

    The scale where the motor tells it; the sign by all that was measured, where it does not.

    models  of the motor alone; whole: the task with the sensor; first: values that its fit began with
    """
    model, step = min(models, key=lambda m: m.value), whole.experiments[0].step
    measured = np.concatenate([e.signals["shaft_torque"][a:b] for e in whole.experiments
                               for a, b in e.segments if b - a >= 10])
    factor, error = scale_of(model, measured, step)
    told = error < abs(factor)
    if told and (abs(factor - 1.0) < max(SCALE, BLAMED * error) or abs(factor) < 0.05):
        return None
    begins = (whole, whole.at(first)) if first else (whole,)
    lead = lead_of(factor, (*begins, _from(model, whole))) if told else 0.0
    if told and lead < SURE:
        return None
    if told and factor > 0.0:
        return factor, error, model
    turned = min(models, key=lambda m: abs(_factor(measured, *shaft_torque_of(m), step)[0] + 1.0))
    near = told and abs(factor + 1.0) < BLAMED * error
    other = np.inf if near else lead_of(-1.0, (*begins, _from(model, whole), _from(turned, whole)))
    if other > (lead - SURE if told else SURE):
        return -1.0, np.nan, turned  # a sign is no measured number
    return (factor, error, model) if told else None


def scale_fault(factor: float, error: float) -> Fault:
    """The sensor that reads `factor` times the shaft torque; an error that is no number: it has the wrong sign."""
    code = "wrong-sign" if factor < 0.0 and abs(abs(factor) - 1.0) < 0.3 else "wrong-scale"
    return Fault(code, Finding(
        "warning", code,
        f"The logged shaft torque is {factor:.4g} times what the motor's torque and motion say the shaft carries.",
        {"factor": factor} | ({"std": error} if np.isfinite(error) else {}),
        "Correct sign, unit or scale of the shaft torque (or of the motor torque) in the channel map."),
        factor=factor, shaft=True)


def scale_of(model: Model, measured: np.ndarray, step: float) -> tuple[float, float]:
    """(factor of a measured shaft torque (n,) over the model's, standard error).

    The error is that of the comparison, and that of the model's own parameters put through it.
    """
    factor, error = _factor(measured, *shaft_torque_of(model), step)
    variance = error**2
    for change, size in _doubts(model):
        moved = replace(model, point=replace(model.point, values=model.point.values + change))
        other, _ = _factor(measured, *shaft_torque_of(moved), step)
        variance += (size * (other - factor)) ** 2
    return factor, float(np.sqrt(variance)) if np.isfinite(variance) else np.inf


def rescaled(experiments: Sequence[Experiment], factor: float) -> tuple[Experiment, ...]:
    """The records as they are if the sensor reads `factor` times the shaft torque."""
    return tuple(replace(e, signals={**e.signals, "shaft_torque": e.signals["shaft_torque"] / factor})
                 for e in experiments)


def lead_of(factor: float, tasks: Sequence[Task]) -> float:
    """Log likelihood of all that was measured that is gained if the sensor has a factor.

    Where the motor tells little of the drive its likelihood is flat and bent, and no standard error holds; this
    ratio does.

    tasks  the drive with the sensor, from several values of its parameters
    """
    def value(tasks: Sequence[Task]) -> float:
        found = [np.inf]
        for task in tasks:
            with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
                found.append(from_start(task).value)
        return min(found)

    count = sum(int(np.isfinite(e.signals["shaft_torque"][a:b]).sum()) for e in tasks[0].experiments
                for a, b in e.segments if b - a >= 10)
    other = [replace(t, experiments=rescaled(t.experiments, factor)) for t in tasks]
    return value(tasks) - value(other) - count * float(np.log(abs(factor)))


def _from(model: Model, whole: Task) -> Task:
    """The task with the values of a model of the motor alone."""
    return whole.at(dict(zip(model.task.free, model.point.values, strict=True)))


def _doubts(model: Model) -> list[tuple[np.ndarray, float]]:
    """Independent changes (k,) of the parameters, and by what to multiply each to have one standard deviation.

    A change is small enough for a straight line. What the motor does not tell, how friction is shared above all, is
    doubted by as much as there is of it in the whole drive.
    """
    problem, normal = model.problem, normal_under(model.problem, model.point, model.noise)
    matrix, _, _ = schur(normal)
    most = np.array([_all_of(name, model) for name in model.task.free])
    variance = normal.cost / max(problem.count - problem.unknowns, 1)
    told, ways = np.linalg.eigh(np.outer(most, most) * matrix / variance + np.eye(len(most)))
    found = []
    for information, way in zip(told, ways.T, strict=True):
        std = most * way / np.sqrt(information)
        share = min(1.0, STRAIGHT / float(np.max(np.abs(std) / most)))
        found.append((share * std, 1.0 / share))
    return found


def _all_of(name: str, model: Model) -> float:
    """Size of a parameter with its like on the other bodies."""
    drive, suffix = model.fitted.drive, name.rpartition(".")[2]
    like = [abs(drive.value(n) or 0.0) for n in model.task.free if n.rpartition(".")[2] == suffix]
    return max(sum(like), 1e-6 * float(model.problem.size[model.task.free.index(name)]))


def _factor(measured: np.ndarray, said: np.ndarray, speed: np.ndarray, step: float) -> tuple[float, float]:
    """(by what the shaft torque that a model says is to be multiplied, standard error), all (n,).

    How friction is shared by the bodies the motor alone does not know: what the shaft carries for that, a constant
    and a share of the speed, is not to count.
    """
    good = np.isfinite(measured)
    rows = np.column_stack([said[good], speed[good], np.ones(good.sum())])
    size = np.linalg.norm(rows, axis=0)
    if len(rows) < 4 or not size.all():
        return 1.0, np.inf
    inverse = np.linalg.pinv(rows / size)
    factors = inverse @ measured[good]
    rest = measured[good] - rows @ (factors / size)
    # What is left repeats from sample to sample: pieces count as independent, not samples.
    pieces = np.add.reduceat(inverse[0] * rest, np.arange(0, len(rest), max(round(PIECE / step), 1)))
    return float(factors[0] / size[0]), float(np.linalg.norm(pieces) / size[0])


def _elsewhere(task: Task) -> list[dict[str, float]]:
    """Other inertias and stiffnesses, for two bodies, with sums of inertia and friction that the record tells."""
    drive = task.drive
    if len(drive.bodies) != 2:
        return []
    motor, load = (f"{b}.inertia" for b in drive.bodies)
    whole, shaft, found = drive.value(motor) + drive.value(load), drive.shafts[0], []
    slow = {motor: 0.5, load: 0.5, f"{shaft}.stiffness": 0.25 * (2.0 * np.pi * RESONANCES[0]) ** 2}
    told = totals(task.at(slow)) or {}
    sums = {n: told[n][0] for n in ("inertia", "viscous", "idle_torque")
            if n in told and told[n][1] < KNOWN * told[n][0]}
    whole = sums.pop("inertia", whole)
    friction = {f"total.{n}": v for n, v in sums.items() if f"total.{n}" in task.free}
    for share in SHARES:
        for rate in 2.0 * np.pi * np.array(RESONANCES):
            stiffness = rate**2 * share * (1.0 - share) * whole
            found.append({motor: (1.0 - share) * whole, load: share * whole, f"{shaft}.stiffness": stiffness,
                          f"{shaft}.damping": 0.06 * stiffness / rate, **friction})
    return found


def shaft_torque_of(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """(torque of the first shaft, gaps closed, speed of the motor), each (n,), at the filtered states."""
    task = model.fitted
    plain = Assembly(task.drive, Layout(task.free, task.roles.inputs, task.roles.outputs, 1.0, gradient=False))
    row = np.zeros(plain.nx)
    for j, dual in closed_shaft(plain, 0).items():
        row[j] = dual.v
    states = np.concatenate([f.states[:, :plain.nx] for f in filtered(model.problem, model.point, model.noise)])
    return states @ row, states[:, 0]
