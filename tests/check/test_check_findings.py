"""What a diagnosis says of halves that ask for other values, and of a check that could not be made."""

from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.check import diagnose
from drivetool.check.diagnosis import DiagnoseOptions
from drivetool.check.judgement import UNEXPLAINED, changing
from drivetool.check.remainder import Remainder
from tests.recover import drive_like, linear_record
from tests.simulator.machine import machine_by_seed

FREE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")


@pytest.mark.parametrize(("time", "said"), [(0.9 * UNEXPLAINED, False), (1.1 * UNEXPLAINED, True)])
def test_halves_of_the_records_that_ask_for_other_values(time, said):
    found = changing(SimpleNamespace(left=Remainder(0.0, 0.0, 0.0, time)))
    assert [f.code for f in found] == (["parameters-change"] if said else [])


@pytest.mark.parametrize("breaks", [False, True])
def test_a_check_of_the_shaft_torque_that_breaks_down_is_said(breaks, monkeypatch):
    """A diagnosis goes on without it: here to its search, which is looked at and not made."""
    def check(mended, drive, *_):
        if breaks:
            raise np.linalg.LinAlgError
        return mended, drive, []

    class Searched(Exception):
        pass

    def searched(asked, *_):
        raise Searched(asked.notes)

    monkeypatch.setattr(diagnose, "shaft_fault", check)
    monkeypatch.setattr(diagnose, "searched", searched)
    machine = machine_by_seed(5)
    record, drive = linear_record(machine, 5, 2.0), drive_like(machine, list(FREE))
    with pytest.raises(Searched) as stopped:
        diagnose.diagnose([record], drive, FREE, DiagnoseOptions())
    assert [f.code for f in stopped.value.args[0]] == (["shaft-torque-unchecked"] if breaks else [])
