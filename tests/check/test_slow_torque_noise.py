"""Torque noise that comes to wander slowly in place of a law: the fit keeps the noise that it began with."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.check.fit import model as fitting
from drivetool.check.fit.model import Model, fit, noise_absorbs_effect


def model_of(rate: float | None, error: float) -> Model:
    """A model whose torque noise forgets at a rate, 1 - memory, and whose free runs err by so much."""
    noise = SimpleNamespace(memory=None if rate is None else 1.0 - rate)
    return Model("base", None, SimpleNamespace(error=error), None, noise, 0.0)


@pytest.fixture
def run_errors(monkeypatch):
    monkeypatch.setattr(fitting, "_run_error", lambda m: m.problem.error)


@pytest.mark.parametrize(("rate", "error", "stands"), [
    (0.068, 1.3, True),  # 0.7 of the rate before, and a quarter more error
    (0.072, 1.3, False),
    (0.05, 1.2, False),
    (0.001, 1.26, True),
    (0.04, 1.4, True),
    (0.1, 9.0, False),  # as fast as before: free runs may be worse for other reasons
    (None, 9.0, False)])
def test_noise_replaces_a_law_where_it_is_slower_and_free_runs_are_worse(run_errors, rate, error, stands):
    assert noise_absorbs_effect(model_of(rate, error), model_of(0.1, 1.0)) is stands


def test_white_noise_before_has_stood_in_for_nothing(run_errors):
    assert not noise_absorbs_effect(model_of(0.01, 9.0), model_of(None, 1.0))


@pytest.mark.parametrize(("rate", "renewed"), [(0.05, [True, False]), (0.09, [True])])
def test_a_fit_is_made_again_under_the_noise_it_began_with(monkeypatch, rate, renewed):
    """And its result is that of the fit whose noise stayed."""
    noise_estimated = []

    def fitted(problem, point, noise, estimate_noise, **_):
        noise_estimated.append(estimate_noise)
        return SimpleNamespace(point=np.array([float(estimate_noise)]), value=-1.0, noise=SimpleNamespace(
            memory=1.0 - rate if estimate_noise else noise.memory))

    monkeypatch.setattr(fitting, "fit_innovations", fitted)
    monkeypatch.setattr(fitting, "masked_problem", lambda problem, masks: problem)
    monkeypatch.setattr(fitting, "_run_error", lambda m: 1.0 if m.point is None else 2.0)
    after = fit(model_of(0.1, 1.0), ())
    assert noise_estimated == renewed and after.point == float(renewed[-1])
