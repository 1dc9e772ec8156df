"""Pictures of fitted records: what is drawn is what the result holds."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.files.figures import plots
from drivetool.files.figures.plot_kinds import figure
from drivetool.files.figures.record_figures import worst_interval
from drivetool.identify.estimate import PlotData
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from tests.coasting import RPM, motion, recording
from tests.identify.test_coast_down import COAST_DOWN, PAPER, one_body, steady
from tests.identify.test_greybox import MACHINE, start
from tests.identify.test_missing_laws import AXIS, fitted, kernel, loop_record
from tests.recover import linear_record


def panels(plot):
    """The curves of each panel."""
    return [[line.get_xydata().T for line in axis.lines if len(line.get_xydata()) > 2]
            for axis in figure(plot).axes]


def legends(plot):
    return [axis.get_legend_handles_labels()[1] for axis in figure(plot).axes]


def test_the_error_is_measured_less_simulated_and_its_rms_that_of_the_file():
    record = linear_record(MACHINE, 51, 1.0)
    record = replace(record, signals={**record.signals, "load_speed": 0.9 * record.signals["motor_speed"]})
    estimate = greybox([record], start(), Options(criterion="simulation"))
    plot = estimate.exhibits[0]
    first, error, second, second_error, _, detail, _ = panels(plot)
    for (measured, simulated), (drawn,) in ((first, error), (second, second_error)):
        np.testing.assert_allclose(drawn[1], measured[1] - simulated[1], atol=1e-12)
    np.testing.assert_array_equal(first[0][1], record.signals["motor_speed"])
    np.testing.assert_array_equal(second[0][1], record.signals["load_speed"])
    assert np.sqrt(np.mean(error[0][1] ** 2)) == pytest.approx(estimate.fit["rmse"], rel=1e-9)
    assert legends(plot)[1] == [f"rms {estimate.fit['rmse']:.3g} rad/s"]
    # The line that is taken off is the same for both: their difference remains.
    inside = np.isin(first[0][0], detail[0][0])
    np.testing.assert_allclose(detail[0][1] - detail[1][1], error[0][1][inside], atol=1e-9)


def test_the_worst_interval_holds_the_largest_error_and_lies_in_the_record():
    time = np.delete(np.arange(10_000) * 1e-3, np.arange(4000, 4500))
    for place in (0, 3990, 6000, 9499):
        error = np.where(np.arange(len(time)) == place, 1.0, 1e-3)
        low, high = worst_interval(time, error)
        assert high - low == pytest.approx(1.0) and low - 1e-9 <= time[place] <= high + 1e-9 and low >= 0.0
    assert np.diff(worst_interval(1e-2 * time, error)) == pytest.approx(0.25 * 1e-2 * time[-1])


def test_laws_are_in_the_torque_that_is_drawn_beside_that_of_the_drive_alone():
    made = loop_record(AXIS, 22, 0.01, seconds=10.0, law=kernel.GRAVITY, strength=(0.3, 0.4))
    estimate = fitted(AXIS, made)
    plot = estimate.exhibits[0]
    rms = {name: np.sqrt(np.nanmean(plot.curves[f"residual {name}"][1] ** 2))
           for name in ("with further effects", "by the drive alone")}
    assert rms["by the drive alone"] == pytest.approx(estimate.fit["torque_rmse"], rel=1e-9)
    assert rms["with further effects"] < 0.2 * rms["by the drive alone"]
    for name in rms:
        np.testing.assert_allclose(plot.curves[f"residual {name}"][1], plot.curves["measured"][1] -
                                   plot.curves[f"simulated {name}"][1], atol=1e-12)
    assert legends(plot)[:2] == [["measured", *(f"simulated {name}" for name in rms)],
                                 [f"{name}: rms {value:.3g} Nm" for name, value in rms.items()]]


def test_a_coast_down_is_drawn_with_its_simulation():
    _, speed = motion(PAPER, lambda t: 0.0, 2000 * RPM, 80 * RPM, 5.0)
    record = recording(1, motor_speed=speed + np.random.default_rng(2).normal(0.0, 0.2, len(speed)))
    estimate = steady([record], one_body(), COAST_DOWN)
    curves = next(e for e in estimate.exhibits if e.kind == "record").curves
    inside = np.isfinite(curves["simulated speed"][1])
    errors = record.signals["motor_speed"] - curves["simulated speed"][1]
    assert np.sqrt(np.mean(errors[inside] ** 2)) == pytest.approx(estimate.fit["rmse"], rel=1e-3)
    assert np.std(curves["error [std]"][1][inside]) == pytest.approx(1.0, rel=0.05)


def test_what_lacks_an_error_has_no_detail_and_other_kinds_are_thinned():
    t = np.arange(50_000) * 1e-3
    plot = PlotData("record", "x", "time [s]", "speed [rad/s]", {"measured": (t, np.sin(t)), "torque [Nm]": (t, t)})
    speed, torque = panels(plot)
    assert len(speed) == len(torque) == 1 and len(speed[0][0]) < 2000
    assert plots.png(plot) == plots.png(plot)
