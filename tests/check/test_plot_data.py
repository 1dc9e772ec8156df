"""The figures of a diagnosis: what they show is what was put in."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.outcome.diagnosis import CandidateResult, Round
from drivetool.check.validation.model_run import run_model
from drivetool.check.verdict.plot_data import diagnosis_plots
from drivetool.check.verdict.reversals import reversals_of
from drivetool.check.verdict.view import view_of
from drivetool.drive import two_mass
from drivetool.files.figures import plots, svg
from drivetool.files.figures.report_figures import PANELS
from drivetool.logs import Experiment
from tests.diagnosed import FITTED, STEP, views

INERTIA = 5.766


def by_kind(found):
    """kind -> the first exhibit of it."""
    return {e.kind: e for e in reversed(found)}


@pytest.mark.slow
def test_all_kinds_are_made_and_drawn_with_the_same_bytes():
    made = [replace(v, angle=v.angle + 5.0 * v.time) for v in views()]
    found = diagnosis_plots(made, INERTIA, [Round(1, "backlash", candidates=FITTED)], 0.02)
    assert [e.kind for e in found] == [
        "diagnosis-record", "diagnosis-record", "diagnosis-residual-time", "diagnosis-residual-time",
        "diagnosis-residual-speed", "diagnosis-residual-torque", "diagnosis-residual-order",
        "diagnosis-residual-reversal", "diagnosis-residual-reversal", "diagnosis-candidates"]
    assert {e.kind for e in found} | {"diagnosis-order-map"} == set(PANELS)  # of the base: test_order_map.py
    for exhibit in by_kind(found).values():
        first = svg(exhibit)
        assert first == svg(exhibit) and first.startswith("<svg") and first.endswith("</svg>")
    assert plots.png(found[-1]) == plots.png(found[-1])


def test_dry_friction_is_a_step_over_speed_and_a_ramp_after_reversals():
    found = by_kind(diagnosis_plots(views(), INERTIA))
    curves = found["diagnosis-residual-speed"].curves
    speed, torque = curves["before"]
    away = np.abs(speed) > 2.0
    assert away.sum() > 10
    std = curves["std before"][1][away]
    assert std.max() < 0.7  # the spread within a bin is that of the friction itself
    np.testing.assert_allclose(torque[away], -2.0 * np.sign(speed[away]), atol=0.3)
    assert np.mean(np.abs(torque[away]) - 2.0) == pytest.approx(0.0, abs=0.03)
    assert np.abs(curves["after"][1] / curves["std after"][1]).max() < 4.0
    time, error = found["diagnosis-residual-reversal"].curves["mean before"]
    late = time > 0.05
    slope = np.polyfit(time[late], error[late], 1)[0]
    assert slope == pytest.approx(-2.0 / INERTIA, rel=0.1)
    assert np.abs(found["diagnosis-residual-reversal"].curves["mean after"][1]).max() < 0.06


def test_a_run_that_has_diverged_leaves_the_others_pictures():
    made = [replace(v, angle=v.angle + 5.0 * v.time) for v in views()]
    gone = replace(made[0], speed=np.full(len(made[0].time), np.nan))
    found = by_kind(diagnosis_plots([gone, made[1]], INERTIA))
    assert "diagnosis-residual-order" not in found and "diagnosis-residual-reversal" in found
    assert "diagnosis-residual-order" not in by_kind(diagnosis_plots([gone], INERTIA))


def test_standard_errors_of_bins_are_as_large_as_their_scatter():
    curves = by_kind(diagnosis_plots(views(), INERTIA))["diagnosis-residual-speed"].curves
    ratio = curves["after"][1] / curves["std after"][1]
    assert 0.2 < np.std(ratio) < 1.6


def test_what_repeats_with_the_angle_is_a_peak_of_its_amplitude():
    made = []
    for view in views():
        angle = view.angle + 20.0 * view.time
        view = replace(view, speed=view.speed + 20.0, angle=angle)
        missing = 1.5 * np.cos(4.3 * view.angle)
        lacking = np.concatenate([np.cumsum(missing[p]) * STEP / INERTIA for p in view.pieces()])
        made.append(replace(view, before=view.after - lacking))
    order, amplitude = by_kind(diagnosis_plots(made, INERTIA))["diagnosis-residual-order"].curves["before"]
    peak = int(np.argmax(amplitude))
    assert order[peak] == pytest.approx(4.3, abs=0.1) and amplitude[peak] == pytest.approx(1.5, rel=0.15)
    after = by_kind(diagnosis_plots(made, INERTIA))["diagnosis-residual-order"].curves["after"][1]
    assert after[np.abs(order - 4.3) < 0.5].max() < amplitude[peak] / 3.0  # only sensor noise


def test_size_over_time_is_the_noise_where_the_model_is_right():
    curves = by_kind(diagnosis_plots(views(), INERTIA, (), 0.02))["diagnosis-residual-time"].curves
    size = curves["size after"][1]
    assert np.median(size) == pytest.approx(0.02, rel=0.05) and size.max() < 0.03
    assert curves["size before"][1].max() > 0.1
    assert set(np.round(curves["reversals of the speed"][0] % 1.0, 2)) <= {0.0, 1.0}  # 0.5 Hz


def test_the_close_up_lies_where_the_base_errs_and_in_one_run():
    view = views()[0]
    before = view.after.copy()
    before[3100:3300] += 1.0
    before[1990:2010] += 3.0  # across a break: it cannot be seen in one run
    low, high = diagnosis_plots([replace(view, before=before)], INERTIA)[0].curves["close-up"][0]
    assert low == pytest.approx(3.1, abs=0.101) and high == pytest.approx(low + 0.299)
    assert low <= 3.1 and high >= 3.299


def test_reversals_need_both_sides():
    view = views(second=False)[0]
    flicker = np.sign(np.sin(40.0 * view.time)) * 1e-3
    speed = np.where(view.time < 3.5, 1.0 + flicker, -1.0 + flicker)
    found = reversals_of([replace(view, speed=speed, shaft=None)])[0]
    assert [r.what for r in found] == ["speed"]
    assert list(found[0].index) == [3500] and list(found[0].direction) == [-1.0]


@pytest.mark.slow
@pytest.mark.parametrize("change", ["gaps", "one body", "no angle", "standstill", "short", "constant torque"])
def test_what_a_record_lacks_is_left_out(change):
    made = views(300 if change == "short" else 6000)
    made = [replace(v, angle=v.angle + 5.0 * v.time) for v in made]
    if change == "gaps":
        hole = np.zeros(len(made[0].time), bool)
        hole[1000:1200] = True
        made = [replace(v, measured=np.where(hole, np.nan, v.measured)) for v in made]
    if change == "one body":
        made = [replace(v, shaft=None) for v in made]
    if change == "no angle":
        made = [replace(v, angle=None) for v in made]
    if change == "standstill":
        made = [replace(v, speed=0.0 * v.speed, angle=0.0 * v.angle) for v in made]
    if change == "constant torque":
        made = [replace(v, shaft=None, torque=0.0 * v.torque) for v in made]
    found = diagnosis_plots(made, INERTIA, [
        Round(1, candidates=(CandidateResult("backlash", "failed", reason="x"),))])
    names = {e.kind for e in found}
    assert {"diagnosis-record", "diagnosis-residual-time"} <= names and "diagnosis-candidates" not in names
    assert ("diagnosis-residual-order" in names) == (change in ("gaps", "one body", "constant torque"))
    assert ("diagnosis-residual-torque" in names) == (change != "constant torque")
    for exhibit in found:
        if change in ("gaps", "short") and exhibit.title.startswith(("record1", "Torque")):
            assert svg(exhibit).startswith("<svg")
        for x, y in exhibit.curves.values():
            assert x.shape == y.shape


def test_a_view_comes_from_two_runs():
    t = np.arange(400) * STEP
    torque = 3.0 * np.sign(np.sin(30.0 * t))
    e = Experiment("r", "r", STEP, 0.0, {"motor_torque": torque, "motor_speed": np.cos(t)}, ((0, 150), (180, 400)))
    drive = two_mass().with_values({"motor.inertia": 0.5, "load.inertia": 1.0, "shaft.stiffness": 900.0})
    before, after = (run_model(e, drive.with_values({"motor.viscous": c})) for c in (0.0, 1.0))
    view = view_of("r.parquet", before, after)
    assert view.breaks == (0, 150) and view.time[150] == pytest.approx(0.18)
    assert view.units == ("rad/s", "Nm", "rad") and view.output == "motor_speed"
    expected = np.cos(view.time) - after.simulated["motor_speed"]
    np.testing.assert_allclose(view.errors["after"], expected, atol=1e-12)
    assert not np.array_equal(view.before, view.after) and view.shaft is not None


def test_candidates_are_sorted_and_those_without_a_gain_are_left_to_the_table():
    found = diagnosis_plots(views(second=False), INERTIA, [Round(1, "backlash", candidates=FITTED[::-1])])[-1]
    assert list(found.curves) == ["backlash: named", "hardening-stiffness: worse", "dead-time: no-gain"]
    assert found.curves["backlash: named"][0][0] == 1234.0 and found.curves["backlash: named"][1][0] == 41.0


def test_an_angle_shows_the_missing_torque_too():
    made = []
    for view in views():
        clean = np.cumsum(view.speed) * STEP
        lacking = np.concatenate([np.cumsum(np.cumsum(-2.0 / INERTIA * np.sign(view.speed[p]))) * STEP**2
                                  for p in view.pieces()])
        noisy = clean + np.random.default_rng(1).normal(0.0, 1e-5, len(clean))
        made.append(replace(view, measured=noisy, before=clean - lacking, after=clean, output="motor_angle",
                            units=("rad", "Nm", "rad")))
    curves = by_kind(diagnosis_plots(made, INERTIA))["diagnosis-residual-speed"].curves
    speed, torque = curves["before"]
    away = np.abs(speed) > 2.0
    np.testing.assert_allclose(torque[away], -2.0 * np.sign(speed[away]), atol=0.2)
    assert np.abs(curves["after"][1]).max() < 0.2
    carriage = diagnosis_plots([replace(v, units=("m", "N", "m")) for v in made], INERTIA)
    labels = " ".join(word for e in carriage for word in (e.title, e.x, e.y, *e.curves))
    assert "motor position [m]" in labels and "missing force [N]" in labels and "1/m" in labels
    assert not {"torque", "angle"} & set(labels.replace("_", " ").split())
