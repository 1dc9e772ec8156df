"""The shaft torque sensor against what the motor's torque and motion say the shaft carries."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from drivetool.check.model import Model, everything, fit
from drivetool.check.preflight import SURE, Fault
from drivetool.drive.assemble import Assembly, Layout
from drivetool.drive.chain import Drive
from drivetool.errors import Finding
from drivetool.identify.engine import Task
from drivetool.identify.noise import Noise, filtered, fit_ratio
from drivetool.identify.setup import Roles, first_point, roles_of
from drivetool.logs.experiment import Experiment

SCALE = 0.02  # relative error of the shaft torque below which it is not blamed
# Where to start from besides the base, which may have been bent to a wrong sensor: shares of the load in
# the inertia, and resonances [Hz].
SHARES, RESONANCES = (0.15, 0.5, 0.85), (8.0, 20.0, 50.0)


def shaft_fault(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], wanted: Sequence[str],
                ) -> tuple[tuple[Experiment, ...], Drive, list[Fault]]:
    """(mended experiments, drive to start from, faults): sign and scale of the shaft torque.

    The drive is fitted to the motor alone, which knows the shaft torque up to the scale of the motor
    torque; which of the two channels is wrong, only a known inertia tells.
    """
    roles = roles_of(experiments, drive)
    alone = Roles(roles.inputs, tuple(r for r in roles.outputs if r != "shaft_torque"))
    asked = {"wrong-sign", "wrong-scale"} & set(wanted)
    if len(alone.outputs) == len(roles.outputs) or not alone.outputs or not asked:
        return tuple(experiments), drive, []
    task = Task(drive, tuple(n for n in drive.quantities if n in free), alone, tuple(experiments))
    models = []
    for values in ({}, *_elsewhere(drive)):
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            models.append(_fitted(task.at(values)))
    if not models:
        return tuple(experiments), drive, []
    model = min(models, key=lambda m: m.value)
    measured = np.concatenate([e.signals["shaft_torque"][a:b] for e in experiments
                               for a, b in e.segments if b - a >= 10])
    said = shaft_torque_of(model)
    good = np.isfinite(measured)
    x, y = said[good] - said[good].mean(), measured[good] - measured[good].mean()
    factor = float(x @ y / (x @ x)) if x @ x > 0.0 else 1.0
    # Both are smooth over many samples: what counts as independent is a tenth of a second.
    error = float(np.linalg.norm(y - factor * x) / np.linalg.norm(x) / np.sqrt(max(len(x), 1))
                  * np.sqrt(0.1 / experiments[0].step))
    if abs(factor - 1.0) < max(SCALE, SURE * error) or abs(factor) < 0.05:
        return tuple(experiments), drive, []
    code = "wrong-sign" if factor < 0.0 and abs(abs(factor) - 1.0) < 0.3 else "wrong-scale"
    if code not in wanted:
        return tuple(experiments), drive, []
    fault = Fault(code, Finding(
        "warning", code,
        f"The logged shaft torque is {factor:.4g} times what the motor's torque and motion say the shaft carries.",
        {"factor": factor, "std": error}, "Correct sign, unit or scale of the shaft torque (or of the motor "
        "torque) in the channel map."))
    mended = tuple(replace(e, signals={**e.signals, "shaft_torque": e.signals["shaft_torque"] / factor})
                   for e in experiments)
    return mended, model.fitted.drive, [fault]


def _elsewhere(drive: Drive) -> list[dict[str, float]]:
    """Other values of inertias and stiffness that leave the whole inertia as it is; for two bodies."""
    if len(drive.bodies) != 2:
        return []
    motor, load = (f"{b}.inertia" for b in drive.bodies)
    whole, shaft, found = drive.value(motor) + drive.value(load), drive.shafts[0], []
    for share in SHARES:
        for rate in 2.0 * np.pi * np.array(RESONANCES):
            stiffness = rate**2 * share * (1.0 - share) * whole
            found.append({motor: (1.0 - share) * whole, load: share * whole, f"{shaft}.stiffness": stiffness,
                          f"{shaft}.damping": 0.06 * stiffness / rate})
    return found


def _fitted(task: Task) -> Model:
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
    return fit("base", task, problem, point, noise, everything(problem))


def shaft_torque_of(model: Model) -> np.ndarray:
    """(n,) torque of the first shaft at the filtered states, gaps closed."""
    task = model.fitted
    plain = Assembly(task.drive, Layout(task.free, task.roles.inputs, task.roles.outputs, 1.0, gradient=False))
    row = np.zeros(plain.nx)
    for j, dual in plain.spring(0, damped=True).items():
        row[j] = dual.v
    passes = filtered(model.problem, model.point, model.noise)
    return np.concatenate([f.states[:, :plain.nx] @ row for f in passes])
