"""The loop of tune has each effect of a parameter file: each against equations written out here."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from drivetool.drive import Drive, one_body, two_mass
from drivetool.drive.effects import EFFECTS
from drivetool.errors import BadParameters
from drivetool.logs import Experiment
from drivetool.tune.design import tune
from drivetool.tune.gains import TuneOptions
from drivetool.tune.optimisation.criteria import criterion, signals
from drivetool.tune.optimisation.scenarios import draw_drives, joint_covariance, spread_of_figures
from drivetool.tune.optimisation.search import TuneLimits, check_gain_is_limited, tuning_problem
from drivetool.tune.remarks import loop_findings
from drivetool.tune.simulation.nonlinear import closed_loop, simulate_loop, steady_state
from drivetool.tune.simulation.replay import replay_load_step
from drivetool.tune.speed_loop import working_point
from drivetool.tune.speed_loop.loop import Settings, Wiring, build
from drivetool.tune.speed_loop.sensitivity import max_sensitivity, plant
from drivetool.tune.speed_loop.stability_margins import margins
from drivetool.tune.speed_loop.working_point import (
    LEFT_OUT_EFFECTS,
    LINEAR_EFFECTS,
    SIMULATED_EFFECTS,
    TANGENT_LAWS,
    at_working_point,
    left_out_parameters,
)

FREQUENCIES = np.geomspace(0.3, 900.0, 60)
RIGID = one_body().with_values({
    "motor.inertia": 0.02, "motor.viscous": 0.015, "converter.bandwidth": 300.0, "converter.damping": 0.7,
    "converter.dead_time": 2e-3})
GEARED = two_mass().with_values({
    "motor.inertia": 0.02, "load.inertia": 0.3, "shaft.stiffness": 90.0, "shaft.damping": 0.02, "shaft.ratio": 3.0,
    "motor.viscous": 1e-3, "load.viscous": 2e-3, "converter.bandwidth": 900.0})
SENSOR_FILTERS = {
    "none": ({}, 0.0, lambda s: 1.0),
    "order 1": ({"sensor.bandwidth": 60.0}, 0.0, lambda s: 1 / (1 + s / 60)),
    "order 2": ({"sensor.bandwidth": 60.0, "sensor.order": 2.0, "sensor.damping": 0.8}, 0.0,
                lambda s: 1 / (1 + 1.6 * s / 60 + (s / 60) ** 2)),
    "order 2 and the controller's": ({"sensor.bandwidth": 90.0, "sensor.order": 2.0}, 4e-3,
                                     lambda s: 1 / (1 + 1.38 * s / 90 + (s / 90) ** 2) / (1 + 4e-3 * s))}


def plant_and_state_responses(drive: Drive, wiring: Wiring,
                              w: np.ndarray = FREQUENCIES) -> tuple[np.ndarray, np.ndarray]:
    """(w,) from torque command to measured speed: by the plant, and by the states of the loop."""
    loop = build(drive, wiring)
    s = 1j * w[:, None, None]
    states = np.linalg.solve(s * np.eye(len(loop.a)) - loop.a, loop.command[0][:, None].astype(complex))[..., 0]
    return plant(drive, wiring).at(w).responses[0], states @ loop.rows["measured_speed"]


def geared_response(s, motor_viscous, load_viscous, stiffness=90.0, damping=0.02):
    """Motor speed over torque of GEARED, the equations written out."""
    shaft = stiffness / s + damping
    load = 0.3 * s + load_viscous
    return 1 / (0.02 * s + motor_viscous + shaft * load / (shaft + load) / 9.0) / (
        1 + 2 * 0.69 * s / 900 + (s / 900) ** 2)


@pytest.mark.parametrize("name", SENSOR_FILTERS)
def test_a_filter_of_the_sensor_against_its_transfer_function(name):
    """Over frequency with the exact delay; the states have the delay as a Pade approximant of fifth order."""
    values, controller_filter, sensor = SENSOR_FILTERS[name]
    s = 1j * FREQUENCIES
    wanted = sensor(s) * np.exp(-2e-3 * s) / (1 + 1.4 * s / 300 + (s / 300) ** 2) / (0.02 * s + 0.015)
    exact, states = plant_and_state_responses(RIGID.with_values(values), Wiring(speed_filter=controller_filter))
    np.testing.assert_allclose(exact, wanted, rtol=1e-10)
    np.testing.assert_allclose(states, wanted, rtol=1e-4)


@pytest.mark.parametrize("name", SENSOR_FILTERS)
def test_margins_with_a_filter_of_the_sensor_by_control(name):
    """The delay in `control` is a Pade approximant of order ten, without any code of the loop."""
    values, controller_filter, sensor = SENSOR_FILTERS[name]
    s, at = control.tf("s"), Settings(0.4, 0.3)
    delay = control.tf(*control.pade(2e-3, 10))
    loop = 0.4 * (1 + 1 / (0.3 * s)) * sensor(s) * delay / (1 + 1.4 * s / 300 + (s / 300) ** 2) / (0.02 * s + 0.015)
    gain, phase = control.margin(loop)[:2]
    found = margins(plant(RIGID.with_values(values), Wiring(speed_filter=controller_filter)), at)
    assert found.gain_margin == pytest.approx(gain, rel=1e-4)
    assert found.phase_margin_deg == pytest.approx(phase, rel=1e-3)
    w = np.geomspace(0.1, 2e3, 200001)
    assert found.max_sensitivity == pytest.approx((1 / np.abs(1 + loop(1j * w))).max(), rel=1e-5)

    def slowest(factor):
        loop = build(RIGID.with_values(values), Wiring(speed_filter=controller_filter))
        return np.linalg.eigvals(loop.matrix(Settings(factor * 0.4, 0.3))).real.max()

    assert brentq(slowest, 1.0, 60.0) == pytest.approx(gain, rel=1e-4)


# Slope of friction over the speed of a body at w: the derivatives of the laws of the catalogue.
FRICTION_SLOPES = {
    "drag": ({"drag": 3e-4}, lambda w: 2 * 3e-4 * abs(w)),
    "asymmetry": ({"viscous_asymmetry": 5e-4}, lambda w: 5e-4 if w >= 0 else -5e-4),
    "stribeck": ({"stribeck": 0.4, "stribeck_speed": 9.0}, lambda w: -2 * w * np.sign(w) / 81 * 0.4 * np.exp(
        -(w / 9) ** 2)),
    "stribeck-power": ({"stribeck": 0.4, "stribeck_speed": 9.0, "stribeck_power": 1.3}, lambda w: (
        -0.4 * 1.3 * (abs(w) / 9) ** 1.3 / max(abs(w), 1e-300) * np.exp(-(abs(w) / 9) ** 1.3))),
    "breakaway": ({"coulomb": 0.2, "breakaway": 0.4, "breakaway_speed": 9.0}, lambda w: (
        (2 * np.e) ** 0.5 * 0.4 * np.exp(-w * w / 162) * (1 - w * w / 81) / (2**0.5 * 9)
        + 0.2 * 10 / 9 / np.cosh(10 * w / 9) ** 2)),
    "coulomb": ({"coulomb": 0.7}, lambda w: 0.0)}


@pytest.mark.parametrize("speed", [0.0, 6.0, 30.0, -30.0])
@pytest.mark.parametrize("body", ["motor", "load"])
@pytest.mark.parametrize("law", FRICTION_SLOPES)
def test_friction_at_a_working_speed(law, body, speed):
    """The load turns at a third of the motor's speed."""
    values, slope = FRICTION_SLOPES[law]
    drive = GEARED.with_values({f"{body}.{k}": v for k, v in values.items()})
    motor, load = slope(speed) * (body == "motor"), slope(speed / 3) * (body == "load")
    exact, states = plant_and_state_responses(drive, Wiring(speed=speed))
    wanted = geared_response(1j * FREQUENCIES, 1e-3 + motor, 2e-3 + load)
    np.testing.assert_allclose(exact, wanted, rtol=1e-8)
    np.testing.assert_allclose(states, wanted, rtol=1e-8)


def test_a_factor_and_a_total_of_friction():
    """The total is distributed by the inertias behind the gear; the factor multiplies drag and viscous friction."""
    values = {"total.viscous": 0.01, "friction.factor": 2.0, "load.drag": 1e-4}
    drive = replace(GEARED, values={
        k: v for k, v in GEARED.values.items() if not k.endswith("viscous")}).with_values(values)
    total_inertia = 0.02 + 0.3 / 9
    wanted = geared_response(1j * FREQUENCIES, 2 * 0.01 * 0.02 / total_inertia,
                             2 * (0.01 * 0.3 / 9 / total_inertia * 9 + 2e-4 * 20))
    np.testing.assert_allclose(plant_and_state_responses(drive, Wiring(speed=60.0))[0], wanted, rtol=1e-8)


@pytest.mark.parametrize("hardening", [0.5, -0.2])
def test_a_shaft_by_its_tangent_where_it_carries_the_friction(hardening):
    drive = GEARED.with_values({
        "load.coulomb": 3.0, "load.drag": 2e-2, "shaft.hardening": hardening, "shaft.hardening_twist": 0.1,
        "shaft.hardening_power": 2.0, "shaft.load_damping": 1e-3})
    torque = 3.0 + 2e-3 * 10 + 2e-2 * 100
    twist = brentq(lambda z: 90 * z * (1 + hardening * (z / 0.1) ** 2) - torque, 0.0, 0.12)
    wanted = geared_response(1j * FREQUENCIES, 1e-3, 2e-3 + 2 * 2e-2 * 10,
                             90 * (1 + 3 * hardening * (twist / 0.1) ** 2),
                             0.02 + 1e-3 * 90 * twist)
    np.testing.assert_allclose(plant_and_state_responses(drive, Wiring(speed=30.0))[0], wanted, rtol=1e-8)


def test_a_shaft_that_softens_until_it_carries_nothing_is_refused():
    drive = GEARED.with_values({"load.coulomb": 9.0, "shaft.hardening": -0.9, "shaft.hardening_twist": 0.1})
    with pytest.raises(BadParameters, match=r"shaft\.hardening"):
        build(drive, Wiring())


def integrate_load_step(load, seconds=3.0, speed=20.0, gain=0.3, integral_time=0.3):
    """(time, logged speed, speed, torque) under a load step at 0.5 s: drag, a sensor of order 2, a PI."""
    j, b, c2, wf, zeta = 0.02, 0.015, 2e-3, 60.0, 0.8

    def rates(t, x):
        w, y, rate, total = x
        torque = gain * (speed - y + total / integral_time)
        return [(torque - b * w - c2 * w * abs(w) - load * (t >= 0.5)) / j, rate,
                wf**2 * (w - y) - 2 * zeta * wf * rate, speed - y]

    start = [speed, speed, 0.0, (b * speed + c2 * speed**2) * integral_time / gain]
    time = np.arange(0.0, seconds, 1e-3)
    x = solve_ivp(rates, (0.0, seconds), start, t_eval=time, max_step=2e-3, rtol=1e-9, atol=1e-11).y
    return time, x[1], x[0], gain * (speed - x[1] + x[3] / integral_time)


DRIVE_WITH_DRAG = one_body().with_values({
    "motor.inertia": 0.02, "motor.viscous": 0.015, "motor.drag": 2e-3, "sensor.bandwidth": 60.0,
    "sensor.order": 2.0, "sensor.damping": 0.8})
PI_SETTINGS = Settings(0.3, 0.3)


def test_time_responses_and_the_simulation_against_an_integrated_nonlinear_drive():
    """The step is so small that only the tangent of the drag matters."""
    time, _, speed, torque = integrate_load_step(1e-3)
    loop, after = build(DRIVE_WITH_DRAG, Wiring(speed=20.0)), time >= 0.5
    found = signals(loop, PI_SETTINGS, ["motor_speed", "motor_torque"])
    speed_change = speed[after] - 20.0
    np.testing.assert_allclose(found["motor_speed"].at(time[after] - 0.5) * 1e-3, speed_change,
                               atol=1e-3 * np.abs(speed_change).max())
    inputs = np.column_stack([np.full(len(time), 20.0), 1e-3 * (time >= 0.5)])
    _, states = simulate_loop(closed_loop(loop, PI_SETTINGS, 1e-3), inputs, steady_state(loop, PI_SETTINGS, 20.0),
                              1e-3)
    np.testing.assert_allclose(states[after, 0] - 20.0, speed_change, atol=2e-3 * np.abs(speed_change).max())
    steady = steady_state(loop, PI_SETTINGS, 20.0)
    assert PI_SETTINGS.gain * (20.0 - steady @ loop.rows["measured_speed"] + steady[-1]
                               / PI_SETTINGS.integral_time) == pytest.approx(
        torque[0], rel=1e-9)


def test_a_replay_compares_the_speed_that_was_logged_and_linearises_at_the_speed_of_the_record():
    """The gains were tuned for slow motion; the record runs at 20 rad/s, where the drag damps more."""
    time, logged, speed, torque = integrate_load_step(0.02)
    experiment = Experiment(
        "step", "", 1e-3, 0.0, {"load_torque": 0.02 * (time >= 0.5), "motor_speed": logged, "motor_torque": torque},
        ((0, len(time)),))
    found = replay_load_step(build(DRIVE_WITH_DRAG, Wiring()), PI_SETTINGS, experiment)
    assert found.fits["motor_speed"] > 97.0 and found.fits["motor_torque"] > 97.0
    assert np.abs(speed - logged).max() > 0.1 * np.ptp(logged)


@pytest.mark.parametrize("values", [{}, {"converter.dead_time": 1e-3}, {"converter.bandwidth": 900.0}])
def test_the_torque_ends_at_the_load_whatever_the_torque_path(values):
    """Without a lag the torque follows its command at once, or by the approximant of the dead time."""
    drive = one_body().with_values({"motor.inertia": 0.02, "sensor.bandwidth": 60.0, **values})
    torque = signals(build(drive, Wiring()), PI_SETTINGS, ["motor_torque"])["motor_torque"]
    assert torque.rest == pytest.approx(1.0, rel=1e-9)


# Contract over all effects: a drive on which each of them can act, and a changed value of each parameter.
DRIVE_FOR_EVERY_EFFECT = GEARED.with_values({"converter.dead_time": 1e-3})
CHANGED_VALUES = {"order": 1.0, "damping": 0.3, "bandwidth": 50.0, "factor": 2.0, "ratio": 2.0, "dead_time": 4e-3,
                  "interpolation": 0.5, "half_gap": 0.02, "hardening": 0.4, "hardening_twist": 0.02,
                  "hardening_power": 1.0, "stiffness": 60.0, "stribeck_speed": 7.0, "stribeck_power": 1.5,
                  "radius": 2.0, "clamped": 1.0, "breakaway_speed": 7.0, "pole_pairs": 2.0}
# Values needed beside the changed one, for effects that act only together with another.
PREREQUISITES = {"carried-mass": {"load.carried_mass": 0.1},
                 "speed-filter": {"sensor.bandwidth": 80.0, "sensor.order": 2.0},
                 "stribeck": {"load.stribeck": 2.0, "load.stribeck_speed": 5.0},
                 "breakaway": {"load.breakaway": 2.0, "load.breakaway_speed": 5.0},
                 "hardening-stiffness": {"shaft.hardening": 0.3, "shaft.hardening_twist": 0.1, "load.coulomb": 2.0},
                 "load-dependent-damping": {"load.coulomb": 2.0}}
OWNERS = {"body": "load", "shaft": "shaft", "path": "converter", "sensor": "sensor", "friction": "friction",
          "motor": "motor"}
PARAMETERS = [(effect, f"{OWNERS[effect.of]}.{suffix}") for effect in EFFECTS for suffix in effect.quantities]


def with_one_change(effect, name: str) -> tuple[Drive, Drive]:
    """(before, after) the change of one parameter."""
    before = DRIVE_FOR_EVERY_EFFECT.with_values(PREREQUISITES.get(effect.code, {}))
    suffix = name.partition(".")[2]
    return before, before.with_values({name: CHANGED_VALUES.get(suffix, 0.04)})


def test_every_effect_is_one_thing_to_the_loop():
    tables = [LINEAR_EFFECTS, TANGENT_LAWS, set(SIMULATED_EFFECTS), set(LEFT_OUT_EFFECTS)]
    assert sum(map(len, tables)) == len(set().union(*tables)) == len(EFFECTS)
    assert set().union(*tables) == {effect.code for effect in EFFECTS}


@pytest.mark.parametrize(("effect", "name"), PARAMETERS, ids=[name + " " + e.code for e, name in PARAMETERS])
def test_every_parameter_is_in_the_loop_or_is_stated_not_to_be(effect, name):
    wiring = Wiring(speed=9.0)
    before, after = with_one_change(effect, name)
    change = [np.abs(b / a - 1.0).max()
              for a, b in zip(plant_and_state_responses(before, wiring), plant_and_state_responses(after, wiring),
                              strict=True)]
    if effect.code in LINEAR_EFFECTS or effect.code in TANGENT_LAWS:
        assert min(change) > 1e-4
    else:
        assert max(change) < 1e-12
    listed = [one for names in left_out_parameters(after).values() for one in names]
    assert listed == ([name] if effect.code in LEFT_OUT_EFFECTS and name.partition(".")[2] in effect.present
                      else [])
    if effect.code in SIMULATED_EFFECTS:
        at = Settings(0.3, 0.3)
        loops = [build(drive, wiring) for drive in (before, after)]
        start = [steady_state(loop, at, 9.0) for loop in loops]
        plants = [closed_loop(loop, at, 1e-3).system for loop in loops]
        assert np.abs(start[1] - start[0]).max() > 1e-6 or plants[0].ng != plants[1].ng


def test_an_effect_that_the_loop_does_not_know_is_refused_by_name(monkeypatch):
    monkeypatch.setattr(working_point, "TANGENT_LAWS", TANGENT_LAWS - {"quadratic-drag"})
    with pytest.raises(BadParameters, match=r"load\.drag"):
        build(GEARED.with_values({"load.drag": 1e-3}), Wiring())


@pytest.mark.parametrize("owner", ["converter", "sensor"])
def test_an_order_between_one_and_two_is_refused_by_name(owner):
    with pytest.raises(BadParameters, match=rf"{owner}\.order of 1 or 2"):
        build(DRIVE_FOR_EVERY_EFFECT.with_values({f"{owner}.order": 1.5}), Wiring())


def test_the_working_point_of_a_working_point_is_itself():
    drive = DRIVE_FOR_EVERY_EFFECT.with_values({
        "load.drag": 1e-3, "load.stribeck": 0.5, "friction.factor": 1.3, "shaft.hardening": 0.2,
        "load.ripple_sine": 0.1, "load.drift_viscous": 0.1})
    once = at_working_point(drive, 9.0)
    assert at_working_point(once, 9.0) == once != drive
    assert at_working_point(DRIVE_FOR_EVERY_EFFECT, 9.0) is DRIVE_FOR_EVERY_EFFECT


def test_a_filter_of_the_sensor_limits_the_gain():
    without_sensor = one_body().with_values({"motor.inertia": 2.0, "motor.viscous": 0.01})
    with pytest.raises(BadParameters, match="every gain is stable"):
        check_gain_is_limited(tuning_problem(build(without_sensor, Wiring()), criterion("IAE"), TuneLimits()))
    check_gain_is_limited(tuning_problem(build(without_sensor.with_values({"sensor.bandwidth": 100.0}), Wiring()),
                                         criterion("IAE"),
                                         TuneLimits()))


@pytest.mark.slow
def test_the_design_and_its_spread_have_the_filter_and_the_drag():
    """Ms of the settings by equations of this file; over the draws it varies with sensor and drag alone."""
    drive = RIGID.with_values({"sensor.bandwidth": 60.0, "motor.drag": 1e-3})
    stds = {"sensor.bandwidth": 6.0, "motor.drag": 2e-4}
    gains = tune(drive, TuneOptions(speed=50.0, stds=stds, draws=40))
    design = gains.designs[0]
    s = 1j * np.geomspace(0.1, 2e3, 200001)
    loop = design.settings.gain * (1 + 1 / (s * design.settings.integral_time)) * np.exp(-2e-3 * s) / (
        1 + s / 60) / (1 + 1.4 * s / 300 + (s / 300) ** 2) / (0.02 * s + 0.015 + 2 * 1e-3 * 50)
    assert design.margins.max_sensitivity == pytest.approx((1 / np.abs(1 + loop)).max(), rel=1e-5)
    assert set(design.spread.parameters) == set(stds)
    for name in stds:
        draws = draw_drives(drive, joint_covariance(drive, None, {name: stds[name]}), 20, 1)
        assert np.ptp(spread_of_figures(draws, design.wiring, design.settings,
                                        2.0).samples["max_sensitivity"]) > 1e-4, name
    assert max_sensitivity(plant(drive, Wiring()), design.settings)[0] != pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize(("values", "options", "expected_findings"), [
    ({}, {}, []),
    ({"load.drag": 1e-3}, {}, ["note friction-linearised"]),
    ({"load.drag": 1e-3}, {"speed": 5.0}, []),
    ({"load.stribeck": 0.1}, {}, ["warning friction-linearised"]),
    ({"motor.ripple_sine": 0.1, "load.step_torque": 0.1}, {}, ["note not-in-loop"]),
    ({"sensor.bandwidth": 60.0}, {}, []),
    ({"sensor.bandwidth": 60.0}, {"speed_filter": 1e-3}, ["note two-speed-filters"])])
def test_what_tune_says_of_its_loop(values, options, expected_findings):
    found = loop_findings(DRIVE_FOR_EVERY_EFFECT.with_values(values), TuneOptions(**options))
    assert [f"{f.severity} {f.code}" for f in found] == expected_findings
    for name in values:
        assert not found or any(name in f.text for f in found)


def test_values_of_one_recording_are_not_in_the_loop_and_named():
    drive = replace(DRIVE_FOR_EVERY_EFFECT, records={"a.csv": "0" * 64}).with_values({
        "load.viscous@a.csv": 7.0, "load.drag@a.csv": 1.0})
    np.testing.assert_allclose(plant_and_state_responses(drive, Wiring(speed=9.0))[0],
                               plant_and_state_responses(DRIVE_FOR_EVERY_EFFECT, Wiring())[0], rtol=1e-12)
    (finding,) = loop_findings(drive, TuneOptions())
    assert finding.code == "not-in-loop" and "load.viscous@a.csv, load.drag@a.csv" in finding.text
