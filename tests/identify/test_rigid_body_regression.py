"""The total inertia by rigid-body regression, where a body carries a mass."""

import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.identify.channels.channel_plausibility import suspect_channel_findings
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from drivetool.identify.starts.rigid_body_regression import scaled_to_totals
from tests.recover import STEP, experiment

# In kg m^2: motor 2, load 1, and 12 kg that the load carries at 0.5 m.
DRIVE = two_mass().with_values({"motor.inertia": 2.0, "load.inertia": 1.0, "load.carried_mass": 12.0,
                                "load.radius": 0.5, "shaft.stiffness": 2e4, "shaft.damping": 5.0})


def task_of(drive):
    """The task of finding the motor's inertia in a slow motion of one direction: 6 kg m^2 dw/dt + 0.4 w + 3."""
    t = STEP * np.arange(8000)
    speed = 20.0 + 10.0 * np.sin(3.0 * t) + 5.0 * np.sin(1.3 * t)
    data = experiment(6.0 * (30.0 * np.cos(3.0 * t) + 6.5 * np.cos(1.3 * t)) + 0.4 * speed + 3.0, speed)
    return Task(drive, ("motor.inertia",), roles_of([data], drive), (data,))


def test_the_start_of_an_inertia_leaves_the_carried_mass_its_share():
    found = scaled_to_totals(task_of(DRIVE.with_values({"motor.inertia": 0.7}))).drive
    assert found.values["motor.inertia"] == pytest.approx(2.0, rel=0.01)


def test_a_carried_mass_is_no_wrong_unit():
    """The load carries 18 kg at 0.5 m. Without the mass the drive starts with a fourth of the inertia."""
    heavy = DRIVE.with_values({"motor.inertia": 0.5, "load.carried_mass": 18.0})
    assert suspect_channel_findings(task_of(heavy), heavy) == []
    unloaded = heavy.with_values({"load.carried_mass": 0.0})
    assert [f.code for f in suspect_channel_findings(task_of(unloaded), unloaded)] == ["suspect-unit"]


def test_a_fit_with_laws_overrides_the_regression_of_totals():
    unloaded = DRIVE.with_values({"motor.inertia": 0.5, "load.carried_mass": 0.0})
    task = task_of(unloaded)  # whose motion requires four times the inertia
    assert suspect_channel_findings(task, unloaded, explained=True) == []
    far = unloaded.with_values({"motor.inertia": 20.0})
    (found,) = suspect_channel_findings(task, far, explained=True)
    assert found.evidence["factor"] == pytest.approx(21.0 / 1.5)
