"""Polynomial structures: exact gradients, agreement with SciPy and closed forms, intervals, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import signal
from scipy.linalg import eigh
from scipy.optimize import least_squares

from drivetool.drive import one_body, resonances, two_mass
from drivetool.drive.chain import three_mass
from drivetool.errors import BadOption, NotEnoughData
from drivetool.identify.blackbox.estimator import blackbox
from drivetool.identify.polynomial.cauer import chain_of
from drivetool.identify.polynomial.pem_figures import figures_of
from drivetool.identify.polynomial.pem_fit import fit_structure
from drivetool.identify.polynomial.pem_model import KINDS, Prediction, Stretch, Structure
from drivetool.identify.polynomial.structures import polynomial_blackbox
from drivetool.identify.setup.options import Options
from tests.recover import experiment
from tests.simulator.experiments import multisine
from tests.simulator.linear import equations
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

STEP = 1e-3
RIG = Machine((0.6, 5.2), (0.8, 0.4), stiffness=(3300.0,), damping=(3.1,))
ROBOT = Machine((3.9e-4, 12.2, 6.3), (8e-4, 2.0, 1.0), stiffness=(1.9e5, 1.5e5), damping=(168.0, 12.0),
                ratio=(118.0, 1.0))


def record(machine, seed, n=6000, noise=0.01, torque_noise=0.0, top=40.0, amplitude=0.5, step=STEP):
    u = multisine(np.arange(0.7, top, 1.3), amplitude, n * step, step, 5)
    run = simulate_linear(machine, u, step, None, white_noise(n, torque_noise, 3 * seed))
    return experiment(u, run.speeds[:, 0] + white_noise(n, noise, 3 * seed + 1), step=step)


def stretches(e, *cuts):
    u, y = e.signals["motor_torque"], e.signals["motor_speed"]
    return [Stretch(a, b) for a, b in zip(np.split(u, cuts), np.split(y, cuts), strict=True)]


# the machinery


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.sampled_from(KINDS), st.integers(1, 4), st.integers(0, 3), st.integers(0, 1), st.integers(0, 10**6))
def test_gradients_are_exact(kind, order, noise, extra, seed):
    """Against central differences at any coefficients that keep the predictor stable."""
    rng = np.random.default_rng(seed)
    s = Structure(kind, order, noise, extra, rate=0.3)
    stretch = Stretch(rng.standard_normal(120), rng.standard_normal(120))
    k = len(s.names)
    problem = Prediction(s, (stretch,), np.ones(k))
    values = 0.2 * rng.standard_normal(k)
    for letter in "AFC" if kind == "innovations" else "AF":
        if s.size(letter):
            values[s.part(letter)] = np.poly(-rng.uniform(0.2, 2.0, order))[1:]
    start = 0.3 * rng.standard_normal(order + 1)
    errors, table = problem.jacobian(values, start, stretch)
    np.testing.assert_array_equal(errors, problem.errors(values, start, stretch))
    both = np.concatenate([values, start])
    for j in range(len(both)):
        d = np.zeros_like(both)
        d[j] = 1e-6
        up, down = (problem.errors((both + x)[:k], (both + x)[k:], stretch) for x in (d, -d))
        np.testing.assert_allclose(table[:, j], (up - down) / 2e-6, rtol=1e-4,
                                   atol=1e-6 * (1.0 + np.abs(table[:, j]).max()))


def test_output_error_is_that_of_scipy():
    """The same cost as SciPy's least squares over plain coefficients, from the truth on."""
    b, a = np.array([0.0, 0.3, -0.45, 0.28]), np.poly([0.97, 0.9 * np.exp(0.6j), 0.9 * np.exp(-0.6j)]).real
    rng = np.random.default_rng(1)
    u = rng.standard_normal(3000)
    y = signal.lfilter(b, a, u) + 0.3 * rng.standard_normal(3000)
    u, y = u - u.mean(), y - y.mean()
    fit = fit_structure([Stretch(u, y)], Structure("oe", 3))

    def residual(x):
        v, pulse = u - x[6], np.zeros(3000)
        pulse[:3] = x[7:]
        bottom = np.concatenate([[1.0], x[3:6]])
        return signal.lfilter(np.concatenate([[0.0], x[:3]]), bottom, v) + signal.lfilter([1.0], bottom, pulse) - y

    best = least_squares(residual, np.concatenate([b[1:], a[1:], np.zeros(4)]), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert fit.solution.cost == pytest.approx(2.0 * best.cost, rel=1e-8)
    np.testing.assert_allclose(fit.structure.polynomial("B", fit.values)[1:], best.x[:3], atol=1e-4)
    np.testing.assert_allclose(fit.structure.polynomial("F", fit.values)[1:], best.x[3:6], atol=1e-4)
    full = np.linalg.inv(best.jac.T @ best.jac) * 2.0 * best.cost / (3000 - 10)
    stds = [np.sqrt(full[j, j]) for j in range(6)]
    s = fit.structure
    for letter, part in (("B", stds[:3]), ("F", stds[3:])):
        table = s.basis(letter)[1]
        mine = np.sqrt(np.diag(table @ fit.covariance[s.part(letter), s.part(letter)] @ table.T))[1:]
        np.testing.assert_allclose(mine, part, rtol=1e-3)


def test_arx_is_the_linear_regression():
    rng = np.random.default_rng(2)
    u = rng.standard_normal(2000)
    y = signal.lfilter([0.0, 1.0, 0.5], [1.0, -1.2, 0.5], u) + signal.lfilter(
        [0.2], [1.0, -1.2, 0.5], rng.standard_normal(2000))
    fit = fit_structure([Stretch(u, y)], Structure("arx", 2))
    u, y = u - u.mean(), y - y.mean()
    # The start values and u0 take the first two samples and the mean: regress the rest with a constant.
    phi = np.column_stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2], np.ones(1998)])
    expected = np.linalg.lstsq(phi, y[2:], rcond=None)[0]
    s = fit.structure
    np.testing.assert_allclose(s.polynomial("A", fit.values)[1:], expected[:2], atol=1e-8)
    np.testing.assert_allclose(s.polynomial("B", fit.values)[1:], expected[2:4], atol=1e-8)
    assert fit.white


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.lists(st.floats(0.1, 10.0), min_size=1, max_size=5), st.integers(0, 1000))
def test_continued_fraction_gives_the_chain_back(inertias, seed):
    n = len(inertias)
    k = np.random.default_rng(seed).uniform(10.0, 1000.0, n - 1)
    stiffness = np.diag(np.r_[k, 0.0]) + np.diag(np.r_[0.0, k]) - np.diag(k, 1) - np.diag(k, -1)
    p = np.sqrt(np.maximum(eigh(stiffness, np.diag(inertias), eigvals_only=True)[1:], 0.0))
    z = np.sqrt(eigh(stiffness[1:, 1:], np.diag(inertias[1:]), eigvals_only=True)) if n > 1 else []
    j, found = chain_of(sum(inertias), z, p)
    np.testing.assert_allclose(j, inertias, rtol=1e-5)
    np.testing.assert_allclose(found, k, rtol=1e-5)


def test_no_chain_where_anti_resonance_and_resonance_do_not_alternate():
    assert chain_of(1.0, [3.0], [2.0]) == ((), ()) and chain_of(-1.0, [], []) == ((), ())


# results


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["oe", "bj", "innovations"])
def test_a_chain_of_three_is_found_with_intervals_that_hold(kind):
    """All ten parameters of the linear robot axis, and the anti-resonance of the reference page."""
    e = record(ROBOT, 1, n=12_000, noise=0.05, top=60.0, amplitude=0.3, step=5e-4)
    estimate = polynomial_blackbox([e], three_mass().with_values({"shaft.ratio": 118.0}),
                                   Options(structure=kind, order=5))
    truth = dict(zip((f"{b}.inertia" for b in ("motor", "gear", "arm")), ROBOT.inertia, strict=True))
    truth |= {"shaft.stiffness": 1.9e5, "shaft2.stiffness": 1.5e5, "shaft.damping": 168.0, "shaft2.damping": 12.0}
    lines = {p.name: p for p in estimate.parameters}
    for name, value in truth.items():
        p = lines[name]
        assert abs(p.value - value) < 4.0 * p.std < 0.05 * value, name
    square = [estimate.drive.values[n] - truth[n] for n in truth]
    index = [estimate.covariance.names.index(n) for n in truth]
    assert square @ np.linalg.solve(estimate.covariance.matrix[np.ix_(index, index)], square) < 24.3  # 99.9 % of 7
    anti_resonance = estimate.details["notches"][0]["rad_s"]
    # |s| of the damped zero; the undamped 92.8 of the reference page lies 0.1 % off.
    held = next(m for m in resonances(estimate.drive) if m.kind == "anti-resonance").frequency_hz * 2 * np.pi
    assert held == pytest.approx(92.79, abs=0.02)
    assert abs(anti_resonance["value"] - 92.867) < 4 * anti_resonance["std"] + 1e-3
    own = estimate.details["drive_rad_s"]["notch 1"]
    a = equations(ROBOT)[0][1:5, 1:5]
    exact = min(abs(s) for s in np.linalg.eigvals(a) if s.imag > 0.0)
    assert abs(own["value"] - exact) < 4.0 * own["std"] < 0.02
    counted = {"oe": 0, "bj": 4, "innovations": 5}[kind]
    assert estimate.fit["noise_parameters"] == counted and estimate.fit["parameters"] == 10 + counted


def test_order_by_held_out_score():
    e = record(RIG, 3)
    estimate = blackbox([e], two_mass(), Options(structure="oe"))
    assert estimate.details["order"] == 3
    scores = {row["order"]: row["held_out_simulation_fit_percent"] for row in estimate.details["orders"]}
    assert scores[3] > scores[1] + 5.0 and scores[7] < scores[3] + 0.5
    advice = next(f for f in estimate.findings if f.code == "model-order")
    assert advice.severity == "note" and advice.evidence["bodies"] == 2
    assert advice.evidence["held_out_fit_percent_2"] == pytest.approx(scores[3])


@pytest.mark.slow
def test_three_bodies_are_advised_where_two_do_not_suffice():
    e = record(ROBOT, 1, noise=0.05, top=60.0, amplitude=0.3)
    estimate = blackbox([e], two_mass(), Options(structure="oe"))
    advice = next(f for f in estimate.findings if f.code == "model-order")
    assert advice.severity == "warning" and advice.evidence["bodies"] == 3
    assert advice.evidence["held_out_fit_percent_3"] > advice.evidence["held_out_fit_percent_2"] + 10.0
    assert blackbox([e], three_mass(), Options(structure="oe")).findings[0].severity == "note"


def test_several_stretches_with_their_own_start_and_offset():
    """Two pieces of one record that begin in motion and on different torque: one model."""
    whole = record(RIG, 4, n=8000)
    one, two_ = whole.between(0.0, 3.9), whole.between(4.2, 8.0)
    moved = {"motor_torque": two_.signals["motor_torque"] + 7.0,
             "motor_speed": two_.signals["motor_speed"] + 7.0 / 1.2}
    two_ = type(two_)(two_.name, two_.sha256, two_.step, 0.0, moved, two_.segments)
    estimate = polynomial_blackbox([one, two_], two_mass(), Options(structure="oe", order=3))
    for name, value in (("motor.inertia", 0.6), ("load.inertia", 5.2), ("shaft.stiffness", 3300.0)):
        p = next(p for p in estimate.parameters if p.name == name)
        assert abs(p.value - value) < 4.0 * p.std < 0.1 * value


def test_an_angle_serves_as_well():
    n = 8000
    u = multisine(np.arange(0.7, 40.0, 1.3), 0.5, n * STEP, STEP, 5)
    run = simulate_linear(RIG, u, STEP)
    e = experiment(u, run.angles[:, 0])
    angle = run.angles[:, 0] + white_noise(n, 1e-6, 3)
    e = type(e)(e.name, e.sha256, e.step, e.start, {"motor_torque": u, "motor_angle": angle}, e.segments)
    estimate = polynomial_blackbox([e], two_mass(), Options(structure="bj", order=3, noise_order=2))
    assert estimate.drive.values["load.inertia"] == pytest.approx(5.2, rel=0.01)
    assert estimate.details["notches"][0]["hz"]["value"] == pytest.approx(4.009, abs=0.02)


@pytest.mark.slow
def test_delta_method_agrees_with_the_scatter_of_many_fits():
    """Anti-resonance, resonance and response: stated std against that over 30 records."""
    found, stated = [], []
    truth = figures_of(fit_structure(stretches(record(RIG, 0, noise=1e-7)), Structure("oe", 3)), STEP)
    hz = np.array([2.0, 4.5, 11.0, 14.0])
    for seed in range(30):
        f = figures_of(fit_structure(stretches(record(RIG, 10 + seed, n=3000)), Structure("oe", 3)), STEP)
        g, std = f.response(hz)
        found.append([f.notches[0].rad_s, f.resonances[0].rad_s, *np.abs(g)])
        stated.append([f.std(f.notches[0].d_rad_s), f.std(f.resonances[0].d_rad_s), *std])
    expected = np.array([truth.notches[0].rad_s, truth.resonances[0].rad_s, *np.abs(truth.response(hz)[0])])
    off = (np.array(found) - expected) / np.array(stated)
    assert np.all(np.abs(off.std(axis=0) - 1.0) < 0.35)
    assert np.mean(np.abs(off) < 1.96) > 0.9


@pytest.mark.parametrize("weighting", ["variance", "coherence"])
def test_output_error_in_the_frequency_domain(weighting):
    """Third order, both weightings: the truth within the intervals, and near the fit in the time domain."""
    u = np.tile(multisine(np.arange(1.0, 40.0, 0.5), 0.5, 2.0, STEP, 3), 12)
    run = simulate_linear(RIG, u, STEP)
    e = experiment(u, run.speeds[:, 0] + white_noise(len(u), 0.02, 1))
    options = Options(structure="oe", order=3, criterion="frequency", weighting=weighting)
    estimate = polynomial_blackbox([e], two_mass(), options)
    assert estimate.fit["chi_square_per_degree"] < 2.0 and estimate.details["weighting"] == weighting
    for name, value in (("motor.inertia", 0.6), ("load.inertia", 5.2), ("shaft.stiffness", 3300.0)):
        p = next(p for p in estimate.parameters if p.name == name)
        assert abs(p.value - value) < 4.0 * p.std < 0.2 * value, name
    with pytest.raises(BadOption, match="structure oe"):
        polynomial_blackbox([e], two_mass(), Options(structure="bj", order=3, criterion="frequency"))


# closed loop


def closed_loop(seed, gain=6.0, n=12_000, colour=0.97):
    """A rigid body under a P controller; a slow disturbance of its speed that the controller answers."""
    rng = np.random.default_rng(seed)
    e = signal.lfilter([0.15], [1.0, -colour], rng.standard_normal(n))
    r = np.repeat(rng.choice([-1.0, 1.0], n // 50), 50)
    b = STEP / 0.05
    # y = g u + e, g = b q^-1/(1 - q^-1), u = gain (r - y): closed forms instead of a simulation.
    y = signal.lfilter([0.0, gain * b], [1.0, gain * b - 1.0], r) + signal.lfilter(
        [1.0, -1.0], [1.0, gain * b - 1.0], e)
    return experiment(gain * (r - y), y), b


@pytest.mark.slow
def test_in_closed_loop_the_right_noise_model_is_unbiased_and_its_lack_is_found():
    first = {}
    for kind in ("oe", "bj"):
        off = []
        for seed in range(4):
            e, b = closed_loop(seed)
            estimate = polynomial_blackbox([e], one_body(), Options(structure=kind, order=1, noise_order=1))
            off.append(estimate.details["polynomials_over_1/q"]["B"][1] / b - 1.0)
        first[kind] = np.mean(off), np.std(off) / np.sqrt(4), {f.code for f in estimate.findings}
    assert abs(first["bj"][0]) < 4 * first["bj"][1] + 2e-3 and "residual-correlated" not in first["bj"][2]
    assert abs(first["oe"][0]) > 5 * abs(first["bj"][0]) + 5 * first["oe"][1]
    assert "residual-correlated" in first["oe"][2]


# findings on the residual and on the order


@pytest.mark.parametrize(("kind", "torque_noise", "code"), [
    ("oe", 0.3, "residual-correlated"), ("arx", 0.3, "residual-correlated"), ("innovations", 0.3, None),
    ("oe", 0.0, None)])
def test_a_coloured_residual_is_reported_for_the_structure_that_it_biases(kind, torque_noise, code):
    """Torque noise passes through the drive: only the innovations form has its colour."""
    found = polynomial_blackbox([record(RIG, 6, torque_noise=torque_noise)], two_mass(),
                                Options(structure=kind, order=3))
    said = {f.code for f in found.findings} & {"residual-correlated"}
    assert said == ({code} if code else set())


@pytest.mark.parametrize(("order", "said"), [(1, True), (3, False)])
def test_an_order_that_has_no_chain_gives_no_parameters(order, said):
    found = polynomial_blackbox([record(RIG, 6, n=2000)], two_mass(), Options(structure="oe", order=order))
    assert ("no-conversion" in {f.code for f in found.findings}) == said
    assert ("shaft.stiffness" in found.drive.values) != said


# refusals


def test_too_high_an_order_is_found():
    estimate = polynomial_blackbox([record(RIG, 6)], two_mass(), Options(structure="oe", order=5))
    assert "model-order" in {f.code for f in estimate.findings}


def test_an_unstable_estimate_is_reported_and_not_simulated():
    rng, n = np.random.default_rng(1), 3000
    u = rng.standard_normal(n)
    # An unstable body under a controller: y+ = 1.05 y + u + e, u = r - 0.5 y.
    y = np.zeros(n)
    for k in range(n - 1):
        u[k] -= 0.5 * y[k]
        y[k + 1] = 1.05 * y[k] + u[k] + 0.1 * rng.standard_normal()
    estimate = polynomial_blackbox([experiment(u, y)], one_body(), Options(structure="arx", order=1))
    assert estimate.fit["simulation_fit_percent"] is None and estimate.details["unstable"]
    assert [f.code for f in estimate.findings if f.severity == "failure"] == ["unstable-estimate"]


@pytest.mark.parametrize(("options", "error", "words"), [
    (Options(structure="ols"), BadOption, "structure"),
    (Options(structure="oe", order=0), BadOption, "order"),
    (Options(structure="oe", order=40), NotEnoughData, "order 40"),
])
def test_impossible_options_are_refused(options, error, words):
    with pytest.raises(error, match=words):
        polynomial_blackbox([record(RIG, 1, n=90)], two_mass(), options)


def test_nothing_that_moves():
    with pytest.raises(NotEnoughData, match="torque that changes"):
        polynomial_blackbox([experiment(np.ones(500), np.random.default_rng(1).standard_normal(500))], two_mass(),
                   Options(structure="oe", order=3))
