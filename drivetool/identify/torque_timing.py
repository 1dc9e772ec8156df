"""Is the torque logged in the cycle in which it acts? Asked of a fitted model, whatever else it lacks.

Drives log the torque of the cycle that has passed, or the command of the next one. Taken as logged, it puts
inertias off by several per cent, and what it leaves looks like a further mass. The same model is fitted with the
torque a sample earlier and later; the likelihood of thousands of samples tells one from the others. A model that
lacks something else says nothing: a shift would take some of that on itself.

A torque that is measured, not held, acts between its samples, half way to one that is late. So the mean of two
neighbours is fitted as well, and a whole sample has to be likelier than that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive.chain import one_body
from drivetool.errors import DriveToolError, Finding
from drivetool.identify.engine import fit_task
from drivetool.identify.innovations import Fit, fit_innovations
from drivetool.identify.options import Options
from drivetool.identify.setup import roles_of
from drivetool.identify.task import Outcome, Task
from drivetool.logs.experiment import Experiment

ROLE = "motor_torque"
# Log likelihood by which a shift must be better than none, once in 20 000 by chance, and than half of it. Models
# that are right but for the shift gain tens where the torque is noisy, else hundreds and thousands.
SURE, THAN_HALF = 10.0, 5.0
# Correlation between one-step errors up to 20 samples apart that a model may leave with the shift: one that leaves
# more lacks something else. Right ones leave 0.04 in thousands of samples, one body fitted to a resonance 0.6 and
# more.
LEFT, LAGS = 0.1, 20
WHOLE, HALF = {"late": -1, "early": 1}, 0.5
LOOKED_AT = 20_000  # samples of a recording that is only looked at


def torque_timing(outcome: Outcome) -> list[Finding]:
    """A finding if a fitted model is much likelier with the torque one sample earlier or later than it was logged.

    outcome  by innovations; others say nothing
    """
    fit = outcome.fit
    if fit is None or ROLE not in outcome.task.roles.inputs:
        return []
    for way, shift in WHOLE.items():
        other = _fitted(outcome, fit, shift)
        gain = fit.value - other.value
        if gain > SURE and _correlation(other) < LEFT \
                and _fitted(outcome, fit, HALF * shift).value - other.value > THAN_HALF:
            return [_finding(way, gain, outcome.task.experiments)]
    return []


def looked_at(experiment: Experiment) -> list[Finding]:
    """The same of a recording for which there is no model: one body is fitted to its beginning, whatever it is."""
    drive = one_body(experiment.torque_unit, experiment.motion_unit)
    try:
        part = experiment.between(0.0, LOOKED_AT * experiment.step)
        roles = roles_of([part], drive)
        start = drive.with_values({"motor.inertia": _size(part), "motor.viscous": 0.0, "motor.coulomb": 0.0})
        free = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")
        return torque_timing(fit_task(Task(start, free, roles, (part,), {}), Options(), [{}]))
    except (DriveToolError, np.linalg.LinAlgError):
        return []  # what cannot be fitted is said by the step that has to


def _size(experiment: Experiment) -> float:
    """An inertia of about the right size: what torque comes to over the changes of speed."""
    torque = experiment.signals[ROLE]
    if "motor_speed" in experiment.signals:
        rate = np.diff(experiment.signals["motor_speed"]) / experiment.step
    else:
        rate = np.diff(experiment.signals["motor_angle"], 2) / experiment.step**2
    spread = float(np.nanstd(rate))
    return float(np.nanstd(torque)) / spread if spread > 0.0 else 1.0


def _fitted(outcome: Outcome, fit: Fit, shift: float) -> Fit:
    """The fit again with a shift, for two rounds from where it was: all that a sample moves, it moves in them."""
    problem = replace(outcome.task, experiments=_shifted(outcome.task.experiments, shift)).problem()
    return fit_innovations(problem, fit.point, fit.noise, most=2, arrived=True)


def _correlation(fit: Fit) -> float:
    """The largest correlation between one-step errors of the first sensor."""
    z = np.concatenate([f.innovations[:, 0] / np.sqrt(f.variance[:, 0]) for f in fit.passes])
    z = z[np.isfinite(z)] - np.mean(z[np.isfinite(z)])
    return float(max(abs(z[k:] @ z[:-k]) for k in range(1, LAGS + 1)) / (z @ z))


def _shifted(experiments: Sequence[Experiment], shift: float) -> tuple[Experiment, ...]:
    """The recordings with the torque that many samples later; at an end its neighbour stands in."""
    found = []
    for e in experiments:
        torque = e.signals[ROLE].copy()
        for first, last in e.segments:
            part = e.signals[ROLE][first:last]
            moved = np.append(part[1:], part[-1]) if shift < 0 else np.insert(part[:-1], 0, part[0])
            torque[first:last] = moved if abs(shift) == 1 else 0.5 * (part + moved)
        found.append(replace(e, signals={**e.signals, ROLE: torque}))
    return tuple(found)


def _finding(way: str, gain: float, experiments: Sequence[Experiment]) -> Finding:
    step = experiments[0].step
    shift = WHOLE[way] * step
    alike = len({round(e.step, 12) for e in experiments}) == 1
    cure = f"`shift: {shift:.6g}`" if alike else f"a `shift` of {'minus ' if shift < 0 else ''}one sample"
    text = {"late": "is logged one sample late: the motion answers before it is there",
            "early": "is logged one sample early: the motion answers a sample later than it should"}
    more = "" if way == "late" else " A dead time or a lag of the converter, or a filter of the speed, " \
        "looks the same; then free converter.dead_time or converter.bandwidth, or set sensor.bandwidth, instead."
    return Finding("warning", "torque-late" if way == "late" else "torque-early", f"The torque {text[way]}.",
                   {"shift": float(shift), "log_likelihood": float(gain)},
                   f"Write {cure} for {ROLE} in the channel map.{more}")
