"""A held value that the record contradicts is reported, with its estimate."""

import pytest

from drivetool.drive import two_mass
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from tests.bench.records import CASES
from tests.recover import drive_like, linear_record, truth
from tests.simulator.machine import machine_by_seed

MACHINE = machine_by_seed(5)


def contradicted_evidence(estimate):
    return {f.text.split()[0]: f.evidence for f in estimate.findings if f.code == "held-value-rejected"}


@pytest.mark.slow
@pytest.mark.parametrize("off", [0.8, 1.0, 1.25])
def test_a_stiffness_that_is_held(off):
    values = truth(MACHINE)
    drive = drive_like(MACHINE, ["motor.inertia", "load.inertia", "shaft.damping"], 0.1, 1).with_values(
        {"total.viscous": values["total.viscous"], "total.idle_torque": values["total.idle_torque"],
         "shaft.stiffness": off * values["shaft.stiffness"]})
    found = contradicted_evidence(greybox([linear_record(MACHINE, 51)], drive, Options(hold=("shaft.stiffness",))))
    assert list(found) == (["shaft.stiffness"] if off != 1.0 else [])
    if found:
        assert found["shaft.stiffness"]["record_asks_for"] == pytest.approx(values["shaft.stiffness"], rel=0.01)
        assert found["shaft.stiffness"]["log_likelihood_gain"] > 100.0


@pytest.mark.slow
@pytest.mark.parametrize("off", [
    pytest.param(0.85, marks=pytest.mark.long), 1.0, pytest.param(1.15, marks=pytest.mark.long)])
def test_a_half_gap_from_the_data_sheet(off):
    case = CASES["main"]
    drive = two_mass().with_values({n: case.start(0.15, 7).values[n] for n in case.free}
                                   | {"shaft.half_gap": off * case.truth["shaft.half_gap"]})
    found = contradicted_evidence(greybox([case.record()], drive, Options()))
    assert list(found) == (["shaft.half_gap"] if off != 1.0 else [])
    if found:
        assert found["shaft.half_gap"]["record_asks_for"] == pytest.approx(case.truth["shaft.half_gap"], rel=0.01)
