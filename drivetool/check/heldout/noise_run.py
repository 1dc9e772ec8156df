"""The error of free runs that the noise of a model makes by itself.

Where the drive amplifies every knock (a ripple at creeping speed, a gap), a free run goes astray though the model
is right. Records of the model with its own noise, run as the true ones were, say how far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.check.fit import Model, sensor_std
from drivetool.check.heldout.free_run_error import blocks_under_test, turned
from drivetool.check.heldout.scores import Fold
from drivetool.drive.simulation import Plant, Trace
from drivetool.identify.fit import free_run
from drivetool.identify.noise import Noise, with_torque_noise

DRAWS = 4  # records made of every block


def error_by_noise(models: Sequence[Model], folds: Sequence[Fold], seed: int = 0) -> float:
    """Rms error, of the first output, of free runs over test blocks that the models made with their own noise.

    models  per fold, trained on its training samples
    source  parametric bootstrap, Efron and Tibshirani 1993, An Introduction to the Bootstrap, chapter 6
    """
    rng, errors = np.random.default_rng(seed), []
    for model, fold in zip(models, folds, strict=True):
        traces, further = blocks_under_test(fold, model.problem.traces), turned(model, fold)
        if not traces:
            continue
        problem, point, _ = free_run(model.fitted, traces, model.noise, further)
        std, plants = sensor_std(model), problem.plants(point.values, False)
        for _ in range(DRAWS):
            made = [_made(plant, t, start, model.noise.over(problem.steps(t)), std, rng)
                    for plant, t, start in zip(plants, traces, point.starts, strict=True)]
            _, _, runs = free_run(model.fitted, made, model.noise, further)
            errors += [run[:, 0] - t.outputs[:, 0] for run, t in zip(runs, made, strict=True)]
    return float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2))) if errors else 0.0


def _made(plant: Plant, trace: Trace, start: np.ndarray, noise: Noise, std: float,
          rng: np.random.Generator) -> Trace:
    """The trace as the plant would have made it with other noise; nothing where nothing was measured.

    std  of the first sensor's noise
    """
    outputs = plant.outputs(with_torque_noise(trace, noise, std, rng), start)
    outputs += std * noise.scale * rng.standard_normal(outputs.shape)
    return replace(trace, outputs=np.where(np.isfinite(trace.outputs), outputs, np.nan))
