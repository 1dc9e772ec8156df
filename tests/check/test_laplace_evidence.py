"""The likelihood of data held out, averaged over what the training samples leave open, against its closed form."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.check.fit.model import all_samples, fit, sample_losses, sensor_variance, total_loss
from drivetool.check.heldout.laplace_evidence import MODEL_AVERAGE_PENALTY, laplace_loss, loss_with_uncertainty
from drivetool.identify.noise import filtered
from drivetool.identify.problem import Point
from tests.recover import one_sensor


def parts(base, train, block):
    """Masks of two stretches of the only record."""
    masks = []
    for a, b in (train, block):
        mask = np.zeros(base.problem.traces[0].size, bool)
        mask[a:b] = True
        masks.append([mask])
    return masks


def innovations(model, values, starts):
    """(n,) one-step errors over their std, that of the sensor being one."""
    passed = filtered(model.problem, Point(values, (starts,)), model.noise, keep=False)[0]
    return passed.innovations[:, 0] / np.sqrt(passed.variance[:, 0])


def slopes(model):
    """(n, k) their derivatives, by central differences, over parameters and start states."""
    values, starts = model.point.values, model.point.starts[0]
    columns = []
    for j in range(len(values)):
        step = np.zeros(len(values))
        step[j] = 1e-5 * max(abs(values[j]), 1e-3)
        columns.append((innovations(model, values + step, starts) - innovations(model, values - step, starts))
                       / (2.0 * step[j]))
    for j in range(len(starts)):
        step = np.zeros(len(starts))
        step[j] = 1e-4
        columns.append((innovations(model, values, starts + step) - innovations(model, values, starts - step))
                       / 2e-4)
    return np.column_stack(columns)


@pytest.mark.parametrize("seed", [4, 7])
@pytest.mark.parametrize("block", [(2000, 2600), (3000, 4000)])
def test_it_is_the_marginal_likelihood_of_a_linear_model(seed, block):
    base, _ = one_sensor(seed)
    train, test = parts(base, (0, 2000), block)
    model = fit(base, train)
    where, at = train[0], test[0]
    passes = filtered(model.problem, model.point, model.noise, keep=False)
    variance = sensor_variance(passes, train)
    plain = total_loss(sample_losses(passes, variance), test)
    z, j = innovations(model, model.point.values, model.point.starts[0]) / np.sqrt(variance), slopes(model)
    j /= np.linalg.norm(j[where], axis=0)
    open_ = np.linalg.pinv(j[where].T @ j[where] / variance, rcond=1e-12, hermitian=True)
    spread_of = np.eye(at.sum()) + j[at] @ open_ @ j[at].T / variance
    # Gaussian: the errors of the block are as uncertain as noise and parameters together make them.
    exact = plain + 0.5 * (z[at] @ np.linalg.solve(spread_of, z[at]) - z[at] @ z[at]
                           + np.linalg.slogdet(spread_of)[1])
    assert laplace_loss(model, train, test) == pytest.approx(exact, abs=0.3)
    assert loss_with_uncertainty(model, train, test, plain) <= min(plain, exact + 0.3) + MODEL_AVERAGE_PENALTY


def test_a_block_that_the_parameters_can_follow_is_not_given_up():
    # Trained on a segment that hardly identifies the friction, the model leaves the record.
    base, _ = one_sensor(4)
    train, test = parts(base, (0, 150), (3000, 4000))
    model = fit(base, train)
    passes = filtered(model.problem, model.point, model.noise, keep=False)
    plain = total_loss(sample_losses(passes, sensor_variance(passes, train)), test)
    whole = filtered(base.problem, base.point, base.noise, keep=False)
    informed = total_loss(sample_losses(whole, sensor_variance(whole, all_samples(base.problem))), test)
    assert plain > informed + 1000.0
    assert loss_with_uncertainty(model, train, test, plain) < informed + 30.0
