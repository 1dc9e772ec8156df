"""Is the torque of a recording logged in the cycle in which it acts, where there is no model yet?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.drive import one_body, two_mass
from drivetool.errors import DriveToolError, Finding, NotEnoughData
from drivetool.identify.channels import AT_MOTOR, ROLE, explains, torque_timing
from drivetool.identify.fit import fit_task
from drivetool.identify.setup import Options, Outcome, Task, roles_of
from drivetool.logs import Experiment

LOOKED_AT, WITH_RESONANCE = 20_000, 6_000  # samples of a recording that are only looked at; a second or two each

# A resonance rings: its damping ratio is below the first, and it lies below this share of half the rate. One that
# stands in for a filter of the torque does not: of 20 samples, it has a damping ratio of 0.41.
RINGS, BELOW = 0.2, 0.7


def looked_at(experiment: Experiment) -> list[Finding]:
    """See torque_timing: of one body, or else of the transfer function of two, fitted to the beginning."""
    if experiment.input_units:  # other torques have another unit
        signals = {role: values for role, values in experiment.signals.items() if role in (ROLE, *AT_MOTOR)}
        experiment = replace(experiment, signals=signals, input_units={}, torque_unit=experiment.unit(ROLE))
    for fitted, samples in ((_one_body, LOOKED_AT), (_two_masses, WITH_RESONANCE)):
        try:
            outcome = fitted(experiment.between(0.0, samples * experiment.step))
            found = torque_timing(outcome)
        except (DriveToolError, np.linalg.LinAlgError):
            continue  # what cannot be fitted is said by the step that has to
        if found or (outcome.fit is not None and explains(outcome.fit)):
            return found
    return []


def _one_body(part: Experiment) -> Outcome:
    drive = one_body(part.torque_unit, part.motion_unit)
    roles = roles_of([part], drive)
    start = drive.with_values({"motor.inertia": _size(part), "motor.viscous": 0.0, "motor.coulomb": 0.0})
    free = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")
    return fit_task(Task(start, free, roles, (part,), {}), Options(), [{}])


def _two_masses(part: Experiment) -> Outcome:
    from drivetool.identify.blackbox import transfer_function  # seldom needed, and slow to import

    form, outcome = transfer_function([part], two_mass(part.torque_unit, part.motion_unit), Options())
    found = dict(zip(form.names, outcome.solution.point.values, strict=True))
    highest, damping = np.pi * BELOW / part.step, found["a2"] / (2.0 * np.sqrt(max(found["a1"], 1e-12)))
    if not (0.0 < found["a1"] < highest**2 and damping < RINGS):
        raise NotEnoughData("a resonance that rings below the half rate", "none", "Fit one body.")
    return outcome


def _size(experiment: Experiment) -> float:
    """An inertia of about the right size: what torque comes to over the changes of speed."""
    torque = experiment.signals[ROLE]
    if "motor_speed" in experiment.signals:
        rate = np.diff(experiment.signals["motor_speed"]) / experiment.step
    else:
        rate = np.diff(experiment.signals["motor_angle"], 2) / experiment.step**2
    spread = float(np.nanstd(rate))
    return float(np.nanstd(torque)) / spread if spread > 0.0 else 1.0
