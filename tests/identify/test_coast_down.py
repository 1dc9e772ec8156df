"""A coast-down identifies ratios, and inertia and friction once anything fixes the scale of torques."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from drivetool.drive import one_body, two_mass
from drivetool.errors import BadOption, DriveToolError, NotEnoughData
from drivetool.identify.coast_down import coast_down_fit as fitting
from drivetool.identify.coast_down.readings import reading_of
from drivetool.identify.coast_down.stretches import stretches_of
from drivetool.identify.estimate.estimate import Covariance
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.start import KnownStart
from drivetool.identify.steady.estimator import steady
from tests.coasting import RPM, STEP, Motor, coast_down, counts, driven_then_off, motion, recording

PAPER = Motor()
RATIOS = {"viscous_over_inertia": PAPER.viscous / PAPER.inertia,
          "coulomb_over_inertia": PAPER.coulomb / PAPER.inertia}
VALUES = {"motor.inertia": PAPER.inertia, "motor.viscous": PAPER.viscous, "motor.coulomb": PAPER.coulomb}
COAST_DOWN = Options(method="coast-down")


def intervals_of(estimate, names):
    """(value, std, inside the interval) of parameters or ratios."""
    lines = {p.name: p for p in (*estimate.parameters, *estimate.ratios)}
    return {n: (lines[n].value, lines[n].std, lines[n].ci95[0] <= truth <= lines[n].ci95[1])
            for n, truth in names.items()}


def codes(estimate):
    return {f.code for f in estimate.findings}


def test_the_coast_down_of_the_paper_identifies_both_ratios_and_nothing_else():
    estimate = steady([coast_down(1)], one_body(), Options())
    for name, (value, std, _) in intervals_of(estimate, RATIOS).items():
        assert value == pytest.approx(RATIOS[name], rel=2e-4)
        assert 1.96 * std < 2e-4 * value
    assert all(p.std is None and p.status == "not-identifiable" for p in estimate.parameters)
    assert estimate.covariance is None
    assert {"ratios-only", "coast-down-assumed"} <= codes(estimate)
    assert "nonlinear-friction" not in codes(estimate)


@pytest.mark.parametrize("n", [pytest.param(200, marks=pytest.mark.slow), 12])
def test_intervals_of_ratios_hold(n):
    """At least 92 %, and more: without noise the places in a count are spread more evenly than chance would."""
    angle, _ = motion(PAPER, lambda t: 0.0, 2250 * RPM, 75 * RPM, 5.0)
    rng, found = np.random.default_rng(48), []
    for seed in range(n):
        first = int(rng.integers(0, 400))  # the phase of the counts, and the speed at which they begin
        e = recording(seed, motor_angle=counts(angle[first:], 100 + seed))
        found.append(intervals_of(steady([e], one_body(), COAST_DOWN), RATIOS))
    for name in RATIOS:
        held = sum(f[name][2] for f in found)
        assert binom.cdf(held, n, 0.92) > 0.005, (name, held, n)
        scatter = np.std([f[name][0] for f in found], ddof=1)
        if n >= 60:
            assert 0.5 < np.median([f[name][1] for f in found]) / scatter < 2.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_stretch_under_torque_gives_the_scale(seed):
    estimate = steady([driven_then_off(seed)], one_body(), COAST_DOWN)
    for name, (value, std, _) in intervals_of(estimate, VALUES).items():
        assert value == pytest.approx(VALUES[name], rel=5e-4)
        assert abs(value - VALUES[name]) < 3.5 * std
    assert estimate.covariance.names == tuple(VALUES)
    assert not {"ratios-only", "coast-down-assumed", "nonlinear-friction"} & codes(estimate)


def test_a_torque_scale_wrong_by_one_per_cent_is_one_per_cent_of_the_inertia():
    found = [intervals_of(steady([driven_then_off(1, scale)], one_body(), COAST_DOWN), VALUES)["motor.inertia"][0]
             for scale in (1.0, 1.01)]
    assert found[1] / found[0] == pytest.approx(1.01, rel=1e-4)


def test_a_known_added_inertia_gives_the_scale():
    added = 5e-5
    plain, loaded = coast_down(1), coast_down(2, replace(PAPER, inertia=PAPER.inertia + added))
    drive = replace(one_body(), records={loaded.name: loaded.sha256}).with_values(
        {f"motor.added_inertia@{loaded.name}": added})
    found = intervals_of(steady([plain, loaded], drive, COAST_DOWN), VALUES)
    for name, truth in VALUES.items():
        value, std, _ = found[name]
        assert value == pytest.approx(truth, rel=5e-4)
        assert abs(value - truth) < 3.5 * std


def test_an_unknown_added_inertia_is_a_ratio():
    """Belt and pulley: on, and taken off."""
    added = 5e-5
    plain, loaded = coast_down(1), coast_down(2, replace(PAPER, inertia=PAPER.inertia + added))
    name = f"motor.added_inertia@{loaded.name}"
    drive = replace(one_body(), records={loaded.name: loaded.sha256}).with_values({name: 1e-5})
    estimate = steady([plain, loaded], drive, replace(COAST_DOWN, free=(name,)))
    (line,) = (p for p in estimate.ratios if p.name.startswith("added_inertia"))
    assert abs(line.value - added / PAPER.inertia) < 3.0 * line.std
    assert line.std < 1e-4 * line.value
    assert all(p.std is None for p in estimate.parameters)  # what is fitted itself is no scale
    assert estimate.covariance is None


@pytest.mark.parametrize("name", VALUES)
def test_what_is_held_gives_the_scale(name):
    drive = one_body().with_values({name: VALUES[name]})
    others = {n: v for n, v in VALUES.items() if n != name}
    found = intervals_of(steady([coast_down(1)], drive, replace(COAST_DOWN, hold=(name,))), others)
    assert len(found) == 2
    for other, (value, std, _) in found.items():
        assert abs(value - VALUES[other]) < 3.5 * std and std < 1e-4 * value


def test_a_friction_by_its_file_gives_the_scale_with_its_uncertainty():
    drive, std = one_body().with_values({"motor.coulomb": PAPER.coulomb}), 0.03 * PAPER.coulomb
    known = Covariance(("motor.coulomb",), np.array([[std**2]]))
    value, found, held = intervals_of(
        steady([coast_down(1)], drive, replace(COAST_DOWN, known=known)), VALUES)["motor.inertia"]
    assert found / value == pytest.approx(0.03, rel=0.01)
    assert held


def test_an_idle_torque_by_its_file_is_no_scale_in_one_direction():
    drive = one_body().with_values({"motor.idle_torque": 0.01})
    known = Covariance(("motor.idle_torque",), np.array([[1e-8]]))
    estimate = steady([coast_down(1)], drive, replace(COAST_DOWN, known=known))
    assert all(p.std is None for p in estimate.parameters) and "ratios-only" in codes(estimate)


def test_a_held_inertia_of_two_bodies_is_the_scale():
    drive = two_mass().with_values({"motor.inertia": 5e-5, "load.inertia": PAPER.inertia - 5e-5})
    estimate = steady([coast_down(1)], drive, replace(COAST_DOWN, hold=("load.inertia",)))
    lines = {p.name: p for p in estimate.parameters}
    assert abs(lines["total.viscous"].value - PAPER.viscous) < 3.5 * lines["total.viscous"].std
    assert abs(lines["motor.coulomb"].value - PAPER.coulomb) < 3.5 * lines["motor.coulomb"].std
    assert lines["load.inertia"].status == "held" and lines["load.inertia"].value == PAPER.inertia - 5e-5


def test_the_figures_of_the_fit_are_those_of_the_noise():
    _, speed = motion(PAPER, lambda t: 0.0, 2000 * RPM, 80 * RPM, 5.0)
    e = recording(1, motor_speed=speed + np.random.default_rng(2).normal(0.0, 0.2, len(speed)))
    figures = steady([e], one_body(), COAST_DOWN).fit
    assert figures["rmse"] == pytest.approx(0.2, rel=0.02)
    assert figures["simulation_fit_percent"] == pytest.approx(100.0 * (1.0 - 0.2 / np.std(speed)), abs=0.02)
    assert figures["chi2"] / figures["chi2_dof"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("change", [{"flux_decay": 0.1, "method": "speeds"}, {"start": KnownStart(rest=True)}])
def test_what_the_step_does_not_take_is_refused(change):
    with pytest.raises(BadOption):
        steady([driven_then_off(1)], one_body(), replace(COAST_DOWN, **change))


def test_a_start_value_of_the_inertia_is_no_scale():
    for start in (1e-5, 1e-3):
        estimate = steady([coast_down(1)], one_body().with_values({"motor.inertia": start}), COAST_DOWN)
        assert all(p.std is None for p in estimate.parameters)
        assert intervals_of(estimate, RATIOS)["viscous_over_inertia"][0] == pytest.approx(1.23327, rel=1e-4)


@pytest.mark.parametrize("pulses", [1000, 4000])
def test_to_standstill_and_backwards(pulses):
    """Friction that stops the drive within a sample of 0.15 rad/s, and a second of standstill."""
    angle, _ = motion(replace(PAPER, breakaway_speed=1e-3), lambda t: 0.0, 2000 * RPM, 1e-4, 5.0)
    angle = np.concatenate([angle, np.full(8000, angle[-1])])
    for sign in (1.0, -1.0):
        e = recording(1, motor_angle=counts(sign * angle, 5, pulses), motor_torque=np.zeros(len(angle)))
        found = intervals_of(steady([e], one_body(), Options()), RATIOS)
        for name, truth in RATIOS.items():
            value, std, _ = found[name]
            assert std < 1e-4 * value and abs(value - truth) < 3.5 * std, (sign, name)


def test_both_directions_identify_the_idle_torque():
    idle = 0.002
    angles = [motion(replace(PAPER, coulomb=PAPER.coulomb + s * idle), lambda t: 0.0, 2000 * RPM, 80 * RPM, 5.0)[0]
              for s in (1.0, -1.0)]
    both = [recording(k, f"{k}.parquet", motor_angle=counts(s * a, k)) for k, (s, a) in
            enumerate(zip((1.0, -1.0), angles, strict=True), 1)]
    ratios = RATIOS | {"idle_torque_over_inertia": idle / PAPER.inertia}
    found = intervals_of(steady(both, one_body(), COAST_DOWN), ratios)
    for name, truth in ratios.items():
        value, std, _ = found[name]
        assert abs(value - truth) < 3.5 * std, name


def test_of_two_bodies_the_whole_runs_down():
    drive = two_mass().with_values({"motor.inertia": 5e-5})
    estimate = steady([driven_then_off(1)], drive, COAST_DOWN)
    values = {p.name: p.value for p in estimate.parameters}
    assert values["load.inertia"] == pytest.approx(PAPER.inertia - 5e-5, rel=1e-3)
    assert estimate.drive.values["total.viscous"] == pytest.approx(PAPER.viscous, rel=1e-3)
    ratios = steady([coast_down(1)], two_mass(), COAST_DOWN)
    assert intervals_of(ratios, RATIOS)["coulomb_over_inertia"][0] == pytest.approx(148.55, rel=1e-4)
    assert "load.inertia" not in ratios.drive.values


@pytest.mark.parametrize("make", [
    lambda speed, rng: speed[::20] + rng.normal(0.0, 0.2, len(speed[::20])),
    lambda speed, rng: speed[::20]])
def test_a_speed_is_read_too(make):
    _, speed = motion(PAPER, lambda t: 0.0, 2000 * RPM, 80 * RPM, 5.0)
    e = recording(1, step=20 * STEP, motor_speed=make(speed, np.random.default_rng(2)))
    found = intervals_of(steady([e], one_body(), COAST_DOWN), RATIOS)
    for name, truth in RATIOS.items():
        value, std, _ = found[name]
        assert abs(value - truth) < max(3.5 * std, 1e-6 * value), name


def test_an_encoder_that_errs_beyond_its_counts_is_said_and_widens_the_intervals():
    angle, _ = motion(PAPER, lambda t: 0.0, 2000 * RPM, 80 * RPM, 5.0)
    width = 2.0 * np.pi / 1000
    found = []
    for seed in range(12):
        # Edges off by a tenth of a count, each by its own.
        edges = np.arange(int(angle[-1] / width) + 2) * width
        edges = edges + np.random.default_rng(seed).normal(0.0, 0.1 * width, len(edges))
        e = recording(seed, motor_angle=(np.searchsorted(edges, angle, "right") - 1.0) * width)
        estimate = steady([e], one_body(), COAST_DOWN)
        (sensor,) = estimate.details["sensor"]
        assert sensor["error_beyond_counts"] == pytest.approx(0.1 * width, rel=0.1)
        found.append(intervals_of(estimate, RATIOS))
    assert sum(f["coulomb_over_inertia"][2] for f in found) >= 9


@pytest.mark.slow
def test_a_friction_of_another_law_is_said():
    estimate = steady([coast_down(1, replace(PAPER, drag=1e-8))], one_body(), COAST_DOWN)
    assert "nonlinear-friction" in codes(estimate)
    mended = steady([coast_down(1, replace(PAPER, drag=1e-8))], one_body(),
                    replace(COAST_DOWN, free=("motor.drag",)))
    assert "nonlinear-friction" not in codes(mended)
    (line,) = (p for p in mended.ratios if p.name == "drag_over_inertia")
    assert abs(line.value - 1e-8 / PAPER.inertia) < 3.5 * line.std


@pytest.mark.slow
def test_coast_downs_of_a_drive_that_warms_up_differ_and_the_interval_is_of_their_mean():
    runs = [coast_down(k, replace(PAPER, viscous=PAPER.viscous * (1.0 - 0.01 * k))) for k in range(4)]
    estimate = steady(runs, one_body(), COAST_DOWN)
    (finding,) = (f for f in estimate.findings if f.code == "scatter-beyond-noise")
    assert finding.evidence["viscous"] == pytest.approx(-3.0, abs=0.1)
    # All friction at the median speed, of which viscous friction is a part.
    median = float(np.median(motion(PAPER, lambda t: 0.0, 2240 * RPM, 80 * RPM, 5.0)[1]))
    part = PAPER.viscous * median / (PAPER.viscous * median + PAPER.coulomb)
    assert finding.evidence["together"] == pytest.approx(-3.0 * part, rel=0.2)
    value, std, held = intervals_of(estimate, {"viscous_over_inertia": RATIOS["viscous_over_inertia"] * 0.985})[
        "viscous_over_inertia"]
    assert held and std / value == pytest.approx(0.0065, rel=0.1)
    alike = steady([coast_down(k) for k in range(4)], one_body(), COAST_DOWN)
    assert "scatter-beyond-noise" not in codes(alike)


@pytest.mark.slow
def test_no_interval_of_a_coast_down_is_steady_before_standstill():
    """Driven at a constant speed, then off: by counts, by four times as many, by speed, by a noisy speed."""
    rng, k = np.random.default_rng(4), 8000
    for seed in range(20):
        motor = replace(PAPER, viscous=PAPER.viscous * rng.uniform(0.0, 5.0),
                        coulomb=PAPER.coulomb * rng.uniform(0.2, 3.0))
        fast = rng.uniform(500, 3000) * RPM
        angle, speed = motion(motor, lambda t: 0.0, fast, 30 * RPM, 20.0)
        angle = np.concatenate([fast * STEP * np.arange(k), fast * STEP * k + angle])
        speed = np.concatenate([np.full(k, fast), speed])
        torque = np.where(np.arange(len(speed)) < k, motor.friction(fast), 0.0)
        for signals in ({"motor_angle": counts(angle, seed)}, {"motor_angle": counts(angle, seed, 4000)},
                        {"motor_speed": speed}, {"motor_speed": speed + rng.normal(0.0, 0.5, len(speed))}):
            try:
                found = steady([recording(seed, motor_torque=torque, **signals)], one_body(), Options())
            except NotEnoughData:  # nor a constant speed before it, where that is exact
                continue
            ends = [p["end"] for p in found.details.get("points", [])]
            assert max(ends, default=0.0) < (k + 50) * STEP, (seed, list(signals))


def test_the_time_after_switching_off_is_left_out():
    e = driven_then_off(1)
    (_, plain), (_, later) = (stretches_of([e], decay) for decay in (0.0, 0.1))
    assert later.first - plain.first == round(0.1 / STEP) and later.last == plain.last


def test_a_noisy_torque_is_off_where_it_is_no_more_than_noise():
    e = driven_then_off(1)
    torque = e.signals["motor_torque"] + np.random.default_rng(3).normal(0.0, 0.002, e.size)
    noisy = replace(e, signals={**e.signals, "motor_torque": torque})
    assert [(s.first, s.last, s.off) for s in stretches_of([noisy], 0.0)] == [
        (s.first, s.last, s.off) for s in stretches_of([e], 0.0)]
    for name, (value, _, _) in intervals_of(steady([noisy], one_body(), COAST_DOWN), VALUES).items():
        assert value == pytest.approx(VALUES[name], rel=5e-3)


@pytest.mark.parametrize(("signals", "says"), [
    ({"motor_angle": np.floor(np.arange(8000) * 0.8) * 1e-2, "motor_torque": np.full(8000, 0.1)}, "without torque"),
    ({"motor_angle": np.floor(np.arange(8000) * 0.8) * 1e-2}, "coasts down"),
    ({"motor_angle": np.zeros(8000)}, "coasts down"),
    ({"motor_angle": np.floor(np.sqrt(np.arange(8000.0)) / 8.0) * 1e-2, "motor_torque": np.zeros(8000)},
     "20 counts")])
def test_what_is_no_coast_down_is_refused_with_what_to_record(signals, says):
    with pytest.raises(DriveToolError, match=says) as caught:
        steady([recording(1, **signals)], one_body(), COAST_DOWN)
    assert "ecord" in str(caught.value)


BREAKAWAY = replace(COAST_DOWN, free=("motor.breakaway", "motor.breakaway_speed"))


def to_standstill(speed, seed):
    """A coast-down by counts of a motor whose breakaway torque is 1.5 times its Coulomb friction."""
    motor = replace(PAPER, surplus=0.5 * PAPER.coulomb, breakaway_speed=speed)
    angle, _ = motion(motor, lambda t: 0.0, 2240 * RPM, 1e-3, 5.0)
    return recording(seed, motor_angle=counts(angle, seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("speed", [5.0, 20.0])
def test_breakaway_in_a_coast_down_to_standstill(speed, seed):
    estimate = steady([to_standstill(speed, seed)], one_body(), BREAKAWAY)
    surplus = 0.5 * PAPER.coulomb / PAPER.inertia
    truths = RATIOS | {"breakaway_over_inertia": surplus, "motor.breakaway_speed": speed}
    for name, (value, std, _) in (found := intervals_of(estimate, truths)).items():
        assert abs(value - truths[name]) < 3.5 * std, name
    assert found["breakaway_over_inertia"][0] == pytest.approx(surplus, rel=0.02)
    assert found["motor.breakaway_speed"][0] == pytest.approx(speed, rel=0.01)
    assert "nonlinear-friction" not in codes(estimate)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.02, 0.5])
def test_a_breakaway_that_a_coast_down_hardly_excites_is_not_identified(speed):
    e = coast_down(1, replace(PAPER, surplus=0.5 * PAPER.coulomb)) if speed == 0.02 else to_standstill(speed, 1)
    estimate = steady([e], one_body(), BREAKAWAY)
    assert not any(p.name.startswith("breakaway") for p in estimate.ratios)
    (line,) = (p for p in estimate.parameters if p.name == "motor.breakaway_speed")
    assert line.std is None and line.status == "not-identifiable"
    for name, (value, std, _) in intervals_of(estimate, RATIOS).items():
        assert abs(value - RATIOS[name]) < 3.5 * std


@pytest.mark.slow
def test_a_coast_down_with_breakaway_fitted_without_it_is_reported():
    estimate = steady([to_standstill(5.0, 1)], one_body(), COAST_DOWN)
    assert "nonlinear-friction" in codes(estimate)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_half_and_double_of_the_quantisation_std_are_wrong(monkeypatch, factor):
    monkeypatch.setattr("drivetool.identify.coast_down.readings.UNIFORM_STD", factor / np.sqrt(12.0))
    e = coast_down(1)
    start = one_body().with_values({"motor.inertia": 1.0, "motor.viscous": 1.2, "motor.coulomb": 148.0})
    run = fitting.Run(reading_of(e, 0, e.size), np.zeros((e.size, 1)), 0, "a", 0.0, {})
    found = fitting.fit(start, ("motor.viscous", "motor.coulomb"), [run], fitting.NO_PRIOR)
    assert not 0.9 < found.chi_square / found.dof < 1.1 or found.readings[0].error > 1e-4
