"""The error of free runs that the noise of a model makes, against closed forms."""

from __future__ import annotations

import numpy as np

from drivetool.check.fit.model import fit_from_start
from drivetool.check.heldout.parametric_bootstrap import error_by_noise
from drivetool.check.heldout.samples import split_of
from drivetool.check.heldout.scores import folds_of
from drivetool.drive import one_body
from drivetool.identify.setup import Task, roles_of
from tests.recover import STEP, experiment

SIZE = 12_000
INERTIA, TORQUE, SENSOR = 2.0, 30.0, 0.05  # kg m^2, Nm, rad/s


def test_a_free_run_diverges_as_a_random_walk():
    """One body without friction: less its own mean a walk of n steps varies by (n^2 - 1) / (6 n) of a step."""
    rng = np.random.default_rng(5)
    torque = 20.0 * np.sign(np.sin(2.0 * np.pi * 0.9 * STEP * np.arange(SIZE)))
    steps = STEP / INERTIA * (torque + TORQUE * rng.standard_normal(SIZE))
    speed = np.concatenate(([0.0], np.cumsum(steps)[:-1])) + SENSOR * rng.standard_normal(SIZE)
    record = experiment(torque, speed)
    drive = one_body().with_values({"motor.inertia": INERTIA, "motor.viscous": 0.0, "motor.idle_torque": 0.0})
    task = Task(drive, ("motor.inertia",), roles_of([record], drive), (record,))
    model = fit_from_start(task)
    folds = folds_of(model, split_of((record,), 1, drive, task.roles))
    n = SIZE // 8
    walk = STEP * TORQUE / INERTIA * np.sqrt((n**2 - 1.0) / (6.0 * n))
    made = error_by_noise([f.trained for f in folds], folds)
    # Thirty-two walks say their rms to about a seventh, the noise that was estimated is within some per cent.
    np.testing.assert_allclose(made, np.hypot(walk, SENSOR), rtol=0.25)
    assert walk > 4.0 * SENSOR
