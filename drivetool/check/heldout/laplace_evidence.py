"""Laplace marginal likelihood: parameter uncertainty after training, for blocks that are predicted badly.

A prediction with exactly the trained parameters fails in a block outside the training range: under little torque
noise the filter hardly corrects the model, and its error counts in every sample. The marginal likelihood of a block
averages over the parameters that the training samples allow. It is the likelihood of a fit to both, less the loss
on the training samples, less the log ratio of the two parameter volumes (Laplace; Kass and Raftery 1995, J. Amer.
Statist. Assoc. 90).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.check.fit import Masks, Model, fit, sample_losses, sensor_variance, total_loss
from drivetool.drive.simulation import ObserverGains
from drivetool.identify.noise import dense_normal_equations, filtered, with_disturbance_state

# Of the information of all samples on a direction, added to both: directions without any cancel in the ratio.
INFORMATION_RIDGE = 1e-8
MODEL_AVERAGE_PENALTY = float(np.log(2.0))  # the price of averaging over two models of equal prior
JOINT_FIT_ITERATIONS = 3  # a choice: the fit to both starts near its optimum


def loss_with_uncertainty(trained: Model, train: Masks, block: Masks, exact: float) -> float:
    """-log likelihood of a block, the average of exact trained parameters and of uncertain ones, prior 1/2 each.

    trained  the model fitted to the training samples
    block    samples of the block; exact: their -log likelihood with exactly the trained parameters
    """
    value = laplace_loss(trained, train, block)
    return MODEL_AVERAGE_PENALTY - float(np.logaddexp(-value, -exact)) if np.isfinite(value) else exact


def laplace_loss(trained: Model, train: Masks, block: Masks) -> float:
    """-log marginal likelihood of a block, over the parameters that the training samples allow."""
    masks = [t | b for t, b in zip(train, block, strict=True)]
    # From the trained parameters, with the trained noise.
    both = fit(trained, masks, max_iterations=JOINT_FIT_ITERATIONS, refit_noise=False)
    with np.errstate(over="ignore", invalid="ignore"):
        variance = sensor_variance(filtered(trained.problem, trained.point, trained.noise, keep=False), train)
        before, after = (total_loss(sample_losses(filtered(m.problem, m.point, m.noise, keep=False), variance),
                                    which)
                         for m, which in ((trained, train), (both, masks)))
        volume = _log_volume_ratio(both, masks, train)
    return after - before + volume


def _log_volume_ratio(model: Model, masks: Masks, train: Masks) -> float:
    """Half the log ratio of the information determinants of all and of training samples, start states included."""
    whole, part = (_information_matrix(model, which) for which in (masks, train))
    size = np.sqrt(np.where(np.diag(whole) > 0.0, np.diag(whole), 1.0))
    whole, part = (m / np.outer(size, size) + INFORMATION_RIDGE * np.eye(len(size)) for m in (whole, part))
    return 0.5 * float(np.linalg.slogdet(whole)[1] - np.linalg.slogdet(part)[1])


def _information_matrix(model: Model, masks: Sequence[np.ndarray]) -> np.ndarray:
    """(k, k) information of the samples of a mask, up to the sensor's variance; start states after parameters."""
    passes = filtered(model.problem, model.point, model.noise)
    gains = [ObserverGains(f.gains.gain, f.gains.weight * mask[:, None])
             for f, mask in zip(passes, masks, strict=True)]
    problem = model.problem.with_memory(model.noise.memory)
    return dense_normal_equations(problem.normal(with_disturbance_state(model.point, model.noise), gains))[0]
