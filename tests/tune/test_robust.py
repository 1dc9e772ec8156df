"""Uncertainty, published variations, infeasible limits and limit cycles of a tuned loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import resonances, two_mass
from drivetool.errors import BadOption, BadParameters
from drivetool.identify.estimate import Covariance
from drivetool.tune.design import tune, wirings_to_tune
from drivetool.tune.gains import TuneOptions
from drivetool.tune.optimisation.criteria import criterion, signals
from drivetool.tune.optimisation.robust import robust_optimum
from drivetool.tune.optimisation.scenarios import draw_drives, joint_covariance, spread_of_figures
from drivetool.tune.optimisation.search import TuneLimits, optimum, tuning_problem
from drivetool.tune.optimisation.variations import variation_study
from drivetool.tune.simulation.limit_cycle import disturbance_responses, safe_gain
from drivetool.tune.simulation.nonlinear import closed_loop, simulate_loop, steady_state
from drivetool.tune.speed_loop.loop import Settings, Wiring, build
from drivetool.tune.speed_loop.sensitivity import max_sensitivity, plant
from tests.simulator import controllers, machine
from tests.simulator.simulate import simulate
from tests.tallfors import MOTORS, tandem, two_mass_plant

HEAVY = two_mass_plant("heavy")
# Motor inertia and stiffness rise together, as they do where the record identifies only the resonance.
COVARIANCE = Covariance(("motor.inertia", "shaft.stiffness"), np.array([[1.0, 0.9e4], [0.9e4, 1e8]]))
# Stable with the contact closed; with 0.09 to 0.77 of its stiffness it is not.
CYCLING = two_mass().with_values({
    "motor.inertia": 1.0, "load.inertia": 3.67, "motor.viscous": 1e-3, "load.viscous": 4e-3,
    "shaft.stiffness": 206e3, "shaft.damping": 5.6, "shaft.half_gap": 0.002,
    "converter.bandwidth": 433.0, "converter.damping": 0.69, "converter.dead_time": 0.0044})
CYCLING_AT = Settings(41.4, 0.0515)
FILTERED = Wiring(speed_filter=0.002)


def test_draws_have_the_covariance_with_its_correlation():
    draws = draw_drives(HEAVY, COVARIANCE, 4000, 1)
    values = np.array([[d.value(n) for n in COVARIANCE.names] for d in draws.drives])
    assert draws.unphysical == 0
    np.testing.assert_allclose(np.cov(values.T), COVARIANCE.matrix, rtol=0.07)
    assert draw_drives(HEAVY, COVARIANCE, 10, 1).drives == draw_drives(HEAVY, COVARIANCE, 10, 1).drives
    assert draw_drives(HEAVY, COVARIANCE, 10, 1).drives != draw_drives(HEAVY, COVARIANCE, 10, 2).drives


@pytest.mark.slow
def test_unphysical_draws_are_left_out_and_counted():
    wide = joint_covariance(HEAVY, None, {"shaft.damping": 224.0})
    draws = draw_drives(HEAVY, wide, 2000, 1)
    assert draws.unphysical / 2000 == pytest.approx(0.1587, abs=0.03)  # below minus one std
    assert len(draws.drives) + draws.unphysical == 2000
    gains = tune(HEAVY, TuneOptions(stds={"shaft.damping": 224.0}, draws=100))
    assert gains.designs[0].spread.unphysical > 5
    assert [f.severity for f in gains.findings if f.code == "unphysical-draws"] == ["warning"]


@pytest.mark.slow
def test_correlation_matters_and_is_kept():
    at = Settings(1968.0, 0.0554)
    uncorrelated = Covariance(COVARIANCE.names, np.diag(np.diag(COVARIANCE.matrix)))
    wide, narrow = (spread_of_figures(draw_drives(HEAVY, c, 150, 1), Wiring(), at,
                                      2.0).samples["max_sensitivity"].std()
                    for c in (uncorrelated, COVARIANCE))
    assert narrow < 0.9 * wide


@pytest.mark.parametrize("matrix", [[[1.0, 2e4], [2e4, 1e8]]])
def test_a_covariance_that_is_none(matrix):
    with pytest.raises(BadParameters, match="negative variances"):
        draw_drives(HEAVY, Covariance(COVARIANCE.names, np.array(matrix)), 10, 1)


@pytest.mark.slow
def test_confidence_holds_over_the_draws_and_costs_no_more_than_it_must():
    draws = draw_drives(HEAVY, COVARIANCE, 120, 1)
    nominal = tuning_problem(build(HEAVY, Wiring()), criterion("ISE"), TuneLimits(2.0))
    nominal_optimum, robust = optimum(nominal), robust_optimum(nominal, draws, 0.9)
    ms = np.sort(spread_of_figures(draws, Wiring(), robust.settings, 2.0).samples["max_sensitivity"])
    assert ms[107] <= 2.0 + 1e-5 < ms[108]  # 90 % of 120 are 108 draws
    assert nominal_optimum.value < robust.value < 1.3 * nominal_optimum.value
    fresh = spread_of_figures(draw_drives(HEAVY, COVARIANCE, 400, 77), Wiring(), robust.settings, 2.0)
    assert fresh.above_limit == pytest.approx(0.1, abs=0.06)


def test_published_study():
    """Stiffness and load inertia change Ms little, dead time and motor inertia much: Tallfors 2005, sec. 3.2."""
    for name, gain, ti in (("light", 1809, 0.02139), ("medium", 2669, 0.04478), ("heavy", 2606, 0.0559)):
        drive = two_mass_plant(name)
        found = variation_study(drive, Wiring(dead_time="zero"), Settings(gain, ti))
        ms = {each.change: each.max_sensitivity for each in found}
        nominal = ms.pop("nominal")
        for label, value in ms.items():
            assert (value / nominal - 1.0 > 0.1) == ("doubled" in label or "80 %" in label), label
        lighter = found[-1].drive
        assert lighter.value("motor.inertia") == 16.0
        before, after = (next(m for m in resonances(d) if m.kind == "resonance") for d in (drive, lighter))
        assert after.frequency_hz == pytest.approx(before.frequency_hz, rel=1e-9)
        assert after.damping_ratio == pytest.approx(before.damping_ratio, rel=1e-3)


@pytest.mark.slow
def test_infeasible_limits_name_the_nearest():
    with pytest.raises(BadOption, match=r"above 1; found 0.9"):
        tune(HEAVY, TuneOptions(limits=TuneLimits(0.9)))
    with pytest.raises(BadOption, match="lowest attainable Ms") as raised:
        tune(HEAVY, TuneOptions(limits=TuneLimits(1.005)))
    suggested = float(str(raised.value).split("--max-sensitivity ")[1].split()[0])
    assert tune(HEAVY,
                TuneOptions(limits=TuneLimits(suggested))).designs[0].margins.max_sensitivity <= suggested + 1e-6
    with pytest.raises(BadOption, match="gain is at least") as raised:
        tune(HEAVY, TuneOptions(limits=TuneLimits(1.5, 0.05)))
    least = float(str(raised.value).split("--max-gain to ")[1].split()[0])
    assert tune(HEAVY, TuneOptions(limits=TuneLimits(1.5, 1.05 * least))).designs[0].active == "gain"


@pytest.mark.slow
def test_gain_limit_is_kept():
    design = tune(HEAVY, TuneOptions(limits=TuneLimits(2.0, 1000.0))).designs[0]
    assert design.active == "gain" and design.settings.gain <= 1000.0 * (1 + 1e-9)


@pytest.mark.parametrize("options, words", [
    (TuneOptions(configurations=("mimo",), shaft_torque=True), "at least three bodies"),
    (TuneOptions(motors=("load",)), "the first body first"),
    (TuneOptions(confidence=0.95), "standard deviations or a covariance"),
    (TuneOptions(confidence=1.5), "between 0 and 1"),
])
def test_what_does_not_fit_is_refused(options, words):
    with pytest.raises((BadParameters, BadOption), match=words):
        tune(HEAVY, options)


def test_shaft_torque_feedback_needs_its_role():
    with pytest.raises(BadParameters, match="shaft_torque role"):
        tune(tandem("G1"), TuneOptions(configurations=("mimo",)))
    found, notes = wirings_to_tune(tandem("G1"), TuneOptions())
    assert [w.configuration for w in found] == ["siso", "miso"] and {w.motors for w in found} == {MOTORS}
    assert [note.code for note in notes] == ["shaft-feedback-not-evaluated"]
    assert len(wirings_to_tune(tandem("G1"), TuneOptions(shaft_torque=True))[0]) == 3


@pytest.mark.parametrize("law", ["inside", "contact"])
def test_closed_loop_around_the_whole_drive_is_the_linear_one_while_the_contact_holds(law):
    drive = replace(HEAVY.with_values({"shaft.half_gap": 0.002, "load.idle_torque": 5.0, "motor.coulomb": 2.0,
                                       "load.coulomb": 3.0}), damping_law=law)
    at, h = Settings(2000.0, 0.06), 1e-4
    loop = build(drive, FILTERED)
    inputs = np.full((6000, 2), [10.0, 0.0])
    inputs[1000:, 1] = 1000.0
    system = closed_loop(loop, at, h, ("motor_speed", "load_speed"))
    speeds, _ = simulate_loop(system, inputs, steady_state(loop, at, 10.0), h)
    np.testing.assert_allclose(speeds[:1000], 10.0, atol=1e-10)
    found = signals(loop, at, ["motor_speed", "load_speed"])
    for k, modes in enumerate(found.values()):
        np.testing.assert_allclose(speeds[1000:, k] - 10.0, 1000.0 * modes.at(np.arange(5000) * h), atol=1e-10)


def test_hunting_is_found_where_the_describing_function_puts_it():
    """The cycle has the frequency at which the largest unstable effective stiffness oscillates."""
    loop = build(CYCLING, FILTERED)
    assert np.linalg.eigvals(loop.matrix(CYCLING_AT)).real.max() < 0.0
    border_frequency = None
    for share in np.linspace(1.0, 0.05, 400):
        soft = CYCLING.with_values({
            f"shaft.{k}": share * CYCLING.value(f"shaft.{k}") for k in ("stiffness", "damping")})
        poles = np.linalg.eigvals(build(soft, FILTERED).matrix(CYCLING_AT))
        if poles.real.max() > 0.0:
            border_frequency = abs(poles[np.argmax(poles.real)].imag) / (2 * np.pi)
            break
    (found,) = disturbance_responses(loop, CYCLING_AT)
    assert found.hunts and found.frequency_hz == pytest.approx(border_frequency, rel=0.03)


@pytest.mark.slow
def test_a_limit_cycle_against_the_independent_simulator():
    (found,) = disturbance_responses(build(CYCLING, FILTERED), CYCLING_AT)
    # A discrete controller without the filter, whose lag is put into the dead time instead.
    plain = build(CYCLING.with_values({"converter.dead_time": 0.0064}), Wiring())
    (unfiltered,) = disturbance_responses(plain, CYCLING_AT)
    h = 2e-4
    m = machine.Machine(inertia=(1.0, 3.67), viscous=(1e-3, 4e-3), stiffness=(206e3,), damping=(5.6,),
                        half_gap=(0.002,), converter_bandwidth=433.0, dead_time=0.0064 - h / 2)
    n = 6000
    pi = controllers.SpeedPI(np.zeros(n), CYCLING_AT.gain, CYCLING_AT.gain / CYCLING_AT.integral_time, h)
    start = machine.State((0.0, unfiltered.kick), (0.0,), 0.0, 0.0, 0.0)
    speed = simulate(m, np.zeros(n), h, start, pi, rtol=1e-7, atol=1e-10).speeds[n // 2:, 0]
    upward_crossings = np.flatnonzero((speed[:-1] < 0) & (speed[1:] >= 0))
    assert unfiltered.hunts and found.hunts
    assert np.ptp(speed) / 2 == pytest.approx(unfiltered.amplitude, rel=0.03)
    assert (len(upward_crossings) - 1) / ((upward_crossings[-1] - upward_crossings[0]) * h) == pytest.approx(
        unfiltered.frequency_hz, rel=0.01)


@pytest.mark.slow
def test_a_limit_cycle_where_the_shaft_relaxes_in_the_gap():
    """So much damping that the frequencies by the two laws differ by 2 %."""
    drive, h, n = CYCLING.with_values({"converter.dead_time": 0.0064, "shaft.damping": 55.0}), 2e-4, 6000
    inside, found = (disturbance_responses(build(replace(drive, damping_law=law), Wiring()), CYCLING_AT)[0]
                     for law in ("inside", "contact"))
    m = machine.Machine(inertia=(1.0, 3.67), viscous=(1e-3, 4e-3), stiffness=(206e3,), damping=(55.0,),
                        half_gap=(0.002,), converter_bandwidth=433.0, dead_time=0.0064 - h / 2, law="contact")
    pi = controllers.SpeedPI(np.zeros(n), CYCLING_AT.gain, CYCLING_AT.gain / CYCLING_AT.integral_time, h)
    start = machine.State((0.0, found.kick), (0.0,), 0.0, 0.0, 0.0)
    speed = simulate(m, np.zeros(n), h, start, pi, rtol=1e-7, atol=1e-10).speeds[n // 2:, 0]
    up = np.flatnonzero((speed[:-1] < 0) & (speed[1:] >= 0))
    assert found.hunts and (len(up) - 1) / ((up[-1] - up[0]) * h) == pytest.approx(found.frequency_hz, rel=3e-3)
    assert found.frequency_hz > 1.015 * inside.frequency_hz


@pytest.mark.slow
def test_below_the_safe_gain_there_is_no_limit_cycle():
    loop = build(CYCLING, FILTERED)
    safe = safe_gain(loop, CYCLING_AT)
    assert 0.0 < safe < CYCLING_AT.gain
    at = Settings(0.95 * safe, CYCLING_AT.integral_time * CYCLING_AT.gain / safe)
    if safe_gain(loop, at) is None:
        assert not any(each.hunts for each in disturbance_responses(loop, at))
    assert not any(each.hunts
                   for each in disturbance_responses(build(HEAVY.with_values({"shaft.half_gap": 0.01}), Wiring()),
                                              Settings(1968.0, 0.0554)))


@pytest.mark.slow
def test_a_limit_cycle_is_reported():
    gains = tune(CYCLING, TuneOptions(speed_filter=0.002))
    limit_cycles = [f for f in gains.findings if f.code == "limit-cycle"]
    assert limit_cycles and limit_cycles[0].severity == "warning"
    assert limit_cycles[0].evidence["frequency_hz"] > 10.0 and limit_cycles[0].evidence["amplitude"] > 0.0
    design = gains.designs[0]
    assert max_sensitivity(plant(CYCLING, design.wiring), design.settings)[0] <= 2.0 + 1e-6
