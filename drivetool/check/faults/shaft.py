"""The shaft torque sensor against the shaft torque from the motor's torque and motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from drivetool.check.faults.record_faults import Fault
from drivetool.check.fit import Model, fit_from_start
from drivetool.drive import Assembly, Drive, Layout
from drivetool.finding import Finding
from drivetool.identify.noise import filtered, filtered_normal_equations
from drivetool.identify.problem import schur
from drivetool.identify.setup import Roles, Task, roles_of
from drivetool.identify.starts import MAX_RELATIVE_STD, regressed_totals
from drivetool.logs import Experiment
from drivetool.quantity import name_of, names_of, quantity_of

# Standard errors of the scale. A choice: one test per record, and a false alarm changes the record.
SENSOR_SIGNIFICANCE = 4.0
MIN_SENSOR_LEAD = 0.5 * SENSOR_SIGNIFICANCE**2  # the same in log likelihood: half its square
# Relative error of the shaft torque. A choice: sensors are calibrated to a per cent or two.
MIN_SHAFT_SCALE_ERROR = 0.02
# s of record that count as independent of the next. A choice: longer than the shaft oscillates.
INDEPENDENT_INTERVAL = 0.25
LINEAR_RANGE = 0.02  # relative change of a parameter over which the model is linear (a choice)
# Starts besides the base, which a wrong sensor may have biased: shares of the load in the inertia, and
# resonances [Hz]. A choice: they span usual machines.
LOAD_INERTIA_SHARES, START_RESONANCES = (0.15, 0.5, 0.85), (8.0, 20.0, 50.0)


def shaft_fault(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], wanted: Sequence[str],
                initial_fit: Mapping[str, float] = MappingProxyType({}),
                ) -> tuple[tuple[Experiment, ...], Drive, list[Fault]]:
    """(corrected experiments, drive to start from, faults): sign and scale of the shaft torque.

    The drive is fitted to the motor channels only, which identify the shaft torque up to the scale of the motor
    torque. Which of the two channels is wrong, only a known inertia decides.

    initial_fit  start values of the drive's fit: with a wrong sensor it may have diverged from them
    """
    roles = roles_of(experiments, drive)
    without_sensor = Roles(roles.inputs, tuple(r for r in roles.outputs if r != "shaft_torque"))
    requested = {"wrong-sign", "wrong-scale"} & set(wanted)
    if len(without_sensor.outputs) == len(roles.outputs) or not without_sensor.outputs or not requested:
        return tuple(experiments), drive, []
    task = Task(drive, tuple(n for n in drive.quantities if n in free), without_sensor, tuple(experiments))
    first = {n: initial_fit[n] for n in task.free if n in initial_fit}
    models = _fits_without_sensor(task, first)
    found = _sensor_error(models, replace(task, roles=roles), first) if models else None
    if found is None:
        return tuple(experiments), drive, []
    factor, error, model = found
    fault = scale_fault(factor, error)
    if fault.code not in wanted:
        return tuple(experiments), drive, []
    return rescaled(experiments, factor), model.fitted.drive, [fault]


def _fits_without_sensor(task: Task, first: Mapping[str, float]) -> list[Model]:
    """The drive fitted to the motor channels only, from its own values, its start values, and others."""
    models = []
    for values in ({}, *([first] if first else ()), *_alternative_starts(task)):
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            models.append(fit_from_start(task.at(values)))
    return models


def _sensor_error(models: Sequence[Model], whole: Task, first: Mapping[str, float],
                  ) -> tuple[float, float, Model] | None:
    """(factor of the sensor, its error, the drive from the motor channels), None if the sensor is right.

    The scale where the motor channels identify it; elsewhere the sign, by the likelihood of all channels.

    models  of the motor channels only; whole: the task with the sensor; first: its start values
    """
    model, step = min(models, key=lambda m: m.value), whole.experiments[0].step
    measured = np.concatenate([e.signals["shaft_torque"][a:b] for e in whole.experiments
                               for a, b in e.segments if b - a >= 10])
    factor, error = scale_of(model, measured, step)
    identifiable = error < abs(factor)
    if identifiable and (abs(factor - 1.0) < max(MIN_SHAFT_SCALE_ERROR, SENSOR_SIGNIFICANCE * error)
                         or abs(factor) < 0.05):
        return None
    starts = (whole, whole.at(first)) if first else (whole,)
    lead = log_likelihood_gain_of_factor(factor, (*starts, _task_at(model, whole))) if identifiable else 0.0
    if identifiable and lead < MIN_SENSOR_LEAD:
        return None
    if identifiable and factor > 0.0:
        return factor, error, model
    inverted = min(models, key=lambda m: abs(_regression_factor(measured, *shaft_torque_of(m), step)[0] + 1.0))
    near = identifiable and abs(factor + 1.0) < SENSOR_SIGNIFICANCE * error
    inverted_lead = np.inf if near else log_likelihood_gain_of_factor(-1.0,
                                                       (*starts, _task_at(model, whole), _task_at(inverted, whole)))
    if inverted_lead > (lead - MIN_SENSOR_LEAD if identifiable else MIN_SENSOR_LEAD):
        return -1.0, np.nan, inverted  # a sign has no standard error
    return (factor, error, model) if identifiable else None


def scale_fault(factor: float, error: float) -> Fault:
    """The fault of a sensor that reads `factor` times the shaft torque; an error of NaN: it has the wrong sign."""
    code = "wrong-sign" if factor < 0.0 and abs(abs(factor) - 1.0) < 0.3 else "wrong-scale"
    return Fault(code, Finding(
        "warning", code,
        f"The logged shaft torque is {factor:.4g} times the shaft torque computed from motor torque and motion.",
        {"factor": factor} | ({"std": error} if np.isfinite(error) else {}),
        "Correct sign, unit or scale of the shaft torque (or of the motor torque) in the channel map."),
        factor=factor, shaft=True)


def scale_of(model: Model, measured: np.ndarray, step: float) -> tuple[float, float]:
    """(factor of a measured shaft torque (n,) over the model's, standard error).

    The error is that of the regression, and that of the model's parameters propagated through it.
    """
    factor, error = _regression_factor(measured, *shaft_torque_of(model), step)
    variance = error**2
    for change, size in _parameter_deviations(model):
        moved = replace(model, point=replace(model.point, values=model.point.values + change))
        other, _ = _regression_factor(measured, *shaft_torque_of(moved), step)
        variance += (size * (other - factor)) ** 2
    return factor, float(np.sqrt(variance)) if np.isfinite(variance) else np.inf


def rescaled(experiments: Sequence[Experiment], factor: float) -> tuple[Experiment, ...]:
    """The records corrected for a sensor that reads `factor` times the shaft torque."""
    return tuple(replace(e, signals={**e.signals, "shaft_torque": e.signals["shaft_torque"] / factor})
                 for e in experiments)


def log_likelihood_gain_of_factor(factor: float, tasks: Sequence[Task]) -> float:
    """Gain in log likelihood of all channels if the sensor has a factor.

    Where the motor channels identify little of the drive, the likelihood is flat and far from a parabola, and no
    standard error holds; this likelihood ratio does.

    tasks  the drive with the sensor, from several values of its parameters
    """
    def value(tasks: Sequence[Task]) -> float:
        found = [np.inf]
        for task in tasks:
            with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
                found.append(fit_from_start(task).value)
        return min(found)

    count = sum(int(np.isfinite(e.signals["shaft_torque"][a:b]).sum()) for e in tasks[0].experiments
                for a, b in e.segments if b - a >= 10)
    other = [replace(t, experiments=rescaled(t.experiments, factor)) for t in tasks]
    return value(tasks) - value(other) - count * float(np.log(abs(factor)))


def _task_at(model: Model, whole: Task) -> Task:
    """The task with the values of a model of the motor channels."""
    return whole.at(dict(zip(model.task.free, model.point.values, strict=True)))


def _parameter_deviations(model: Model) -> list[tuple[np.ndarray, float]]:
    """Independent changes (k,) of the parameters, and the factor of each to one standard deviation.

    A change is small enough for linearisation. What the motor channels do not identify, above all the split of
    friction, has a prior standard deviation of its sum over the whole drive.
    """
    problem, normal = model.problem, filtered_normal_equations(model.problem, model.point, model.noise)
    matrix, _, _ = schur(normal)
    prior_std = np.array([_sum_over_bodies(name, model) for name in model.task.free])
    variance = problem.variance(normal.cost)
    eigenvalues, eigenvectors = np.linalg.eigh(
        np.outer(prior_std, prior_std) * matrix / variance + np.eye(len(prior_std)))
    found = []
    for information, direction in zip(eigenvalues, eigenvectors.T, strict=True):
        std = prior_std * direction / np.sqrt(information)
        share = min(1.0, LINEAR_RANGE / float(np.max(np.abs(std) / prior_std)))
        found.append((share * std, 1.0 / share))
    return found


def _sum_over_bodies(name: str, model: Model) -> float:
    """Sum of a parameter over all bodies."""
    drive, suffix = model.fitted.drive, quantity_of(name)
    like = [abs(drive.value(n) or 0.0) for n in model.task.free if quantity_of(n) == suffix]
    return max(sum(like), 1e-6 * float(model.problem.size[model.task.free.index(name)]))


def _regression_factor(measured: np.ndarray, modelled: np.ndarray, speed: np.ndarray,
                       step: float) -> tuple[float, float]:
    """(factor of the measured over the modelled shaft torque, standard error), all (n,).

    The motor channels do not identify the split of friction between the bodies: its part of the shaft torque, a
    constant and a share of the speed, is taken up by further regressors.
    """
    good = np.isfinite(measured)
    rows = np.column_stack([modelled[good], speed[good], np.ones(good.sum())])
    size = np.linalg.norm(rows, axis=0)
    if len(rows) < 4 or not size.all():
        return 1.0, np.inf
    inverse = np.linalg.pinv(rows / size)
    factors = inverse @ measured[good]
    rest = measured[good] - rows @ (factors / size)
    # Residuals are correlated from sample to sample: intervals count as independent, not samples.
    pieces = np.add.reduceat(inverse[0] * rest, np.arange(0, len(rest), max(round(INDEPENDENT_INTERVAL / step), 1)))
    return float(factors[0] / size[0]), float(np.linalg.norm(pieces) / size[0])


def _alternative_starts(task: Task) -> list[dict[str, float]]:
    """Other inertias and stiffnesses, for two bodies, with the sums of inertia and friction from the record."""
    drive = task.drive
    if len(drive.bodies) != 2:
        return []
    motor, load = names_of(drive.bodies, "inertia")
    whole, shaft, found = drive.value(motor) + drive.value(load), drive.shafts[0], []
    slow = {motor: 0.5, load: 0.5, name_of(shaft, "stiffness"): 0.25 * (2.0 * np.pi * START_RESONANCES[0]) ** 2}
    identified = regressed_totals(task.at(slow)) or {}
    sums = {n: identified[n][0] for n in ("inertia", "viscous", "idle_torque")
            if n in identified and identified[n][1] < MAX_RELATIVE_STD * identified[n][0]}
    whole = sums.pop("inertia", whole)
    friction = {f"total.{n}": v for n, v in sums.items() if f"total.{n}" in task.free}
    for share in LOAD_INERTIA_SHARES:
        for rate in 2.0 * np.pi * np.array(START_RESONANCES):
            stiffness = rate**2 * share * (1.0 - share) * whole
            found.append({motor: (1.0 - share) * whole, load: share * whole, name_of(shaft, "stiffness"): stiffness,
                          name_of(shaft, "damping"): 0.06 * stiffness / rate, **friction})
    return found


def shaft_torque_of(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """(torque of the first shaft, gaps closed, speed of the motor), each (n,), at the filtered states."""
    task = model.fitted
    plain = Assembly(task.drive, Layout(task.free, task.roles.inputs, task.roles.outputs, 1.0, gradient=False))
    row = np.zeros(plain.nx)
    for j, dual in plain.closed_shaft(0).items():
        row[j] = dual.v
    states = np.concatenate([f.states[:, :plain.nx] for f in filtered(model.problem, model.point, model.noise)])
    return states @ row, states[:, 0]
