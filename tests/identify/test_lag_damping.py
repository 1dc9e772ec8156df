"""A lag of the torque that is not damped as the drive's default says: its damping is fitted where that pays."""

from dataclasses import replace

import pytest

from tests.hidden import greybox_options, make_case, write_start
from tests.hidden.command import greybox_and_diagnose
from tests.hidden.custom_record import write_record
from tests.hidden.profiles import profile

DEFAULT = 0.69


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "damping"), [
    pytest.param(71001, 1.0, marks=pytest.mark.long), (71002, DEFAULT)])
def test_the_damping_of_a_lag_is_estimated_only_where_it_differs(tmp_path, seed, damping):
    """Else a third mass or a filter would make up for it; of first order it is no lag of second order either."""
    case = make_case("none", seed, sensors=("motor_speed", "load_speed"), noise="quiet")
    machine = replace(case.rig.machine, converter_bandwidth=900.0, converter_damping=damping)
    record = write_record(tmp_path, case, profile("reversing", case.rig, seed), machine=machine)
    found = greybox_and_diagnose(tmp_path, [record], write_start(case, tmp_path), greybox_options(case),
                ["--candidates", "converter-lag,third-mass,dead-time,torque-ripple"])
    assert (found.verdict, found.causes) == ("named", ("converter-lag",)), found
    bandwidth = found.parameters["converter.bandwidth"]
    assert abs(bandwidth["value"] - 900.0) < 3.5 * bandwidth["std"]
    line = found.parameters.get("converter.damping", {"value": DEFAULT, "std": None})
    if damping == DEFAULT:
        assert line["std"] is None
    else:
        assert abs(line["value"] - damping) < 3.5 * line["std"] < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("seed", [pytest.param(181014, marks=pytest.mark.long), 71003])
def test_a_filter_of_first_order_is_not_called_an_overdamped_one_of_second(tmp_path, seed):
    """Which is slightly likelier on any record, and has two values that no record identifies."""
    case = make_case("speed-filter", seed, seed=seed, bodies=2, duration=8.0)
    logs, _ = case.write(tmp_path, tmp_path / "labels", visibility=False)
    found = greybox_and_diagnose(tmp_path, logs, write_start(case, tmp_path), greybox_options(case),
                ["--candidates", "speed-filter"])
    assert found.parameters["sensor.order"]["value"] == 1.0
    assert "sensor.damping" not in found.parameters or found.parameters["sensor.damping"]["std"] is None
    low, high = found.parameters["sensor.bandwidth"]["ci95"]
    (hidden,) = case.label(False)["effects"]
    truth = 1.0 / hidden["truth"]["sensor.filter_time"]
    assert low < truth < high < 1.2 * low
