"""What the training samples leave open of the parameters, allowed for where a prediction fails badly.

A prediction with the parameters of the training samples, as if they were exact, has next to no chance in a block
that goes where those samples never were: under little torque noise the model runs on without looking, and what it
is off by counts sample for sample. The likelihood of a block, averaged over the parameters that the training
samples leave possible, is that of a fit to both, less what the training samples lose by it and less the share of
the possible parameters that is left (Laplace; Kass and Raftery 1995, J. Amer. Statist. Assoc. 90).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.check.fit import Masks, Model, fit, losses, spread, total
from drivetool.drive.simulation import Gains
from drivetool.identify.noise import arrow, filtered, with_state

OPEN = 1e-8  # of what all samples tell of a direction, that the training samples are taken to tell at least
EITHER = float(np.log(2.0))  # the price of asking both ways
ROUNDS = 3  # of the fit to both


def allowed(trained: Model, train: Masks, block: Masks, plain: float) -> float:
    """-log likelihood of a block under the model as it was trained or as it might have been, each believed by half.

    trained  the model fitted to the training samples
    block    samples of the block; plain: their -log likelihood with the parameters as they were trained
    """
    value = averaged(trained, train, block)
    return EITHER - float(np.logaddexp(-value, -plain)) if np.isfinite(value) else plain


def averaged(trained: Model, train: Masks, block: Masks) -> float:
    """-log likelihood of a block, averaged over the parameters that the training samples leave possible."""
    masks = [t | b for t, b in zip(train, block, strict=True)]
    # From where it was trained; nothing of the noise is chosen anew.
    both = fit(trained, masks, most=ROUNDS, renewed=False)
    with np.errstate(over="ignore", invalid="ignore"):
        variance = spread(filtered(trained.problem, trained.point, trained.noise, keep=False), train)
        before, after = (total(losses(filtered(m.problem, m.point, m.noise, keep=False), variance), which)
                         for m, which in ((trained, train), (both, masks)))
        left = _information(both, masks, train)
    return after - before + left


def _information(model: Model, masks: Masks, train: Masks) -> float:
    """Half the log of how much more all samples tell of parameters and start states than those of the training."""
    whole, part = (_matrix(model, which) for which in (masks, train))
    size = np.sqrt(np.where(np.diag(whole) > 0.0, np.diag(whole), 1.0))
    whole, part = (m / np.outer(size, size) + OPEN * np.eye(len(size)) for m in (whole, part))
    return 0.5 * float(np.linalg.slogdet(whole)[1] - np.linalg.slogdet(part)[1])


def _matrix(model: Model, masks: Sequence[np.ndarray]) -> np.ndarray:
    """(k, k) information of the samples of a mask, up to the sensor's variance; start states after parameters."""
    passes = filtered(model.problem, model.point, model.noise)
    gains = [Gains(f.gains.gain, f.gains.weight * mask[:, None]) for f, mask in zip(passes, masks, strict=True)]
    problem = model.problem.with_memory(model.noise.memory)
    return arrow(problem.normal(with_state(model.point, model.noise), gains))[0]
