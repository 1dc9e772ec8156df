"""Across a gap friction of the motor and of the load are no longer the same: a sum shared out by rule is wrong."""

from dataclasses import replace

import pytest

from drivetool.check.full_diagnosis import diagnose
from drivetool.check.outcome.diagnosis import DiagnoseOptions
from drivetool.drive import two_mass
from tests.recover import reversing_record
from tests.simulator.machine import Machine

# Nearly all the friction at the load, as no rule shares it.
MILL = Machine(inertia=(3.0, 5.0), viscous=(0.3, 3.2), stiffness=(10.7e3,), damping=(10.0,), half_gap=(2e-3,),
               rated_torque=200.0)
FREE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "total.viscous", "total.idle_torque")


@pytest.mark.slow
def test_a_gap_found_parts_the_friction_of_motor_and_load():
    record, _ = reversing_record(MILL, 3, duration=8.0)
    base = two_mass().with_values(dict(zip(FREE, (3.0, 5.0, 10.7e3, 10.0, 3.5, 0.0), strict=True)))
    found = diagnose([replace(record, name="mill")], base, FREE, DiagnoseOptions(candidates=("backlash",)))
    assert found.causes == ("backlash",)
    values = {p.name: p for p in found.estimate.parameters}
    for name, true in (("motor.viscous", 0.3), ("load.viscous", 3.2), ("shaft.half_gap", 2e-3)):
        assert values[name].std < 0.2 * 3.5
        assert abs(values[name].value - true) < 3.0 * values[name].std, values[name]
