"""Every effect can be fitted from nothing: its parameters freed at their neutral values."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.drive.effects import EFFECTS
from drivetool.identify.fit.engine import fit_task
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.recover import drive_like, linear_record, truth
from tests.simulator.machine import machine_by_seed

pytestmark = pytest.mark.usefixtures("code_for_any_size")
MACHINE = machine_by_seed(5)
RECORD = linear_record(MACHINE, 51, 1.0)
OWNER = {"body": "motor", "shaft": "shaft", "path": "converter", "sensor": "sensor", "friction": "friction",
         "motor": "motor"}
SHAPE = ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping"]


@pytest.mark.parametrize("criterion", [pytest.param("innovations", marks=pytest.mark.slow), "simulation"])
@pytest.mark.parametrize("gap", [
    pytest.param(False, id="no gap"), pytest.param(True, id="gap", marks=pytest.mark.slow)])
@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.code)
def test_an_effect_is_fitted_from_nothing(effect, gap, criterion):
    """Some effects have a state of their own, which a drive without them lacks."""
    drive = drive_like(MACHINE, SHAPE, 0.05, 1).with_values({"shaft.half_gap": 1e-3} if gap else {})
    names = {f"{OWNER[effect.of]}.{s}": q.neutral for s, q in effect.quantities.items()
             if q.neutral is not None and np.isfinite(q.neutral) and not q.choice}
    names |= {"sensor.bandwidth": 400.0} if effect.code == "speed-filter" else {}
    values = truth(MACHINE)
    drive = drive.with_values({n: values[n] for n in ("total.viscous", "total.idle_torque")} | names)
    free = tuple(n for n in drive.quantities if n in {*SHAPE, *names} or (gap and n == "shaft.half_gap"))
    task = Task(drive, free, roles_of([RECORD], drive), (RECORD,))
    found = fit_task(task, Options(criterion=criterion, starts=1, segment=0.5), [{}])
    assert np.isfinite(found.solution.point.values).all() and np.isfinite(found.solution.cost)
    assert found.problem.names == free
