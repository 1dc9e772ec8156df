"""The steady step: recovers the truth with valid intervals, and reports what is not identifiable."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from drivetool.drive import one_body, two_mass
from drivetool.errors import BadOption, BadParameters, NotEnoughData
from drivetool.identify.plateaus.intervals import mean_variances
from drivetool.identify.setup.options import Options
from drivetool.identify.steady.estimator import steady
from drivetool.logs import Experiment

STEP, INERTIA = 2e-3, 2.0
VISCOUS, IDLE, COULOMB = 0.05, 3.0, 1.5
LEVELS = (5.0, 20.0, 35.0, 50.0, 40.0, 25.0, 10.0)
BOTH_DIRECTIONS = (5.0, 25.0, 45.0, 15.0, -15.0, -45.0, -25.0, -5.0)


def records(levels, count=1, seed=1, coulomb=0.0, viscous=VISCOUS, sensor=0.02, torque=0.3, dwell=4.0):
    """(speed, torque), each (n, count): an inertia under a PI controller on a staircase of set points.

    The torque disturbance is white and the sensor noise is white; through the loop both colour the
    torque. The integral part starts and stays settled by the plateau's length.
    """
    rng = np.random.default_rng(seed)
    ramp = round(0.4 / STEP)
    parts = [np.full(round(dwell / STEP), float(levels[0]))]
    for before, after in pairwise(levels):
        parts.append(np.linspace(before, after, ramp, endpoint=False))
        parts.append(np.full(round(dwell / STEP), float(after)))
    reference = np.concatenate(parts)
    n = len(reference)
    disturbance = torque * rng.normal(size=(n, count))
    noise = sensor * rng.normal(size=(n, count))
    gain, integral_gain = 30.0, 100.0
    w = np.full(count, reference[0])
    integral = np.full(count, IDLE + viscous * reference[0] + coulomb * np.sign(reference[0]))
    speed, command = np.empty((n, count)), np.empty((n, count))
    for k in range(n):
        speed[k] = w + noise[k]
        error = reference[k] - speed[k]
        integral = integral + integral_gain * STEP * error
        command[k] = gain * error + integral
        friction = viscous * w + IDLE + coulomb * np.tanh(w / 0.05)
        w = w + STEP / INERTIA * (command[k] + disturbance[k] - friction)
    return speed, command


def experiment(speed, torque, **more):
    speed, torque = np.ascontiguousarray(speed), np.ascontiguousarray(torque)
    return Experiment("log.parquet", "0" * 64, STEP, 0.0,
                      {"motor_torque": torque, "motor_speed": speed, **more}, ((0, len(torque)),))


def one(levels, **more):
    speed, torque = records(levels, **more)
    return experiment(speed[:, 0], torque[:, 0])


def run(log, drive=None, **options):
    found = steady([log], drive or one_body(), Options(**options))
    return found, {p.name: p for p in found.parameters}


def codes(estimate):
    return {f.code for f in estimate.findings}


def test_one_direction_gives_the_sum_and_says_so():
    found, by_name = run(one(LEVELS, coulomb=COULOMB), two_mass())
    c, t0 = by_name["total.viscous"], by_name["total.idle_torque"]
    assert c.value == pytest.approx(VISCOUS, abs=4 * c.std) and c.std < 0.05 * VISCOUS
    assert t0.value == pytest.approx(IDLE + COULOMB, abs=4 * t0.std) and t0.std < 0.05
    assert c.ci95[0] < VISCOUS < c.ci95[1]
    assert by_name["motor.coulomb"].status == "not-identifiable" and by_name["motor.coulomb"].std is None
    assert {"idle-torque-not-separable", "location-not-identifiable"} <= codes(found)
    assert found.covariance.names == ("total.viscous", "total.idle_torque")
    assert np.sqrt(np.diag(found.covariance.matrix)) == pytest.approx([c.std, t0.std])
    assert found.drive.values["total.idle_torque"] == t0.value
    assert found.fit["intervals"] >= 7 and found.fit["levels"] == 7


def test_both_directions_separate_idle_torque_and_coulomb_friction():
    found, by_name = run(one(BOTH_DIRECTIONS, coulomb=COULOMB))
    truth = {"motor.viscous": VISCOUS, "motor.idle_torque": IDLE, "motor.coulomb": COULOMB}
    for name, value in truth.items():
        assert by_name[name].value == pytest.approx(value, abs=4 * by_name[name].std)
        assert by_name[name].std < 0.1 and by_name[name].status == "fitted"
    assert "idle-torque-not-separable" not in codes(found)


def test_backward_only():
    found, by_name = run(one(tuple(-x for x in LEVELS), coulomb=COULOMB))
    t0 = by_name["motor.idle_torque"]
    assert t0.value == pytest.approx(IDLE - COULOMB, abs=4 * t0.std)
    assert "less the Coulomb" in next(f.text for f in found.findings if f.code == "idle-torque-not-separable")


def test_several_records_are_one_line():
    low, high = one((10.0,), dwell=6.0), one((40.0,), dwell=6.0, seed=2)
    found = steady([low, replace(high, name="other.parquet")], one_body(), Options())
    by_name = {p.name: p for p in found.parameters}
    assert by_name["motor.viscous"].value == pytest.approx(VISCOUS, abs=4 * by_name["motor.viscous"].std)
    assert {p["file"] for p in found.details["points"]} == {"log.parquet", "other.parquet"}
    assert [each.file for each in found.data] == ["log.parquet", "other.parquet"]


@pytest.mark.slow
def test_intervals_hold():
    """Binomial test at a family error of 1e-3 over two parameters: 240 records, 95 % intervals."""
    count = 240
    speed, torque = records(LEVELS, count, seed=11)
    hits = np.zeros(2, dtype=int)
    for k in range(count):
        _, by_name = run(experiment(speed[:, k], torque[:, k]))
        for j, (name, truth) in enumerate((("motor.viscous", VISCOUS), ("motor.idle_torque", IDLE))):
            low, high = by_name[name].ci95
            hits[j] += low <= truth <= high
    for hit in hits:
        assert stats.binomtest(int(hit), count, 0.95).pvalue > 1e-3 / 2, hits / count


def test_angle_instead_of_speed():
    speed, torque = records(LEVELS, sensor=0.0)
    angle = np.cumsum(speed[:, 0]) * STEP
    log = experiment(speed[:, 0], torque[:, 0])
    log = replace(log, signals={"motor_torque": torque[:, 0], "motor_angle": np.round(angle / 1e-4) * 1e-4})
    _, by_name = run(log)
    assert by_name["motor.viscous"].value == pytest.approx(VISCOUS, abs=4 * by_name["motor.viscous"].std)


def test_shaft_torque_separates_the_bodies():
    speed, torque = records(BOTH_DIRECTIONS, coulomb=COULOMB)
    rng = np.random.default_rng(4)
    share, w = 0.3, speed[:, 0]  # of viscous and Coulomb friction on the motor; the idle torque on the load
    motor = share * (VISCOUS * w + COULOMB * np.sign(w))
    log = experiment(w, torque[:, 0], shaft_torque=torque[:, 0] - motor + 0.2 * rng.normal(size=len(w)))
    found, by_name = run(log, two_mass())
    truth = {"motor.viscous": share * VISCOUS, "load.viscous": (1 - share) * VISCOUS,
             "motor.coulomb": share * COULOMB, "load.coulomb": (1 - share) * COULOMB,
             "motor.idle_torque": 0.0, "load.idle_torque": IDLE}
    assert set(by_name) == set(truth)
    for name, value in truth.items():
        assert by_name[name].value == pytest.approx(value, abs=4.5 * by_name[name].std), name
    assert len(found.covariance.names) == 6
    assert np.all(np.linalg.eigvalsh(found.covariance.matrix) > 0)
    assert {p["line"] for p in found.details["points"]} == {
        "motor less shaft torque over motor speed", "shaft torque over motor speed"}
    with pytest.raises(BadOption, match="ratio"):
        run(log, two_mass().with_values({"shaft.ratio": 2.0}))


def test_one_level_is_not_a_line():
    found, by_name = run(one((20.0,), dwell=8.0))
    c, t0 = by_name["motor.viscous"], by_name["motor.idle_torque"]
    assert (c.status, t0.status) == ("not-identifiable", "not-identifiable")
    assert c.std is None and t0.std is None and "two or more speeds" in c.reason
    assert t0.value == pytest.approx(IDLE + VISCOUS * 20, abs=0.1)
    assert "single-speed" in codes(found) and found.covariance is None
    _, by_name = run(one((20.0,), dwell=8.0), one_body().with_values({"motor.viscous": VISCOUS}))
    assert by_name["motor.idle_torque"].value == pytest.approx(IDLE, abs=0.1)
    assert by_name["motor.idle_torque"].status == "not-identifiable"


def test_one_level_in_both_directions_still_gives_the_idle_torque():
    found, by_name = run(one((20.0, -20.0, 20.0, -20.0), coulomb=COULOMB))
    t0 = by_name["motor.idle_torque"]
    assert t0.status == "fitted" and t0.value == pytest.approx(IDLE, abs=4 * t0.std)
    assert by_name["motor.viscous"].status == by_name["motor.coulomb"].status == "not-identifiable"
    assert found.covariance.names == ("motor.idle_torque",)


def test_holding():
    log = one((20.0,), dwell=8.0)
    drive = one_body().with_values({"motor.viscous": VISCOUS})
    found, by_name = run(log, drive, hold=("motor.viscous",))
    assert by_name["motor.viscous"].status == "held" and by_name["motor.viscous"].value == VISCOUS
    t0 = by_name["motor.idle_torque"]
    assert t0.status == "fitted" and t0.value == pytest.approx(IDLE, abs=4 * t0.std)
    log = one(LEVELS, coulomb=COULOMB)
    found, by_name = run(log, one_body().with_values({"motor.coulomb": COULOMB}), hold=("motor.coulomb",))
    t0 = by_name["motor.idle_torque"]
    assert t0.value == pytest.approx(IDLE, abs=4 * t0.std) and "idle-torque-not-separable" not in codes(found)
    drive = two_mass().with_values({"motor.viscous": 0.02, "load.coulomb": 1.0})
    found, by_name = run(one(BOTH_DIRECTIONS, coulomb=COULOMB), drive, hold=("motor.viscous", "load.coulomb"))
    assert by_name["load.viscous"].value == pytest.approx(VISCOUS - 0.02, abs=4 * by_name["load.viscous"].std)
    assert by_name["motor.coulomb"].value == pytest.approx(COULOMB - 1, abs=4 * by_name["motor.coulomb"].std)
    with pytest.raises(BadParameters, match=r"motor\.viscous"):
        run(log, hold=("motor.viscos",))


def test_start_values_are_reported_and_a_second_coulomb_is_not_counted_twice():
    drive = two_mass().with_values({"motor.viscous": 0.01, "load.viscous": 0.03, "load.coulomb": 9.0})
    found, by_name = run(one(BOTH_DIRECTIONS, coulomb=COULOMB), drive)
    assert by_name["total.viscous"].start == pytest.approx(0.04)
    assert found.drive.values["load.coulomb"] == 0.0
    assert "motor.viscous" not in found.drive.values


def test_falling_friction_is_clipped_and_reported():
    found, by_name = run(one(LEVELS, viscous=-0.03))
    c = by_name["motor.viscous"]
    assert (c.value, c.status, c.std) == (0.0, "at-bound", None) and "negative" in c.reason
    assert c.ci95 == (0.0, 0.0)
    assert next(f for f in found.findings if f.code == "negative-estimate").severity == "warning"


@pytest.mark.parametrize(("coulomb", "severity"), [(-1.5, "warning"), (COULOMB, None)])
def test_friction_that_drives_the_motion_is_clipped_and_reported(coulomb, severity):
    found, by_name = run(one(BOTH_DIRECTIONS, coulomb=coulomb))
    assert (by_name["motor.coulomb"].value == 0.0) == (coulomb < 0.0)
    assert {f.code: f.severity for f in found.findings}.get("negative-estimate") == severity


def test_a_bend_widens_the_intervals():
    speed, torque = records(LEVELS)
    bent = torque[:, 0] + 2e-3 * (speed[:, 0] - 27)**2
    found, by_name = run(experiment(speed[:, 0], bent))
    plain = run(experiment(speed[:, 0], torque[:, 0]))[1]
    assert "scatter-beyond-noise" in codes(found)
    assert by_name["motor.viscous"].std > 5 * plain["motor.viscous"].std


DRAG = 2e-3
FAN_TRUTH = {"motor.viscous": VISCOUS, "motor.idle_torque": IDLE, "motor.coulomb": COULOMB, "motor.drag": DRAG}
FREE_DRAG = {"free": ("motor.drag",)}


def fan(levels, seed=1, column=0, count=1, drag=DRAG, **more):
    """A record of `one` with the torque of a fan beside."""
    speed, torque = (signal[:, column] for signal in records(levels, count, seed, coulomb=COULOMB, **more))
    return experiment(speed, torque + drag * speed * np.abs(speed))


def test_a_free_drag_is_fitted_with_an_interval():
    found, by_name = run(fan(BOTH_DIRECTIONS), **FREE_DRAG)
    for name, value in FAN_TRUTH.items():
        line = by_name[name]
        assert line.value == pytest.approx(value, abs=4 * line.std) and line.ci95[0] < value < line.ci95[1], name
    assert by_name["motor.drag"].std < 0.05 * DRAG and by_name["motor.drag"].unit == "Nm s^2/rad^2"
    assert found.drive.values["motor.drag"] == by_name["motor.drag"].value
    assert set(found.covariance.names) == set(FAN_TRUTH) and not codes(found)
    speed, torque = found.exhibits[0].curves["fit forward"]
    assert torque[-1] - torque[0] == pytest.approx(VISCOUS * speed[-1] + DRAG * speed[-1] ** 2, rel=0.05)


def test_a_fan_in_one_direction_of_a_drive_of_two_bodies():
    found, by_name = run(fan(LEVELS), two_mass(), **FREE_DRAG)
    assert by_name["motor.drag"].value == pytest.approx(DRAG, abs=4 * by_name["motor.drag"].std)
    assert by_name["total.viscous"].value == pytest.approx(VISCOUS, abs=4 * by_name["total.viscous"].std)
    assert "nonlinear-friction" not in codes(found)


@pytest.mark.slow
def test_intervals_of_a_fan_hold():
    """Binomial test at a family error of 1e-3 over four parameters: 240 records, 95 % intervals."""
    count = 240
    speed, torque = records(BOTH_DIRECTIONS, count, seed=12, coulomb=COULOMB)
    torque = torque + DRAG * speed * np.abs(speed)
    hits = dict.fromkeys(FAN_TRUTH, 0)
    for k in range(count):
        _, by_name = run(experiment(speed[:, k], torque[:, k]), **FREE_DRAG)
        for name, truth in FAN_TRUTH.items():
            hits[name] += by_name[name].ci95[0] <= truth <= by_name[name].ci95[1]
    for name, hit in hits.items():
        assert stats.binomtest(hit, count, 0.95).pvalue > 1e-3 / 4, (name, hit / count)


@pytest.mark.parametrize("levels", [(20.0,), (20.0, 40.0), (20.0, -20.0, 40.0, -40.0)])
def test_too_few_speeds_do_not_determine_a_drag(levels):
    found, by_name = run(fan(levels, dwell=8.0), **FREE_DRAG)
    for name in ("motor.drag", "motor.viscous"):
        line = by_name[name]
        assert (line.status, line.std, line.ci95) == ("not-identifiable", None, None)
        assert "three or more speeds" in line.reason
    said = next(f for f in found.findings if f.code == "single-speed")
    assert "motor.drag" in said.text and "three or more speeds" in said.action
    given = one_body().with_values({"motor.drag": DRAG})
    line = run(fan((20.0, 40.0), dwell=8.0), given)[1]["motor.viscous"]
    assert line.status == "fitted" and line.value == pytest.approx(VISCOUS, abs=4 * line.std)


def test_a_drag_that_is_not_free_is_named():
    found, _ = run(fan(BOTH_DIRECTIONS))
    (said,) = [f for f in found.findings if f.code == "nonlinear-friction"]
    assert said.severity == "warning" and "--free motor.drag" in said.action
    assert said.evidence["drag"] == pytest.approx(DRAG, abs=4 * said.evidence["std"])
    for log in (one(BOTH_DIRECTIONS, coulomb=COULOMB), fan(BOTH_DIRECTIONS, drag=-1e-4)):
        assert "nonlinear-friction" not in codes(run(log)[0])


def test_a_free_drag_without_a_fan_is_zero():
    _, by_name = run(fan(BOTH_DIRECTIONS, drag=0.0), **FREE_DRAG)
    low, high = by_name["motor.drag"].ci95
    assert low <= 0.0 <= high < 0.1 * DRAG


def test_the_drag_of_each_body_with_a_shaft_torque():
    speed, torque = (signal[:, 0] for signal in records(BOTH_DIRECTIONS, coulomb=COULOMB))
    rng = np.random.default_rng(5)
    shaft = 0.02 * speed + DRAG * speed * np.abs(speed) + 0.05 * rng.normal(size=len(speed))
    log = experiment(speed, torque + DRAG * speed * np.abs(speed), shaft_torque=shaft)
    found, by_name = run(log, two_mass(), free=("load.drag",))
    assert by_name["load.drag"].value == pytest.approx(DRAG, abs=4 * by_name["load.drag"].std)
    assert "motor.drag" not in by_name and "nonlinear-friction" not in codes(found)


@pytest.mark.parametrize(("free", "drive", "said"), [
    (("shaft.stiffness",), two_mass(), "shaft.stiffness"), (("motor.inertia",), one_body(), "motor.inertia"),
    (("all",), one_body(), "all"), (("motor.viscous",), two_mass(), "total.viscous"),
    (("motor.drag", "load.drag"), two_mass(), "only the sum"),
    (("load.drag",), two_mass().with_values({"shaft.ratio": 3.0}), "turns as fast as the motor")])
def test_what_the_line_does_not_have_cannot_be_free(free, drive, said):
    with pytest.raises(BadOption, match=said) as caught:
        run(fan(LEVELS), drive, free=free)
    assert free[-1] in str(caught.value)


def test_a_parameter_is_held_or_free():
    with pytest.raises(BadOption, match=r"motor\.drag as both"):
        Options(hold=("motor.drag",), free=("motor.drag",))


def test_standstill_is_left_out():
    found, _ = run(one((20.0, 0.0, 40.0), coulomb=0.0))
    assert "stretches-left-out" in codes(found)
    assert all(abs(p["speed"]) > 1 for p in found.details["points"])


def swinging():
    t = np.arange(8000) * STEP
    return experiment(10 * np.sin(3 * t), np.cos(3 * t))


def scattered():
    rng = np.random.default_rng(3)
    logs = []
    for k in range(6):
        speed, torque = records((10.0 + 5 * k,), seed=k, dwell=6.0)
        logs.append(experiment(speed[:, 0], torque[:, 0] + 40 * rng.normal()))
    return logs


def turned():
    """Friction in both directions, by a torque of the wrong sign."""
    speed = records((20.0, -20.0, 40.0, -40.0, 60.0, -60.0), seed=2, dwell=6.0)[0][:, 0]
    return [experiment(speed, -np.sign(speed) * (0.1 * np.abs(speed) + 2.0))]


def one_jerk():
    """At rest but for a moment of wild motion."""
    rng = np.random.default_rng(1)
    jerk = np.repeat([0.0, 30.0, 0.0], [3800, 400, 3800])
    return experiment(jerk * np.abs(np.sin(np.arange(8000) / 30)) + 1e-3 * rng.normal(size=8000),
                      jerk + rng.normal(size=8000))


REFUSED = {
    "none": (lambda: [swinging()], ["intervals of constant speed", "none in log.parquet", "several speeds"]),
    "standstill": (lambda: [one_jerk()], ["other than zero", "only standstill"]),
    "scatter": (scattered, ["close to a friction line", "scatter", "Keep the load constant"]),
    "turned": (turned, ["close to a friction line", "against the motion in both directions", "sign: -1"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_not_enough(case):
    make, words = REFUSED[case]
    with pytest.raises(NotEnoughData) as caught:
        steady(make(), one_body(), Options())
    for word in words:
        assert word in str(caught.value)


def test_pictures_and_points():
    found, _ = run(one(BOTH_DIRECTIONS, coulomb=COULOMB))
    line, record = found.exhibits
    assert (line.kind, record.kind) == ("steady", "record")
    assert {"points", "std", "fit forward", "fit backward"} == set(line.curves)
    speed, torque = line.curves["fit forward"]
    assert torque[1] - torque[0] == pytest.approx(VISCOUS * (speed[1] - speed[0]), rel=0.05)
    marked = record.curves["steady intervals"][1]
    assert 0.3 < np.isfinite(marked).mean() < 0.9
    for point in found.details["points"]:
        assert {"file", "start", "end", "speed", "speed_std", "torque", "torque_std"} <= set(point)
        assert point["end"] > point["start"] and point["torque_std"] > 0


def wandering(size, memory, rng):
    """(size,) noise of unit variance that is forgotten over `memory` samples."""
    keep = np.exp(-1.0 / memory)
    start = rng.standard_normal()
    steps = np.sqrt(1.0 - keep**2) * rng.standard_normal(size)
    return lfilter([1.0], [1.0, -keep], steps, zi=[keep * start])[0]


@pytest.mark.parametrize("memory", [0.0, 0.04, 0.13])
def test_variance_of_a_mean_of_noise_that_wanders(memory):
    """Over the closed form for a first-order lag; memory as a share of the interval."""
    size, rng = 2000, np.random.default_rng(5)
    ratios = []
    for _ in range(40):
        series = [wandering(size, memory * size, rng) if memory else rng.standard_normal(size) for _ in range(7)]
        ratios.append(mean_variances(series, [1e-3] * 7)[0].mean())
    x = 1.0 / memory if memory else 1.0
    true = 2.0 / x * (1.0 - (1.0 - np.exp(-x)) / x) if memory else 1.0 / size
    assert 0.75 < np.mean(ratios) / true < 1.6
