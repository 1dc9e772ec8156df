"""Torque noise that comes to wander slowly in place of a law: the fit keeps the noise that it began with."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivetool.check.fit import model as fitting
from drivetool.check.fit.model import Model, all_samples, fit, noise_absorbs_effect
from drivetool.identify.noise import Fit, Noise
from drivetool.identify.problem import Solution
from tests.check.models import model_over, true_model


def model_of(rate: float | None, error: float) -> Model:
    """A model whose torque noise forgets at a rate, 1 - memory, and whose free runs err by so much."""
    true, size = true_model(noise=0.0), 0.2 * error
    (trace,) = true.problem.traces
    noise = Noise(1.0, None if rate is None else 1.0 - rate, true.noise.scale)
    return model_over(replace(trace, outputs=trace.outputs + size), noise=noise)


@pytest.mark.parametrize(("rate", "error", "stands"), [
    (0.068, 1.3, True),  # 0.7 of the rate before, and a quarter more error
    (0.072, 1.3, False),
    (0.05, 1.2, False),
    (0.001, 1.26, True),
    (0.04, 1.4, True),
    (0.1, 9.0, False),  # as fast as before: free runs may be worse for other reasons
    (None, 9.0, False)])
def test_noise_replaces_a_law_where_it_is_slower_and_free_runs_are_worse(rate, error, stands):
    assert noise_absorbs_effect(model_of(rate, error), model_of(0.1, 1.0)) is stands


def test_white_noise_before_has_stood_in_for_nothing():
    assert not noise_absorbs_effect(model_of(0.01, 9.0), model_of(None, 1.0))


@pytest.mark.parametrize(("rate", "renewed"), [(0.05, [True, False]), (0.09, [True])])
def test_a_fit_is_made_again_under_the_noise_it_began_with(monkeypatch, rate, renewed):
    """And its result is that of the fit whose noise stayed."""
    noise_estimated = []

    def fitted(problem, point, noise, estimate_noise, **_):
        noise_estimated.append(estimate_noise)
        worse = replace(point, values=(1.5 if estimate_noise else 2.0) * point.values)
        noise = replace(noise, memory=1.0 - rate) if estimate_noise else noise
        return Fit(Solution(worse, None, 1, True), noise, -1.0, (), 1, 0.0, True)

    monkeypatch.setattr(fitting, "fit_innovations", fitted)
    before = model_of(0.1, 0.0)
    after = fit(before, all_samples(before.problem))
    assert noise_estimated == renewed and after.point.values == before.point.values * (2.0 if renewed[1:] else 1.5)
