"""What a model leaves in one-step errors, where the logger rounds and where it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from drivetool.check.fit.model import Model, all_samples, fit, fit_from_start, sensor_variance
from drivetool.check.fit.residual_tests import (
    _autocorrelation_gain,
    _residual_gains,
    _simulated_records,
    gain_from_quantisation,
    run_residual_tests,
)
from drivetool.identify.noise import filtered
from drivetool.identify.problem import Point
from drivetool.identify.setup import Task, roles_of
from tests.recover import STEP, drive_like, experiment, one_sensor, resonance
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear


def rounded(seed: int, share: float) -> tuple[Model, float]:
    """(a right model of a record that is logged in steps, the step); share: of the largest speed."""
    model, _ = one_sensor(seed)
    step = share * max(np.abs(t.outputs).max() for t in model.problem.traces)
    traces = tuple(replace(t, outputs=np.round(t.outputs / step) * step) for t in model.problem.traces)
    problem = replace(model.problem, traces=traces)
    return fit(replace(model, problem=problem), all_samples(problem)), step


@pytest.mark.parametrize("seed", [2, 7])
def test_records_made_up_by_a_model_have_the_noise_that_it_was_fitted_with(seed):
    model, step = rounded(seed, 0.02)
    made = _simulated_records(model, np.array([step]))
    y = made.traces[0].outputs
    np.testing.assert_allclose(y, np.round(y / step) * step, atol=1e-9 * step)
    masks = all_samples(made)
    std = [np.sqrt(sensor_variance(filtered(p, model.point, model.noise, keep=False), masks))
           for p in (model.problem, made)]
    assert std[1] == pytest.approx(std[0], rel=0.1)


@pytest.mark.parametrize(("memory", "slow"), [(0.9, None), (0.9, 0.1)])
def test_made_up_records_have_torque_noise_with_a_memory(memory, slow):
    """Normalised by the filter of the same noise, their errors have the sensor's variance, and no more."""
    model, ratio = one_sensor(2)
    model = replace(model, noise=replace(model.noise, ratio=10.0 * ratio, memory=memory, slow=slow))
    made = _simulated_records(model, np.zeros(1))
    masks = all_samples(made)
    std = [np.sqrt(sensor_variance(filtered(p, model.point, model.noise, keep=False), masks))
           for p in (model.problem, made)]
    assert std[1] == pytest.approx(std[0], rel=0.05)


@pytest.mark.parametrize(("seed", "share"), [(2, 0.02), (7, 0.05)])
def test_rounding_alone_leaves_nothing_and_a_wrong_model_something(seed, share):
    """Steps coarse enough to repeat, yet not so coarse that the torque noise takes them for itself."""
    model, _ = rounded(seed, share)
    assert _residual_gains(model, model.problem).total > 100.0 and run_residual_tests(model).total == 0.0
    stiff = model.task.free.index("shaft.stiffness")
    values = model.point.values.copy()
    values[stiff] *= 1.3
    wrong = replace(model, point=Point(values, model.point.starts))
    assert run_residual_tests(wrong).total > 1000.0


@pytest.mark.parametrize("root", [0.3, 0.8])
def test_correlated_errors_gain_what_their_predictor_gains(root):
    """-log(1 - root^2) / 2 a sample for an autoregression of first order, whose variance is known."""
    noise = np.random.default_rng(3).standard_normal((2, 20000))
    pieces = list(lfilter([1.0], [1.0, -root], noise))
    worth = -0.5 * noise.size * np.log1p(-root**2)
    assert _autocorrelation_gain(pieces) == pytest.approx(worth, rel=0.05, abs=100.0)
    assert _autocorrelation_gain(list(noise)) == 0.0


def test_a_fit_to_made_up_records_that_fails_says_nothing(monkeypatch):
    tried = []

    def fails(model, *_, **__):
        tried.append(model)
        raise np.linalg.LinAlgError("Singular matrix")

    model, _ = rounded(3, 0.05)
    monkeypatch.setattr("drivetool.check.fit.residual_tests.fit", fails)
    assert gain_from_quantisation(model, model, all_samples(model.problem)) == 0.0 and tried


def test_decimals_far_below_the_noise_excuse_nothing_under_noise_that_is_weak_where_it_is_slow():
    model, _ = rounded(2, 1e-7)
    values = model.point.values.copy()
    values[model.task.free.index("shaft.stiffness")] *= 1.3
    wrong = replace(model, point=Point(values, model.point.starts),
                    noise=replace(model.noise, ratio=20.0, memory=0.9, slow=0.3))
    assert run_residual_tests(wrong) == _residual_gains(wrong,
                                                        wrong.problem) and run_residual_tests(wrong).total > 25.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 7])
def test_a_form_of_noise_that_rounding_likes_is_no_gain_of_the_cause_that_has_it(seed):
    """The same law twice, under white torque noise and under one with a memory, where steps are all the noise."""
    model, _ = rounded(seed, 0.05)
    white = replace(model, noise=replace(model.noise, memory=None, slow=None))
    coloured = replace(model, noise=replace(model.noise, memory=0.9, slow=None))
    assert abs(gain_from_quantisation(white, coloured, all_samples(model.problem))) < 1.0


@pytest.mark.parametrize(("seed", "stiffer"), [(2, 1.0), (2, 1.03), (7, 1.0), (7, 1.03)])
def test_a_shaft_that_changes_within_the_record_is_something_left(seed, stiffer):
    """The second half is of a machine whose shaft is stiffer: noise does not make the halves differ."""
    machine, size = machine_by_seed(seed), 4000
    other = replace(machine, stiffness=(stiffer * machine.stiffness[0],))
    torque = 0.1 * machine.rated_torque * multisine(
        np.linspace(0.05, 2.0, 12) * resonance(machine), 1.0, size * STEP, STEP, seed)[:size]
    noise = white_noise(size, 0.002 * machine.rated_torque, 3 * seed)
    early, late = (simulate_linear(m, torque, STEP, None, noise).speeds[:, 0] for m in (machine, other))
    speed = np.where(np.arange(size) < size // 2, early, late)
    record = experiment(torque, speed + white_noise(size, 1e-3 * np.abs(speed).max(), 3 * seed + 1))
    free = ("motor.inertia", "load.inertia", "motor.viscous", "load.idle_torque", "shaft.stiffness",
            "shaft.damping")
    drive = drive_like(machine, list(free))
    left = run_residual_tests(fit_from_start(Task(drive, free, roles_of([record], drive), (record,)))).time
    assert left > 25.0 if stiffer > 1.0 else left == 0.0
