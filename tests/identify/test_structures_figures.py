"""Printed figures of polynomial models, each worked out again by other means, and records that carry nothing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from scipy.optimize import minimize_scalar

from drivetool.drive import two_mass
from drivetool.errors import NotEnoughData
from drivetool.identify.frequency.estimator import SpectraOptions, spectra
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.polynomial.pem_fit import fit_structure
from drivetool.identify.polynomial.pem_model import KINDS, Stretch, Structure
from drivetool.identify.polynomial.structures import polynomial_blackbox
from drivetool.identify.setup.options import Options
from tests.recover import STEP, experiment
from tests.simulator.experiments import multisine
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

RIG = Machine((0.6, 5.2), (0.8, 0.4), stiffness=(3300.0,), damping=(3.1,))
START = two_mass().with_values({"motor.inertia": 0.5, "load.inertia": 6.0, "shaft.stiffness": 3600.0,
                                "shaft.damping": 2.0})


def record(seed, n=4000, torque_noise=0.0):
    u = multisine(np.arange(0.7, 40.0, 1.3), 0.5, n * STEP, STEP, 5)
    run = simulate_linear(RIG, u, STEP, None, white_noise(n, torque_noise, 3 * seed))
    return experiment(u, run.speeds[:, 0] + white_noise(n, 0.01, 3 * seed + 1))


@pytest.mark.parametrize("kind", ["oe", "bj", "innovations"])
def test_rmse_and_fit_are_those_of_a_free_run(kind):
    """Run by SciPy from the printed polynomials; start values and offset by one linear regression."""
    e = record(2, torque_noise=0.05)
    estimate = polynomial_blackbox([e], two_mass(), Options(structure=kind, order=3))
    p = estimate.details["polynomials_over_1/q"]
    bottom = p["A"] if "A" in p else p["F"]
    u, y = e.signals["motor_torque"], e.signals["motor_speed"]
    free = signal.lfilter(p["B"], bottom, u)
    pulses = [signal.lfilter([1.0], bottom, np.eye(1, len(u), k)[0]) for k in range(3)]
    rest = np.column_stack([*pulses, signal.lfilter(p["B"], bottom, np.ones(len(u)))])
    rest /= np.linalg.norm(rest, axis=0)
    left = y - free - rest @ np.linalg.lstsq(rest, y - free, rcond=None)[0]
    assert estimate.fit["rmse"] == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-3)
    assert estimate.fit["simulation_fit_percent"] == pytest.approx(
        100.0 * (1.0 - np.linalg.norm(left) / np.linalg.norm(y - y.mean())), abs=0.05)
    run = estimate.exhibits[0].curves
    assert np.std(run["residual"][1]) == pytest.approx(estimate.fit["rmse"], rel=1e-2)
    share = 1.0 - estimate.fit["one_step_fit_percent"] / 100.0
    assert estimate.fit["n"] == len(y)
    assert estimate.details["errors_std"] == pytest.approx(share * np.std(y), rel=5e-3)


def first_order(seed, n=300):
    """y = 0.2 q^-1/(1 - 0.95 q^-1) u + (1 - 0.6 q^-1)/(1 - 0.95 q^-1) e."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(n)
    y = signal.lfilter([0.0, 0.2], [1.0, -0.95], u) + 0.3 * signal.lfilter(
        [1.0, -0.6], [1.0, -0.95], rng.standard_normal(n))
    return u - u.mean(), y - y.mean()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_noise_is_that_of_the_restricted_likelihood(seed):
    """Given C, an innovations model of first order is a regression: the maximum by brute force."""
    u, y = first_order(seed)
    n = len(u)

    def minus(c, restricted=True):
        def through(x):
            return signal.lfilter([1.0], [1.0, c], x)

        # A y - B u, the pulse that the start brings, and the constant torque, all through 1/C.
        late = [np.r_[0.0, x[:-1]] for x in (y, u, np.ones(n))]
        columns = np.column_stack([through(x) for x in (*late, np.eye(1, n)[0])])
        q, r = np.linalg.qr(columns)
        left = through(y) - q @ (q.T @ through(y))
        volume = np.sum(np.log(np.abs(np.diag(r)))) if restricted else 0.0
        return 0.5 * (n - 4 * restricted) * np.log(left @ left) + volume

    fit = fit_structure([Stretch(u, y)], Structure("innovations", 1))
    s = fit.structure
    mine = s.polynomial("C", fit.values)[1]
    table = s.basis("C")[1]
    std = abs(table[1, 0]) * np.sqrt(fit.covariance[s.part("C"), s.part("C")][0, 0])
    best, likeliest = (minimize_scalar(lambda c, k=k: minus(c, k), bounds=(-0.95, 0.0), method="bounded",
                                       options={"xatol": 1e-9}).x for k in (True, False))
    # Newton's step from one to the other leaves out what is not quadratic.
    assert abs(mine - best) < 0.05 * std
    assert abs(best - likeliest) > 0.15 * std


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_model_of_noise_is_a_failure(kind):
    rng = np.random.default_rng(4)
    nothing = experiment(rng.standard_normal(6000), rng.standard_normal(6000))
    estimate = polynomial_blackbox([nothing], two_mass(), Options(structure=kind, order=3))
    assert "low-coherence" in {f.code for f in estimate.findings if f.severity == "failure"}
    assert "low-coherence" not in {f.code for f in polynomial_blackbox([record(1)], two_mass(), Options(
        structure=kind, order=3)).findings}


def test_lines_that_carry_nothing_are_not_fitted():
    """Neither incoherent ones nor those that the excitation leaves empty, by either fit."""
    rng = np.random.default_rng(4)
    nothing = experiment(rng.standard_normal(6000), rng.standard_normal(6000))
    for fit in (lambda e: greybox([e], START, Options(criterion="frequency")),
                lambda e: polynomial_blackbox([e], two_mass(),
                                              Options(structure="oe", order=3, criterion="frequency"))):
        with pytest.raises(NotEnoughData, match=r"coherence above 0\.5; found 0"):
            fit(nothing)
    lines = np.array([1.0, 2.0, 3.0, 3.5, 4.0, 4.5, 6.0, 9.0, 11.0, 12.0, 12.5, 13.0, 14.0, 20.0])
    u = np.tile(multisine(lines, 0.5, 2.0, STEP, 3), 8)
    e = experiment(u, simulate_linear(RIG, u, STEP).speeds[:, 0] + white_noise(len(u), 0.01, 1))
    estimate = greybox([e], START, Options(criterion="frequency"))
    assert " 14 lines " in estimate.outcome
    curves = next(x for x in estimate.exhibits if x.kind == "response").curves
    np.testing.assert_allclose(curves["measured"][0], lines)


@pytest.mark.parametrize("method", ["auto", "periodic"])
def test_a_record_shorter_than_its_period(method):
    with pytest.raises(NotEnoughData, match="two periods of 5 s"):
        spectra([record(1)], SpectraOptions(method=method, period=5.0))
