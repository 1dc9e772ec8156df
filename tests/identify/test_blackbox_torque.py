"""The black box with a shaft torque: two seconds of each rig of Table 6.2, no start values."""

import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.identify.blackbox.estimator import blackbox
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from drivetool.identify.steady.estimator import steady
from tests.light_rigs import HEAVY, STEP, TABLE, Sensors, channels, idle_at_motor, steady_record, steps_record
from tests.study.study_shaft_torque import opened, truth_of

SHAPE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")


def lines_of(estimate):
    return {p.name: p for p in estimate.parameters}


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "seed"), [(TABLE, 480_101), (HEAVY, 480_102)])
def test_two_seconds_identify_inertias_stiffness_and_damping(machine, seed):
    true = truth_of(machine)
    lines = lines_of(blackbox([opened(steps_record(machine, seed, duration=2.0), "steps")], two_mass(), Options()))
    for name in SHAPE:
        assert abs(lines[name].value - true[name]) < 3.0 * lines[name].std, name
        assert lines[name].std < (0.15 if name == "shaft.damping" else 0.003) * true[name]
    assert not [n for n in lines if n.startswith("total.")]


def test_the_chain_goes_on_where_a_start_diverges():
    """The known friction over a start's inertia of -2.5e-8 kg m^2 is a pole at which the simulation overflows."""
    true = truth_of(HEAVY)
    steady_fit = steady([opened(steady_record(HEAVY, 109), "steady")], two_mass(), Options())
    steps = [opened(steps_record(HEAVY, 109, duration=2.0), "steps")]
    blackbox_fit = blackbox(steps, steady_fit.drive, Options(known=steady_fit.covariance))
    lines = lines_of(greybox(steps, blackbox_fit.drive, Options(known=steady_fit.covariance)))
    for name in SHAPE:
        assert abs(lines[name].value - true[name]) < 3.0 * lines[name].std, name


def test_the_idle_torque_is_of_the_record_and_known_viscous_friction_stays():
    machine = idle_at_motor(TABLE, 27.9)
    drive = two_mass().with_values({"motor.viscous": 0.107, "load.viscous": 0.0307, "motor.idle_torque": 24.2,
                                    "load.idle_torque": -1.02})
    found = blackbox([opened(steps_record(machine, 480_103, duration=2.0), "steps")], drive, Options())
    lines = lines_of(found)
    total = next(p for p in found.ratios if p.name == "motor.idle_torque + motor.coulomb")  # it turns one way
    assert abs(total.value - 27.9) < 3.0 * total.std
    assert lines["motor.viscous"].status == "held" and lines["motor.viscous"].value == 0.107


@pytest.mark.slow
def test_a_half_gap_of_the_file_is_kept_and_takes_no_part():
    drive = two_mass().with_values({"shaft.half_gap": 0.1})
    found = blackbox([opened(steps_record(TABLE, 480_104, duration=2.0), "steps")], drive, Options())
    without = blackbox([opened(steps_record(TABLE, 480_104, duration=2.0), "steps")], two_mass(), Options())
    assert found.drive.values["shaft.half_gap"] == 0.1 and lines_of(found)["shaft.half_gap"].status == "held"
    assert lines_of(found)["shaft.stiffness"].value == lines_of(without)["shaft.stiffness"].value
    assert "shaft.half_gap" not in lines_of(without)


@pytest.mark.slow
def test_where_nothing_moves_the_shaft_the_answer_is_still_that():
    """A torque that creeps shows no resonance, in the shaft torque either."""
    slow = TABLE.idle_torque[0] + TABLE.viscous[0] * 110.0 + 3.0 * np.sin(0.5 * np.arange(0.0, 2.0, STEP))
    record = channels(TABLE, slow, 110.0, 5, Sensors(converter=1e-3))
    codes = {f.code: f.severity for f in blackbox([opened(record, "slow")], two_mass(), Options()).findings}
    assert codes.get("shaft-not-identifiable") == "failure" or codes.get("no-conversion") == "failure"



@pytest.mark.slow
@pytest.mark.parametrize(("drive", "words", "status"), [
    # The rig turns one way: an idle torque that is fitted is one with the Coulomb friction.
    ({"total.viscous": 0.13}, {}, ("held", "not-identifiable")),
    ({"motor.viscous": 0.5, "load.viscous": 0.5}, {"free": ("total.viscous",)}, ("fitted", "not-identifiable")),
    ({"total.idle_torque": 10.0, "total.viscous": 0.13}, {"hold": ("total.idle_torque",)}, ("held", "held"))])
def test_sums_that_are_known_freed_or_held(drive, words, status):
    record = opened(steps_record(TABLE, 480_105, duration=2.0), "steps")
    found = blackbox([record], two_mass().with_values(drive), Options(**words))
    lines, sums = lines_of(found), {p.name for p in found.ratios}
    assert (lines["motor.viscous"].status, lines["motor.idle_torque"].status) == status
    assert ("motor.idle_torque + motor.coulomb" in sums) == (status[1] != "held")
