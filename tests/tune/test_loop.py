"""Criteria, sensitivity and search against computations that share no code with them."""

from __future__ import annotations

import warnings
from itertools import pairwise

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import brentq
from scipy.signal import lti, step

from drivetool.drive import Drive, one_body, two_mass
from drivetool.drive.chain import vehicle
from drivetool.errors import BadOption, BadParameters
from drivetool.tune.optimisation.criteria import criterion, criterion_value, criterion_values, signals
from drivetool.tune.optimisation.load_step_factors import factors
from drivetool.tune.optimisation.search import (
    TuneLimits,
    allowed_gains,
    check_gain_is_limited,
    grid_shapes,
    lowest_sensitivity,
    optimum,
    tuning_problem,
)
from drivetool.tune.speed_loop.loop import Settings, Wiring, build, path_response, torque_path
from drivetool.tune.speed_loop.sensitivity import max_sensitivity, plant
from drivetool.tune.speed_loop.stability_margins import margins
from tests.simulator import controllers, machine
from tests.simulator.simulate import simulate
from tests.tallfors import MOTORS, tandem, two_mass_plant

PRINTED_WIRING = Wiring(dead_time="zero")
PUBLISHED_SETTINGS = {"light": Settings(1809, 0.02139), "medium": Settings(2641, 0.04097),
                      "heavy": Settings(2270, 0.02458)}


def transfer_functions(drive: Drive, at: Settings):
    """(load speed from load torque, loop gain) of a two-mass drive, from its equations, by `control`."""
    v = {name: drive.value(name) for name in drive.quantities}
    s = control.tf("s")
    shaft = v["shaft.stiffness"] / s + v["shaft.damping"]
    motor = v["motor.inertia"] * s + v["motor.viscous"]
    load = v["load.inertia"] * s + v["load.viscous"]
    w, z, td = v["converter.bandwidth"], v["converter.damping"], v["converter.dead_time"]
    torque = w**2 * (1 - s * td / 2) / (s**2 + 2 * z * w * s + w**2) * at.gain * (1 + 1 / (s * at.integral_time))
    controlled_motor = motor + torque  # torque over motor speed, of motor and controller together
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        to_load = control.minreal(-(controlled_motor + shaft) / (load * (controlled_motor + shaft)
                                                                 + controlled_motor * shaft), 1e-6, verbose=False)
        mechanical = (load + shaft) / (motor * load + (motor + load) * shaft)
    return to_load, mechanical * torque


@pytest.mark.parametrize("name", PUBLISHED_SETTINGS)
def test_criteria_and_factors_against_a_fine_time_simulation(name):
    at, drive = PUBLISHED_SETTINGS[name], two_mass_plant(name)
    loop = build(drive, PRINTED_WIRING)
    time = np.arange(0.0, 1.6, 2e-5)
    response = control.step_response(transfer_functions(drive, at)[0], time)
    e, h = np.asarray(response.outputs), time[1]
    load = factors(loop, at).load
    np.testing.assert_allclose(signals(loop, at, ["load_speed"])["load_speed"].at(time), e, atol=2e-5 * load.peak)
    drop = np.abs(np.concatenate([[0.0], np.cumsum((e[1:] + e[:-1]) / 2) * h])).max()
    sums = {"IAE": np.trapezoid(np.abs(e), dx=h), "IE": abs(np.trapezoid(e, dx=h)), "ISE": np.trapezoid(e**2, dx=h),
            "ITSE": np.trapezoid(time * e**2, dx=h), "IT6SE": np.trapezoid(time**6 * e**2, dx=h)}
    for kind, wanted in sums.items():
        assert criterion_value(loop, criterion(kind), at) == pytest.approx(wanted, rel=1e-4), kind
    assert load.impact_drop == pytest.approx(drop, rel=1e-4)
    assert load.peak == pytest.approx(np.abs(e).max(), rel=1e-5)
    assert load.overshoot == pytest.approx(100 * e.max() / -e.min(), abs=1e-3)
    assert load.settling_time == pytest.approx(time[np.flatnonzero(np.abs(e) > 0.05 * -e.min())[-1]], abs=3 * h)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1.0, 2.0])
def test_exact_dead_time_against_the_independent_simulator(order):
    """The simulator's delay is exact; the hold of its discrete controller adds half a sample to it."""
    h, at = 1e-4, Settings(1968.0, 0.0554)
    m = machine.Machine(inertia=(20, 80), viscous=(0.006, 0.024), stiffness=(224e3,), damping=(224.0,),
                        converter_bandwidth=433.0, converter_damping=np.inf if order == 1.0 else 0.69,
                        dead_time=0.002 - h / 2)
    n = 5000
    pi = controllers.SpeedPI(np.zeros(n), at.gain, at.gain / at.integral_time, h)
    run = simulate(m, np.zeros(n), h, controller=pi, load_torque=np.ones(n), rtol=1e-8, atol=1e-12)
    drive = two_mass_plant("heavy").with_values({"converter.order": order})
    found = signals(build(drive, Wiring()), at, ["motor_speed", "load_speed"])
    assert list(found) == ["motor_speed", "load_speed"]
    for body, modes in enumerate(found.values()):
        wanted = run.speeds[:, body]
        np.testing.assert_allclose(modes.at(run.time), wanted, atol=3e-3 * np.abs(wanted).max())


@pytest.mark.parametrize("name", PUBLISHED_SETTINGS)
def test_closed_forms_and_lyapunov(name):
    at, drive = PUBLISHED_SETTINGS[name], two_mass_plant(name)
    loop = build(drive, Wiring(speed_filter=0.003))
    found = factors(loop, at)
    assert found.motor.ie == pytest.approx(at.integral_time / at.gain, rel=1e-9)
    assert found.load.ie == pytest.approx(
        at.integral_time / at.gain + 1 / drive.value("shaft.stiffness"), rel=1e-9)
    a, row = loop.matrix(at), loop.rows["load_speed"]
    initial_state = np.linalg.solve(a, loop.b)
    scale = np.sqrt(np.abs(np.diag(solve_continuous_lyapunov(a.T, -np.outer(row, row)))))
    scale[scale == 0.0] = 1.0
    b, c, x = a * scale[None, :].T / scale, row / scale, initial_state * scale
    p = solve_continuous_lyapunov(b.T, -np.outer(c, c))
    assert found.load.ise == pytest.approx(x @ p @ x, rel=1e-6)
    for power, name in enumerate(("ITSE", "IT2SE"), 1):
        p = solve_continuous_lyapunov(b.T, -p)
        assert criterion_value(loop, criterion(name), at) == pytest.approx(power * x @ p @ x, rel=1e-5)


@pytest.mark.parametrize("name", PUBLISHED_SETTINGS)
def test_sensitivity_against_the_transfer_function(name):
    at, drive = PUBLISHED_SETTINGS[name], two_mass_plant(name)
    w = np.geomspace(1.0, 3e3, 400001)
    loop = transfer_functions(drive, at)[1](1j * w)
    found, where = max_sensitivity(plant(drive, PRINTED_WIRING), at)
    assert found == pytest.approx((1 / np.abs(1 + loop)).max(), rel=1e-7)
    assert where == pytest.approx(w[np.argmin(np.abs(1 + loop))], rel=1e-3)


@pytest.mark.parametrize("name", PUBLISHED_SETTINGS)
def test_margins_are_where_the_eigenvalues_cross(name):
    at, drive = PUBLISHED_SETTINGS[name], two_mass_plant(name)
    found = margins(plant(drive, Wiring()), at)

    def slowest(gain=1.0, extra_delay=0.0):
        changed = drive.with_values({"converter.dead_time": 0.002 + extra_delay})
        matrix = build(changed, Wiring()).matrix(Settings(gain * at.gain, at.integral_time))
        return np.linalg.eigvals(matrix).real.max()

    assert found.gain_margin == pytest.approx(brentq(lambda g: slowest(gain=g), 1.0, 8.0), rel=1e-4)
    assert found.delay_margin_s == pytest.approx(brentq(lambda t: slowest(extra_delay=t), 0.0, 0.03), rel=1e-3)
    assert found.gain_reduction_margin == np.inf
    assert 20.0 < found.phase_margin_deg < 60.0


def two_mass_drives(least_load=0.2):
    """Two-mass drives of one kg m^2 on the motor, with resonances and lags of every proportion."""
    def make(load, hertz, damping, late, bandwidth):
        w, parallel = 2 * np.pi * hertz, load / (1 + load)
        return two_mass().with_values({
            "motor.inertia": 1.0, "load.inertia": load, "motor.viscous": 1e-3, "load.viscous": 1e-3 * load,
            "shaft.stiffness": w**2 * parallel, "shaft.damping": 2 * damping * w * parallel,
            "converter.bandwidth": bandwidth, "converter.damping": 0.7, "converter.dead_time": late})

    number = st.floats
    return st.builds(make, number(least_load, 8.0), number(4.0, 60.0), number(0.01, 0.2), number(3e-4, 4e-3),
                     number(200.0, 2000.0))


@settings(max_examples=12, deadline=None)
@given(two_mass_drives(), st.floats(0.01, 0.5), st.floats(1.3, 3.0))
def test_allowed_gains_are_those_that_keep_the_limit(drive, integral_time, limit):
    loop = build(drive, Wiring())
    work = tuning_problem(loop, criterion("IAE"), TuneLimits(limit))
    ends = allowed_gains(work, integral_time, 1.0)
    compared = 0
    for gain in np.geomspace(*work.gains, 60):
        inside = any(low < gain < high for low, high in ends)
        near = any(abs(np.log(gain / end)) < 1e-2 for end in ends.ravel())
        at = Settings(float(gain), integral_time)
        stable = np.linalg.eigvals(loop.matrix(at)).real.max() < 0.0
        ms = max_sensitivity(work.plant, at)[0]
        if not near and abs(ms / limit - 1.0) > 1e-3:
            assert inside == (stable and ms < limit), (gain, ms, ends)
            compared += 1
    assert compared >= 30  # at most a few ends and crossings of the limit lie near a gain of the grid


@pytest.mark.slow
@settings(max_examples=4, deadline=None)
@given(two_mass_drives(), st.sampled_from(["IAE", "ISE", "IE"]))
def test_a_lower_limit_never_lowers_the_criterion(drive, kind):
    check_criterion_over_limits(drive, kind)


@pytest.mark.fuzz
@settings(max_examples=25, deadline=None)
@given(two_mass_drives(), st.sampled_from(["IAE", "ISE", "IE"]))
def test_a_lower_limit_never_lowers_the_criterion_at_length(drive, kind):
    check_criterion_over_limits(drive, kind)


def check_criterion_over_limits(drive, kind, limits=(2.4, 2.0, 1.7, 1.4), wiring=None):
    """The criterion never falls while the limit is lowered."""
    loop = build(drive, wiring or Wiring())
    found = [optimum(tuning_problem(loop, criterion(kind), TuneLimits(limit))) for limit in limits]
    reached = [each.value for each in found]
    assert len(reached) > 1 and np.isfinite(reached).all()
    for at_higher_limit, at_lower_limit in pairwise(reached):
        assert at_lower_limit >= at_higher_limit * (1.0 - 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("dead_time", ["exact", "zero"])
@pytest.mark.parametrize("name, kind", [("heavy", "IT8SE"), ("light", "ITSE"), *(
    pytest.param(*case, marks=pytest.mark.long) for case in (("heavy", "ISE"), ("medium", "IE")))])
def test_a_limit_that_is_as_good_as_none_never_raises_the_criterion(name, kind, dead_time):
    check_criterion_over_limits(two_mass_plant(name), kind, (np.inf, 1000.0, 100.0, 10.0, 2.0),
                                Wiring(dead_time=dead_time))


@pytest.mark.fuzz
@settings(max_examples=25, deadline=None)
@given(two_mass_drives(), st.sampled_from(["IAE", "ISE", "IE", "IT2SE", "IT8SE"]))
def test_a_limit_that_is_as_good_as_none_never_raises_the_criterion_at_length(drive, kind):
    check_criterion_over_limits(drive, kind, (1000.0, 100.0, 10.0, 2.0))


@pytest.mark.parametrize("limit", [30.0, 1000.0, np.inf])
@pytest.mark.parametrize("name", PUBLISHED_SETTINGS)
def test_a_wide_limit_allows_the_gains_up_to_the_border_of_stability(name, limit):
    """The border by the eigenvalues; the forbidden region around it is narrower than the frequency grid."""
    drive, integral_time = two_mass_plant(name), PUBLISHED_SETTINGS[name].integral_time
    loop = build(drive, Wiring())

    def slowest(gain):
        return np.linalg.eigvals(loop.matrix(Settings(gain, integral_time))).real.max()

    border = brentq(slowest, PUBLISHED_SETTINGS[name].gain, 8.0 * PUBLISHED_SETTINGS[name].gain)
    (low, high), = allowed_gains(tuning_problem(loop, criterion("IAE"), TuneLimits(limit)), integral_time, 1.0)
    assert low < 0.1 * PUBLISHED_SETTINGS[name].gain and (
        0.9 / limit < 1.0 - high / border + 1e-3 < 1.5 / limit + 2e-3)


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(two_mass_drives(), st.sampled_from(["IAE", "ISE", "IT2SE"]))
def test_no_point_of_a_plane_is_better_than_the_optimum(drive, kind):
    check_optimum_on_plane(drive, kind, 45)


@pytest.mark.fuzz
@settings(max_examples=12, deadline=None)
@given(two_mass_drives(), st.sampled_from(["IAE", "ISE", "IT2SE"]))
def test_no_point_of_a_dense_plane_is_better_than_the_optimum(drive, kind):
    check_optimum_on_plane(drive, kind, 80)


def check_optimum_on_plane(drive, kind, points):
    """Brute force over integral time and gain."""
    loop = build(drive, Wiring())
    work = tuning_problem(loop, criterion(kind), TuneLimits(1.8))
    found = optimum(work)
    assert max_sensitivity(work.plant, found.settings)[0] <= 1.8 + 1e-6
    times = np.geomspace(*work.times, points)
    gains = np.geomspace(found.settings.gain / 30, found.settings.gain * 10, points)
    ti, kp = (grid.ravel() for grid in np.meshgrid(times, gains))
    cost = criterion_values(loop, work.criterion, kp, ti, np.ones_like(ti))
    better = np.flatnonzero(cost < found.value * (1.0 - 1e-5))
    for k in better:
        assert max_sensitivity(work.plant, Settings(kp[k], ti[k]))[0] > 1.8


@pytest.mark.slow
def test_optimum_repeats_to_the_last_digit():
    loop = build(tandem("G1"), Wiring("mimo", MOTORS, dead_time="zero"))
    first, again = (optimum(tuning_problem(loop, criterion("IAE"), TuneLimits())) for _ in range(2))
    assert first == again


@pytest.mark.slow
def test_a_weight_on_the_torque_trades_speed_for_torque():
    loop = build(two_mass_plant("medium"), Wiring())
    torque, speed = criterion("IAE", {"load_speed": 0.0, "motor_torque": 1.0}), criterion("IAE")
    speed_only, torque_weighted = (optimum(tuning_problem(loop, wanted, TuneLimits())).settings
                                   for wanted in (speed, criterion("IAE", {"motor_torque": 5e-3})))
    assert criterion_value(loop, torque, torque_weighted) < 0.99 * criterion_value(loop, torque, speed_only)
    assert criterion_value(loop, speed, torque_weighted) > 1.001 * criterion_value(loop, speed, speed_only)


@pytest.mark.slow
def test_rigid_drive_and_filter_without_converter():
    rigid = one_body().with_values({"motor.inertia": 2.0, "motor.viscous": 0.01})
    wiring = Wiring(speed_filter=0.004)
    work = tuning_problem(build(rigid, wiring), criterion("IAE"), TuneLimits())
    found = optimum(work)
    assert max_sensitivity(work.plant, found.settings)[0] <= 2.0 + 1e-6
    # Brute force over the closed form: the load's speed is -s Ti (1 + s Tf) over the characteristic polynomial.
    inertia, viscous, filtered, best = 2.0, 0.01, 0.004, (np.inf, 0.0, 0.0)
    s, time = 1j * np.geomspace(1.0, 1e4, 4000), np.linspace(0.0, 0.3, 3001)
    for integral_time in np.geomspace(0.008, 0.04, 18):
        for gain in np.geomspace(250.0, 1000.0, 36):
            loop = gain * (1 + 1 / (s * integral_time)) / ((inertia * s + viscous) * (1 + s * filtered))
            if (1 / np.abs(1 + loop)).max() > 2.0:
                continue
            denominator = [inertia * filtered * integral_time, (inertia + viscous * filtered) * integral_time,
                           (viscous + gain) * integral_time, gain]
            response = step(lti([filtered * integral_time, integral_time, 0.0], denominator), T=time)[1]
            best = min(best, (np.trapezoid(np.abs(response), dx=time[1]), gain, integral_time))
    assert best[0] * 0.94 < found.value < best[0] * 1.0005  # the grid is 4 and 10 % wide
    assert found.settings.gain == pytest.approx(best[1], rel=0.1)
    assert found.settings.integral_time == pytest.approx(best[2], rel=0.2)
    assert factors(work.loop, found.settings).torque_overshoot["motor"] > 5.0
    with pytest.raises(BadParameters, match="every gain is stable"):
        check_gain_is_limited(tuning_problem(build(rigid, Wiring()), criterion("IAE"), TuneLimits()))


@pytest.mark.slow
def test_a_drive_without_damping_or_friction():
    drive = two_mass().with_values({
        "motor.inertia": 0.5, "load.inertia": 5.0, "shaft.stiffness": 3000.0, "converter.bandwidth": 433.0,
        "converter.dead_time": 0.002})
    work = tuning_problem(build(drive, Wiring()), criterion("IAE"), TuneLimits())
    found = optimum(work)
    assert max_sensitivity(work.plant, found.settings)[0] <= 2.0 + 1e-6
    assert margins(work.plant, found.settings).gain_margin > 1.5


def test_gains_that_are_looked_at_know_of_a_carried_mass():
    """The same bus, its mass carried by the wheels at their radius or stated as their inertia."""
    bus = vehicle().with_values({
        "motor.inertia": 4.5, "wheels.inertia": 22.1, "wheels.carried_mass": 12350.0, "wheels.radius": 0.45,
        "shaft.ratio": 8.79, "shaft.stiffness": 1.52e6, "shaft.damping": 3600.0, "converter.bandwidth": 433.0})
    equivalent_bus = bus.with_values({"wheels.inertia": 22.1 + 12350.0 * 0.45**2, "wheels.carried_mass": 0.0})
    ranges = [tuning_problem(build(drive, Wiring()), criterion("IAE"), TuneLimits()).gains
              for drive in (bus, equivalent_bus)]
    assert ranges[0] == pytest.approx(ranges[1], rel=1e-9)


def test_lowest_sensitivity_is_the_border_of_the_feasible():
    work = tuning_problem(build(two_mass_plant("heavy"), Wiring()), criterion("IAE"), TuneLimits(1.01))
    lowest = lowest_sensitivity(work)

    def feasible(limit):
        trial = tuning_problem(work.loop, work.criterion, TuneLimits(limit))
        return any(len(allowed_gains(trial, *shape)) for shape in grid_shapes(trial))

    assert feasible(lowest) and not feasible(1.0 + 0.9 * (lowest - 1.0) / 1.0 - 0.01)


@pytest.mark.parametrize("name, weights", [("IEE", {}), ("IT17SE", {}), ("IAE", {"load_speed": 0.0}),
                                           ("IAE", {"motor_speed": -1.0})])
def test_what_is_no_criterion(name, weights):
    with pytest.raises(BadOption):
        criterion(name, weights)


@pytest.mark.parametrize("dead_time", ["exact", "zero"])
def test_states_and_response_of_a_torque_path_of_first_order(dead_time):
    drive = two_mass_plant("heavy").with_values({"converter.order": 1.0})
    wiring, s = Wiring(dead_time=dead_time), 1j * np.geomspace(1.0, 400.0, 50)
    a, b, c, d = torque_path(drive, wiring)
    states = np.array([c @ np.linalg.solve(x * np.eye(len(a)) - a, b) + d for x in s])
    np.testing.assert_allclose(states, path_response(drive, wiring, s), rtol=2e-4)


@pytest.mark.parametrize("seed", [0, 1, 3, 5, 6, 8, 9])
def test_first_peak_of_the_motor_whose_response_starts_flat(seed):
    """Its slope at the start is zero but for rounding; against a dense grid of the response."""
    rng = np.random.default_rng(seed)
    motor = 10.0 ** rng.uniform(-4, 2)
    load, w = motor * 10.0 ** rng.uniform(-0.7, 0.9), 2 * np.pi * 10.0 ** rng.uniform(0.5, 2)
    stiffness = w**2 * motor * load / (motor + load)
    drive = two_mass_plant("heavy").with_values({
        "motor.inertia": motor, "load.inertia": load, "shaft.stiffness": stiffness,
        "shaft.damping": 0.02 * stiffness / w, "motor.viscous": 0.05 * motor, "load.viscous": 0.05 * load,
        "converter.bandwidth": 10.0 ** rng.uniform(2.3, 3.5), "converter.dead_time": 10.0 ** rng.uniform(-4, -2.7)})
    loop, at = build(drive, Wiring(speed_filter=rng.choice([0, 1e-3]))), Settings((motor + load) * w / 10, 20 / w)
    speed = signals(loop, at, ("motor_speed",))["motor_speed"]
    assert speed.stable
    sampled = -speed.at(np.arange(0.0, 100 / w, 2e-3 / w))
    after_sign_change = np.flatnonzero(sampled < -1e-6 * sampled.max())
    first = sampled[:after_sign_change[0]].max() if len(after_sign_change) else sampled.max()
    assert factors(loop, at).motor.peak == pytest.approx(first, rel=1e-3)
