"""Standard deviations of a cause's amplitudes by one linear step, against closed forms of a linear regression."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.check.fit.gauss_newton_step import amplitude_std, linear_step
from drivetool.identify.problem import Normal

SAMPLES, NOISE = 400, 0.5


def regression(*columns):
    """(problem, normal equations) of errors that are noise, with these columns as sensitivities."""
    x = np.column_stack(columns)
    error = NOISE * np.random.default_rng(1).standard_normal(SAMPLES)
    cost = NOISE**2 * (SAMPLES - x.shape[1])
    problem = SimpleNamespace(count=SAMPLES, unknowns=x.shape[1])
    return problem, Normal(x.T @ x, (), (), -x.T @ error, (), cost)


def wave(correlation):
    """(constant, sine-like, cosine-like): the last two of unit square and of that correlation."""
    rng = np.random.default_rng(2)
    one = np.ones(SAMPLES)
    a, b, *_ = np.linalg.qr(np.column_stack([one, *rng.standard_normal((2, SAMPLES))]))[0].T[1:]
    return one, a, correlation * a + np.sqrt(1.0 - correlation**2) * b


def test_an_amplitude_counts_with_its_companion_at_zero():
    problem, normal = regression(*wave(0.9))
    own, rest = np.array([False, True, True]), np.array([True, False, False])
    np.testing.assert_allclose(amplitude_std(problem, normal, own, rest)[1:], NOISE, rtol=1e-9)
    _, std, _ = linear_step(problem, normal, np.ones(3, bool))
    np.testing.assert_allclose(std[1:], NOISE / np.sqrt(1.0 - 0.9**2), rtol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e6])
def test_what_the_base_reproduces_to_the_last_digit_is_not_identifiable(scale):
    """As dry friction is by an idle torque, in a record without a reversal."""
    one, a, _ = wave(0.0)
    problem, normal = regression(one, a, scale * (2.0 * one - 0.3 * a))
    own, rest = np.array([False, False, True]), np.array([True, True, False])
    assert np.isinf(amplitude_std(problem, normal, own, rest)[2])
    step, std, _ = linear_step(problem, normal, np.ones(3, bool))
    assert np.isinf(std[[0, 2]]).all() and np.isfinite(step).all()


def test_a_companion_of_the_same_shape_does_not_hide_an_amplitude():
    one, a, _ = wave(0.0)
    problem, normal = regression(one, a, a)
    std = amplitude_std(problem, normal, np.array([False, True, True]), np.array([True, False, False]))
    np.testing.assert_allclose(std[1:], NOISE, rtol=1e-9)
