"""Normal equations, missing outputs, and the Kalman pass against a textbook filter in NumPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, toeplitz

from drivetool.drive.simulation.simulate import CHUNK_SAMPLES, ObserverGains, Trace
from tests.drive.test_kernel import STEP, changed, drive_of, levels, plant_of, start_of
from tests.simulator.linear import equations
from tests.simulator.machine import Machine, at_rest, machine_by_seed
from tests.simulator.simulate import simulate_linear

OUTPUTS = ("motor_speed", "shaft_torque")
SPEEDS = ("motor_speed", "load_speed")  # both are states: another path through the kernel
FREE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "motor.coulomb")
RIG = Machine((0.6, 5.2), (0.8, 0.3), (5.0, 0.0), (0.0, 8.0), (3300.0,), (3.1,), (0.01,), rated_torque=200.0)


def record(machine, n, seed, ny=2, holes=0.1):
    """A trace with noise for measurements, some of them missing."""
    rng = np.random.default_rng(seed)
    y = rng.standard_normal((n, ny)) * [1.0, 20.0, 0.1][:ny]
    y[rng.uniform(size=y.shape) < holes] = np.nan
    return Trace(levels(machine, n, seed)[:, None], y, STEP)


def random_gains(n, seed):
    """An observer that changes from sample to sample."""
    rng = np.random.default_rng(seed)
    return ObserverGains(rng.uniform(-0.02, 0.02, (n, 2, 3)) * [1.0, 1.0, 1e-3], rng.uniform(0.5, 2.0, (n, 2)))


@pytest.mark.parametrize("n", [100, CHUNK_SAMPLES, 2 * CHUNK_SAMPLES + 17])
@pytest.mark.parametrize("observed", [False, True])
def test_normal_equations_are_the_jacobian_squared(n, observed):
    plant, trace = plant_of(drive_of(RIG), OUTPUTS, FREE), record(RIG, n, 1)
    gains, start = random_gains(n, 2) if observed else None, np.array([1.0, 0.9, 0.012])
    out, jac = plant.jacobian(trace, start, gains)
    whole = jac.reshape(-1, plant.system.ns)
    total = plant.normal_equations(trace, start, gains)
    np.testing.assert_allclose(total, whole.T @ whole, rtol=1e-11, atol=1e-11 * np.abs(total).max())
    residual = (out - trace.outputs) * (gains.weight if observed else 1.0)
    np.testing.assert_allclose(jac[:, :, -1], np.where(np.isnan(residual), 0.0, residual), atol=1e-9)


def test_weights_without_an_observer():
    plant, trace, start = plant_of(drive_of(RIG), OUTPUTS, FREE), record(RIG, 400, 1), np.zeros(3)
    weight = np.array([2.0, 0.1])
    whole = (plant.jacobian(trace, start)[1] * weight[:, None]).reshape(-1, plant.system.ns)
    total = plant.normal_equations(trace, start, weight=weight)
    np.testing.assert_allclose(total, whole.T @ whole, rtol=1e-10, atol=1e-10 * np.abs(total).max())


@pytest.mark.parametrize("outputs", [OUTPUTS, SPEEDS])
@pytest.mark.parametrize("observed", [False, True])
def test_an_output_that_is_not_measured_is_skipped(observed, outputs):
    plant, trace = plant_of(drive_of(RIG), outputs, FREE), record(RIG, 300, 3, holes=0.3)
    gains = random_gains(300, 4) if observed else None
    out, jac = plant.jacobian(trace, np.zeros(3), gains)
    assert np.all(np.isfinite(out)) and np.all(np.isfinite(jac))
    assert np.all(jac[np.isnan(trace.outputs)] == 0.0)
    nothing = Trace(trace.inputs, np.full((300, 2), np.nan), STEP)
    free = plant.outputs(nothing, np.zeros(3), gains)
    np.testing.assert_array_equal(free, plant.outputs(nothing, np.zeros(3)))


def textbook(machine, outputs, trace, noise, extra, memory, sensor, covariance, start):
    """Joint measurement update, Joseph form. Returns (-2 log likelihood, predictions, end state)."""
    a, b, c = equations(machine)
    keep = [i for i in range(len(a)) if i != 2 * machine.bodies - 1]  # no angle
    a, b, c = a[np.ix_(keep, keep)], b[keep], c[:, keep]
    m = len(a)
    big = np.zeros((m + 3, m + 3))  # state, disturbance, command, 1
    big[:m, :m], big[:m, m], big[:m, m + 1], big[:m, m + 2] = a, b[:, 1], b[:, 0], b[:, 3]
    step = expm(big * trace.step)
    f, g = step[:m + 1, :m + 1].copy(), step[:m + 1, m + 1:]
    n = m + 1 if memory is not None else m
    f, g = f[:n, :n], g[:n]
    if memory is not None:
        f[m] *= memory
    h = np.zeros((2, n))
    h[0, 0], h[1, :m] = 1.0, c[0] if outputs == OUTPUTS else np.eye(m)[1]
    x, p, value, seen = start.copy(), covariance.copy(), 0.0, []
    for u, y in zip(trace.inputs[:, 0], trace.outputs, strict=True):
        seen.append(h @ x)
        good = np.isfinite(y)
        if good.any():
            hg, r = h[good], np.diag(sensor[good])
            s = hg @ p @ hg.T + r
            e = y[good] - hg @ x
            value += np.linalg.slogdet(s)[1] + e @ np.linalg.solve(s, e)
            k = p @ hg.T @ np.linalg.inv(s)
            x = x + k @ e
            left = np.eye(n) - k @ hg
            p = left @ p @ left.T + k @ r @ k.T
        x = f @ x + g @ [u, 1.0]
        p = f @ p @ f.T + noise * np.outer(g[:, 0], g[:, 0]) + np.diag(extra)
    return value, np.array(seen), x


@pytest.mark.parametrize("memory", [None, 0.95])
@pytest.mark.parametrize("lag", [None, 300.0])
@pytest.mark.parametrize("outputs", [OUTPUTS, SPEEDS])
def test_kalman_pass_is_the_textbook_filter(memory, lag, outputs):
    machine = machine_by_seed(2, converter_bandwidth=lag)
    plant = plant_of(drive_of(machine), outputs, memory=memory)
    nx, trace = plant.system.nx, record(machine, 400, 5)
    rng = np.random.default_rng(6)
    start, covariance = rng.standard_normal(nx) * 0.1, np.diag(rng.uniform(0.1, 1.0, nx)) * 1e-2
    sensor, extra = np.array([1.0, 30.0]), rng.uniform(0.0, 1e-4, nx)
    found = plant.filter(trace, start, sensor, 4.0, extra, covariance)
    value, seen, _ = textbook(machine, outputs, trace, 4.0, extra, memory, sensor, covariance, start)
    known = np.isfinite(trace.outputs)
    ours = np.log(found.variance[known]).sum() + (found.innovations[known]**2 / found.variance[known]).sum()
    assert ours == pytest.approx(value, rel=1e-10)
    first = known[:, 0]
    np.testing.assert_allclose((trace.outputs - found.innovations)[first, 0], seen[first, 0], atol=1e-10)
    assert np.all(np.isnan(found.innovations) == ~known)


@pytest.mark.parametrize("machine", [machine_by_seed(2), RIG, changed(RIG, dead_time=1.4 * STEP)],
                         ids=["linear", "gap and friction", "dead time"])
@pytest.mark.parametrize("outputs", [OUTPUTS, SPEEDS])
def test_frozen_gains_replay_the_filter(machine, outputs):
    plant, trace = plant_of(drive_of(machine), outputs), record(machine, 500, 7)
    found = plant.filter(trace, np.zeros(3), np.array([1.0, 30.0]), 4.0, np.full(3, 1e-6))
    again = plant.outputs(trace, np.zeros(3), found.gains)
    known = np.isfinite(trace.outputs)
    np.testing.assert_allclose((trace.outputs - again)[known], found.innovations[known], atol=1e-10)
    short = plant.filter(trace, np.zeros(3), np.array([1.0, 30.0]), 4.0, np.full(3, 1e-6), keep=False)
    np.testing.assert_array_equal(short.variance, found.variance)


@pytest.mark.parametrize("coulomb", [(0.0, 0.0), (5.0, 4.0)], ids=["gap", "gap and friction"])
def test_an_observed_pass_is_the_same_whether_its_states_are_kept(coulomb):
    """Also across several hundred events, with event-free loops between them."""
    machine = changed(RIG, coulomb=coulomb)
    plant, trace = plant_of(drive_of(machine), SPEEDS), record(machine, 2000, 9)
    kept, short = (plant.simulate(trace, np.zeros(3), random_gains(2000, 3), keep=keep) for keep in (True, False))
    assert kept[2] == short[2] > 50
    np.testing.assert_allclose(short[0], kept[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("slow", [0.1, 1.0])
def test_torque_noise_that_is_weak_where_it_is_slow_is_the_joint_normal_distribution(slow):
    """Likelihood of a short record by its full covariance, from impulse responses of the other simulator."""
    machine, n, memory, white, sensor = replace(RIG, coulomb=(0.0, 0.0), half_gap=(0.0,)), 60, 0.8, 9.0, 1e-4
    torque, begin = levels(machine, n, 5), at_rest(machine)
    calm, moved = (simulate_linear(machine, torque, STEP, begin, size * np.eye(n)[0]).speeds[:n, 0]
                   for size in (0.0, 1.0))
    answer = toeplitz(moved - calm, np.zeros(n))
    noise_gain = (slow - 1.0) * (1.0 - memory)
    shape = toeplitz(np.append(1.0, noise_gain * memory ** np.arange(n - 1)), np.eye(n)[0])
    before = np.outer(*[memory ** np.arange(n)] * 2) * noise_gain**2 / (1.0 - memory**2)
    whole = white * answer @ (shape @ shape.T + before) @ answer.T + sensor * np.eye(n)
    error = np.random.default_rng(3).normal(0.0, 0.02, n)
    plant = plant_of(drive_of(machine), ("motor_speed",), memory=memory)
    start, last = np.append(start_of(machine, plant)[:3], 0.0), np.eye(4)[3]
    passed = plant.filter(Trace(torque[:, None], (calm + error)[:, None], STEP), start, np.array([sensor]), white,
                          np.zeros(4), np.diag(last * white * noise_gain**2 / (1.0 - memory**2)),
                          noise_input=last * noise_gain)
    found = np.sum(passed.innovations**2 / passed.variance + np.log(passed.variance))
    wanted = error @ np.linalg.solve(whole, error) + np.linalg.slogdet(whole)[1]
    assert found == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("fraction", [0.0, 0.4, 0.9])
def test_torque_noise_acts_over_the_whole_sample_whatever_the_dead_time(fraction):
    """Where the dead time cuts a sample in two, the noise of the sample is still that of all of it."""
    machine = machine_by_seed(2)
    whole, cut = (plant_of(drive_of(changed(machine, dead_time=t * STEP)), OUTPUTS) for t in (0.0, fraction))
    trace = record(machine, 50, 8)
    args = np.zeros(3), np.array([1.0, 30.0]), 4.0, np.zeros(3)
    expected = whole.filter(trace, *args).variance
    np.testing.assert_allclose(cut.filter(trace, *args).variance, expected, rtol=1e-10)


def test_covariance_is_carried_across_events_like_the_sensitivities():
    """With a tiny start covariance and no noise, the variance is that of the linearised outputs."""
    machine = changed(RIG, coulomb=(5.0, 4.0), viscous=(3.0, 1.0))
    n, tiny, start = 600, 1e-10, np.array([0.5, 0.3, 0.012])
    plant, full = (plant_of(drive_of(machine), OUTPUTS[:1], free) for free in ((), FREE))
    torque = levels(machine, n, 4, share=0.1)[:, None]
    out, _ = full.jacobian(Trace(torque, np.full((n, 1), np.nan), STEP), start)
    trace = Trace(torque, out, STEP)
    assert plant.simulate(trace, start)[2] > 20
    found = plant.filter(trace, start, np.ones(1), 0.0, np.zeros(3), np.diag([tiny] * 3))
    columns = full.jacobian(trace, start)[1][:, 0, full.system.nq:full.system.nq + 3]
    expected = tiny * np.sum(columns**2, axis=1)
    np.testing.assert_allclose(found.variance[:, 0] - 1.0, expected, atol=2e-3 * expected.max())


def test_a_body_that_sticks_is_known_to_stand():
    machine = changed(RIG, coulomb=(50.0, 0.0), half_gap=(0.0,), idle_torque=())
    plant = plant_of(drive_of(machine), ("motor_speed",))
    trace = Trace(np.zeros((100, 1)), np.random.default_rng(1).standard_normal((100, 1)) * 1e-3, STEP)
    found = plant.filter(trace, start_of(machine, plant), np.array([1.0]), 4.0, np.zeros(3))
    assert len(found.gains.gain) == len(found.states) == 100
    assert np.all(found.gains.gain[:, 0, 0] == 0.0) and np.all(found.states[:, 0] == 0.0)
