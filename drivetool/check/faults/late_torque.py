"""Is the torque of a recording logged in the cycle in which it acts, where there is no model yet?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.drive import one_body, two_mass
from drivetool.errors import DriveToolError, NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.channels import AT_MOTOR, TORQUE_ROLE, residual_uncorrelated, torque_timing
from drivetool.identify.fit import fit_task
from drivetool.identify.setup import Options, Outcome, Task, roles_of
from drivetool.logs import Experiment

# Samples of a recording that are tested. A choice: a second or two of time each; two masses cost more per
# sample.
SAMPLES_ONE_BODY, SAMPLES_TWO_MASSES = 20_000, 6_000

# Damping ratio of a resonance, and its largest frequency over half the rate. A pole pair that compensates a
# filter of the torque, of 20 samples, has a damping ratio of 0.41.
MAX_RESONANCE_DAMPING, MAX_RESONANCE_FREQUENCY = 0.2, 0.7


def torque_timing_findings(experiment: Experiment) -> list[Finding]:
    """See torque_timing: of one body, or else of the transfer function of two, fitted to the beginning."""
    if experiment.input_units:  # without the channels of another torque unit
        signals = {role: values for role, values in experiment.signals.items() if role in (TORQUE_ROLE, *AT_MOTOR)}
        experiment = replace(experiment, signals=signals, input_units={}, torque_unit=experiment.unit(TORQUE_ROLE))
    for fitted, samples in ((_one_body, SAMPLES_ONE_BODY), (_two_masses, SAMPLES_TWO_MASSES)):
        try:
            outcome = fitted(experiment.between(0.0, samples * experiment.step))
            found = torque_timing(outcome)
        except (DriveToolError, np.linalg.LinAlgError):
            continue  # the identification itself reports what cannot be fitted
        if found or (outcome.fit is not None and residual_uncorrelated(outcome.fit)):
            return found
    return []


def _one_body(part: Experiment) -> Outcome:
    drive = one_body(part.torque_unit, part.motion_unit)
    roles = roles_of([part], drive)
    start = drive.with_values({"motor.inertia": _rough_inertia(part), "motor.viscous": 0.0, "motor.coulomb": 0.0})
    free = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")
    return fit_task(Task(start, free, roles, (part,), {}), Options(), [{}])


def _two_masses(part: Experiment) -> Outcome:
    from drivetool.identify.blackbox import transfer_function  # rarely needed, and slow to import

    form, outcome = transfer_function([part], two_mass(part.torque_unit, part.motion_unit), Options())
    found = dict(zip(form.names, outcome.solution.point.values, strict=True))
    highest, damping = (np.pi * MAX_RESONANCE_FREQUENCY / part.step,
                        found["a2"] / (2.0 * np.sqrt(max(found["a1"], 1e-12))))
    if not (0.0 < found["a1"] < highest**2 and damping < MAX_RESONANCE_DAMPING):
        raise NotEnoughData("a weakly damped resonance below half the sampling rate", "none", "Fit one body.")
    return outcome


def _rough_inertia(experiment: Experiment) -> float:
    """A rough inertia: standard deviation of the torque over that of the acceleration."""
    torque = experiment.signals[TORQUE_ROLE]
    if "motor_speed" in experiment.signals:
        rate = np.diff(experiment.signals["motor_speed"]) / experiment.step
    else:
        rate = np.diff(experiment.signals["motor_angle"], 2) / experiment.step**2
    spread = float(np.nanstd(rate))
    return float(np.nanstd(torque)) / spread if spread > 0.0 else 1.0
