"""Criteria, sensitivity and search against computations that share no code with them."""

from __future__ import annotations

import os
import warnings
from itertools import pairwise
from pathlib import Path

import control
import numba
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import brentq

from drivetool.drive import Drive, one_body, two_mass
from drivetool.drive.chain import vehicle
from drivetool.drive.compile.code_folder import folder
from drivetool.errors import BadOption, BadParameters
from drivetool.tune.optimisation.criteria import criterion, signals, value, values
from drivetool.tune.optimisation.load_step_factors import factors
from drivetool.tune.optimisation.search import (
    Limits,
    allowed,
    check_finite,
    lowest_sensitivity,
    optimum,
    shapes_of,
    task,
)
from drivetool.tune.speed_loop import response
from drivetool.tune.speed_loop.loop import Settings, Wiring, build, path_response, torque_path
from drivetool.tune.speed_loop.sensitivity import max_sensitivity, plant
from drivetool.tune.speed_loop.stability_margins import margins
from tests.simulator import controllers, machine
from tests.simulator.simulate import simulate
from tests.tallfors import MOTORS, tandem, two_mass_plant

PRINTED = Wiring(dead_time="zero")
AT = {"light": Settings(1809, 0.02139), "medium": Settings(2641, 0.04097), "heavy": Settings(2270, 0.02458)}


def transfer_functions(drive: Drive, at: Settings):
    """(load speed from load torque, loop gain) of a two-mass drive, from its equations, by `control`."""
    v = {name: drive.value(name) for name in drive.quantities}
    s = control.tf("s")
    shaft = v["shaft.stiffness"] / s + v["shaft.damping"]
    motor = v["motor.inertia"] * s + v["motor.viscous"]
    load = v["load.inertia"] * s + v["load.viscous"]
    w, z, td = v["converter.bandwidth"], v["converter.damping"], v["converter.dead_time"]
    torque = w**2 * (1 - s * td / 2) / (s**2 + 2 * z * w * s + w**2) * at.gain * (1 + 1 / (s * at.integral_time))
    held = motor + torque  # what the motor's speed meets as a torque
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        to_load = control.minreal(-(held + shaft) / (load * (held + shaft) + held * shaft), 1e-6, verbose=False)
        mechanical = (load + shaft) / (motor * load + (motor + load) * shaft)
    return to_load, mechanical * torque


@pytest.mark.parametrize("name", AT)
def test_criteria_and_factors_against_a_fine_time_simulation(name):
    at, drive = AT[name], two_mass_plant(name)
    loop = build(drive, PRINTED)
    time = np.arange(0.0, 1.6, 2e-5)
    response = control.step_response(transfer_functions(drive, at)[0], time)
    e, h = np.asarray(response.outputs), time[1]
    load = factors(loop, at).load
    np.testing.assert_allclose(signals(loop, at, ["load_speed"])["load_speed"].at(time), e, atol=2e-5 * load.peak)
    drop = np.abs(np.concatenate([[0.0], np.cumsum((e[1:] + e[:-1]) / 2) * h])).max()
    sums = {"IAE": np.trapezoid(np.abs(e), dx=h), "IE": abs(np.trapezoid(e, dx=h)), "ISE": np.trapezoid(e**2, dx=h),
            "ITSE": np.trapezoid(time * e**2, dx=h), "IT6SE": np.trapezoid(time**6 * e**2, dx=h)}
    for kind, wanted in sums.items():
        assert value(loop, criterion(kind), at) == pytest.approx(wanted, rel=1e-4), kind
    assert load.impact_drop == pytest.approx(drop, rel=1e-4)
    assert load.peak == pytest.approx(np.abs(e).max(), rel=1e-5)
    assert load.overshoot == pytest.approx(100 * e.max() / -e.min(), abs=1e-3)
    assert load.settling_time == pytest.approx(time[np.flatnonzero(np.abs(e) > 0.05 * -e.min())[-1]], abs=3 * h)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1.0, 2.0])
def test_exact_dead_time_against_the_independent_simulator(order):
    """Its delay is a delay; its controller is discrete, whose hold is half a sample more of it."""
    h, at = 1e-4, Settings(1968.0, 0.0554)
    m = machine.Machine(inertia=(20, 80), viscous=(0.006, 0.024), stiffness=(224e3,), damping=(224.0,),
                        converter_bandwidth=433.0, converter_damping=np.inf if order == 1.0 else 0.69,
                        dead_time=0.002 - h / 2)
    n = 5000
    pi = controllers.SpeedPI(np.zeros(n), at.gain, at.gain / at.integral_time, h)
    run = simulate(m, np.zeros(n), h, controller=pi, load_torque=np.ones(n), rtol=1e-8, atol=1e-12)
    drive = two_mass_plant("heavy").with_values({"converter.order": order})
    found = signals(build(drive, Wiring()), at, ["motor_speed", "load_speed"])
    for body, modes in enumerate(found.values()):
        wanted = run.speeds[:, body]
        np.testing.assert_allclose(modes.at(run.time), wanted, atol=3e-3 * np.abs(wanted).max())


@pytest.mark.parametrize("name", AT)
def test_closed_forms_and_lyapunov(name):
    at, drive = AT[name], two_mass_plant(name)
    loop = build(drive, Wiring(speed_filter=0.003))
    found = factors(loop, at)
    assert found.motor.ie == pytest.approx(at.integral_time / at.gain, rel=1e-9)
    assert found.load.ie == pytest.approx(
        at.integral_time / at.gain + 1 / drive.value("shaft.stiffness"), rel=1e-9)
    a, row = loop.matrix(at), loop.rows["load_speed"]
    away = np.linalg.solve(a, loop.b)
    scale = np.sqrt(np.abs(np.diag(solve_continuous_lyapunov(a.T, -np.outer(row, row)))))
    scale[scale == 0.0] = 1.0
    b, c, x = a * scale[None, :].T / scale, row / scale, away * scale
    p = solve_continuous_lyapunov(b.T, -np.outer(c, c))
    assert found.load.ise == pytest.approx(x @ p @ x, rel=1e-6)
    for power, name in enumerate(("ITSE", "IT2SE"), 1):
        p = solve_continuous_lyapunov(b.T, -p)
        assert value(loop, criterion(name), at) == pytest.approx(power * x @ p @ x, rel=1e-5)


@pytest.mark.parametrize("name", AT)
def test_sensitivity_against_the_transfer_function(name):
    at, drive = AT[name], two_mass_plant(name)
    w = np.geomspace(1.0, 3e3, 400001)
    loop = transfer_functions(drive, at)[1](1j * w)
    found, where = max_sensitivity(plant(drive, PRINTED), at)
    assert found == pytest.approx((1 / np.abs(1 + loop)).max(), rel=1e-7)
    assert where == pytest.approx(w[np.argmin(np.abs(1 + loop))], rel=1e-3)


@pytest.mark.parametrize("name", AT)
def test_margins_are_where_the_eigenvalues_cross(name):
    at, drive = AT[name], two_mass_plant(name)
    found = margins(plant(drive, Wiring()), at)

    def slowest(gain=1.0, late=0.0):
        changed = drive.with_values({"converter.dead_time": 0.002 + late})
        matrix = build(changed, Wiring()).matrix(Settings(gain * at.gain, at.integral_time))
        return np.linalg.eigvals(matrix).real.max()

    assert found.gain_margin == pytest.approx(brentq(lambda g: slowest(gain=g), 1.0, 8.0), rel=1e-4)
    assert found.delay_margin == pytest.approx(brentq(lambda t: slowest(late=t), 0.0, 0.03), rel=1e-3)
    assert found.gain_reduction_margin == np.inf
    assert 20.0 < found.phase_margin < 60.0


def drives(least_load=0.2):
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
@given(drives(), st.floats(0.01, 0.5), st.floats(1.3, 3.0))
def test_allowed_gains_are_those_that_keep_the_limit(drive, integral_time, limit):
    loop = build(drive, Wiring())
    work = task(loop, criterion("IAE"), Limits(limit))
    ends = allowed(work, integral_time, 1.0)
    for gain in np.geomspace(*work.gains, 60):
        inside = any(low < gain < high for low, high in ends)
        near = any(abs(np.log(gain / end)) < 1e-2 for end in ends.ravel())
        at = Settings(float(gain), integral_time)
        stable = np.linalg.eigvals(loop.matrix(at)).real.max() < 0.0
        ms = max_sensitivity(work.plant, at)[0]
        if not near and abs(ms / limit - 1.0) > 1e-3:
            assert inside == (stable and ms < limit), (gain, ms, ends)


@pytest.mark.slow
@settings(max_examples=4, deadline=None)
@given(drives(), st.sampled_from(["IAE", "ISE", "IE"]))
def test_a_lower_limit_never_lowers_the_criterion(drive, kind):
    lowering(drive, kind)


@pytest.mark.fuzz
@settings(max_examples=25, deadline=None)
@given(drives(), st.sampled_from(["IAE", "ISE", "IE"]))
def test_a_lower_limit_never_lowers_the_criterion_at_length(drive, kind):
    lowering(drive, kind)


def lowering(drive, kind, limits=(2.4, 2.0, 1.7, 1.4), wiring=None):
    """The property: the criterion at ever lower limits."""
    loop = build(drive, wiring or Wiring())
    found = [optimum(task(loop, criterion(kind), Limits(limit))) for limit in limits]
    reached = [each.value for each in found]
    for wide, tight in pairwise(reached):
        assert tight >= wide * (1.0 - 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("dead_time", ["exact", "zero"])
@pytest.mark.parametrize("name, kind", [("heavy", "IT8SE"), ("light", "ITSE"), *(
    pytest.param(*case, marks=pytest.mark.long) for case in (("heavy", "ISE"), ("medium", "IE")))])
def test_a_limit_that_is_as_good_as_none_never_raises_the_criterion(name, kind, dead_time):
    lowering(two_mass_plant(name), kind, (np.inf, 1000.0, 100.0, 10.0, 2.0), Wiring(dead_time=dead_time))


@pytest.mark.fuzz
@settings(max_examples=25, deadline=None)
@given(drives(), st.sampled_from(["IAE", "ISE", "IE", "IT2SE", "IT8SE"]))
def test_a_limit_that_is_as_good_as_none_never_raises_the_criterion_at_length(drive, kind):
    lowering(drive, kind, (1000.0, 100.0, 10.0, 2.0))


@pytest.mark.parametrize("limit", [30.0, 1000.0, np.inf])
@pytest.mark.parametrize("name", AT)
def test_a_wide_limit_allows_the_gains_up_to_the_border_of_stability(name, limit):
    """The border by the eigenvalues; what is forbidden around it is narrower than the grid of frequencies."""
    drive, late = two_mass_plant(name), AT[name].integral_time
    loop = build(drive, Wiring())

    def slowest(gain):
        return np.linalg.eigvals(loop.matrix(Settings(gain, late))).real.max()

    border = brentq(slowest, AT[name].gain, 8.0 * AT[name].gain)
    (low, high), = allowed(task(loop, criterion("IAE"), Limits(limit)), late, 1.0)
    assert low < 0.1 * AT[name].gain and 0.9 / limit < 1.0 - high / border + 1e-3 < 1.5 / limit + 2e-3


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(drives(), st.sampled_from(["IAE", "ISE", "IT2SE"]))
def test_no_point_of_a_plane_is_better_than_the_optimum(drive, kind):
    dense_plane(drive, kind, 45)


@pytest.mark.fuzz
@settings(max_examples=12, deadline=None)
@given(drives(), st.sampled_from(["IAE", "ISE", "IT2SE"]))
def test_no_point_of_a_dense_plane_is_better_than_the_optimum(drive, kind):
    dense_plane(drive, kind, 80)


def dense_plane(drive, kind, points):
    """Brute force over integral time and gain."""
    loop = build(drive, Wiring())
    work = task(loop, criterion(kind), Limits(1.8))
    found = optimum(work)
    assert max_sensitivity(work.plant, found.settings)[0] <= 1.8 + 1e-6
    times = np.geomspace(*work.times, points)
    gains = np.geomspace(found.settings.gain / 30, found.settings.gain * 10, points)
    ti, kp = (grid.ravel() for grid in np.meshgrid(times, gains))
    cost = values(loop, work.criterion, kp, ti, np.ones_like(ti))
    better = np.flatnonzero(cost < found.value * (1.0 - 1e-5))
    for k in better:
        assert max_sensitivity(work.plant, Settings(kp[k], ti[k]))[0] > 1.8


@pytest.mark.slow
def test_optimum_repeats_to_the_last_digit():
    loop = build(tandem("G1"), Wiring("mimo", MOTORS, dead_time="zero"))
    first, again = (optimum(task(loop, criterion("IAE"), Limits())) for _ in range(2))
    assert first == again


@pytest.mark.slow
def test_a_weight_on_the_torque_trades_speed_for_torque():
    loop = build(two_mass_plant("medium"), Wiring())
    torque, speed = criterion("IAE", {"load_speed": 0.0, "motor_torque": 1.0}), criterion("IAE")
    plain, calm = (optimum(task(loop, wanted, Limits())).settings
                   for wanted in (speed, criterion("IAE", {"motor_torque": 5e-3})))
    assert value(loop, torque, calm) < 0.99 * value(loop, torque, plain)
    assert value(loop, speed, calm) > 1.001 * value(loop, speed, plain)


@pytest.mark.slow
def test_rigid_drive_and_filter_without_converter():
    rigid = one_body().with_values({"motor.inertia": 2.0, "motor.viscous": 0.01})
    wiring = Wiring(speed_filter=0.004)
    work = task(build(rigid, wiring), criterion("IAE"), Limits())
    found = optimum(work)
    assert max_sensitivity(work.plant, found.settings)[0] <= 2.0 + 1e-6
    assert found.settings.gain == pytest.approx(2.0 / 0.004, rel=0.9)
    assert factors(work.loop, found.settings).torque_overshoot["motor"] > 5.0
    with pytest.raises(BadParameters, match="any gain would be stable"):
        check_finite(task(build(rigid, Wiring()), criterion("IAE"), Limits()))


@pytest.mark.slow
def test_a_drive_without_damping_or_friction():
    drive = two_mass().with_values({
        "motor.inertia": 0.5, "load.inertia": 5.0, "shaft.stiffness": 3000.0, "converter.bandwidth": 433.0,
        "converter.dead_time": 0.002})
    work = task(build(drive, Wiring()), criterion("IAE"), Limits())
    found = optimum(work)
    assert max_sensitivity(work.plant, found.settings)[0] <= 2.0 + 1e-6
    assert margins(work.plant, found.settings).gain_margin > 1.5


def test_gains_that_are_looked_at_know_of_a_carried_mass():
    """The same bus, its mass carried by the wheels at their radius or said as their inertia."""
    bus = vehicle().with_values({
        "motor.inertia": 4.5, "wheels.inertia": 22.1, "wheels.carried_mass": 12350.0, "wheels.radius": 0.45,
        "shaft.ratio": 8.79, "shaft.stiffness": 1.52e6, "shaft.damping": 3600.0, "converter.bandwidth": 433.0})
    same = bus.with_values({"wheels.inertia": 22.1 + 12350.0 * 0.45**2, "wheels.carried_mass": 0.0})
    ranges = [task(build(drive, Wiring()), criterion("IAE"), Limits()).gains for drive in (bus, same)]
    assert ranges[0] == pytest.approx(ranges[1], rel=1e-9)


def test_lowest_sensitivity_is_the_border_of_the_feasible():
    work = task(build(two_mass_plant("heavy"), Wiring()), criterion("IAE"), Limits(1.01))
    lowest = lowest_sensitivity(work)

    def feasible(limit):
        trial = task(work.loop, work.criterion, Limits(limit))
        return any(len(allowed(trial, *shape)) for shape in shapes_of(trial))

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
    seen = -speed.at(np.arange(0.0, 100 / w, 2e-3 / w))
    turned = np.flatnonzero(seen < -1e-6 * seen.max())
    first = seen[:turned[0]].max() if len(turned) else seen.max()
    assert factors(loop, at).motor.peak == pytest.approx(first, rel=1e-3)


def test_compiled_code_is_kept_in_the_kernels_folder():
    """Numba's own places may be read-only, which it takes for an error, or open to others."""
    for part in (response.value, response.absolute_integrals):
        assert Path(part.stats.cache_path).parent == folder()
    assert os.environ.get("NUMBA_CACHE_DIR", "") == numba.config.CACHE_DIR
