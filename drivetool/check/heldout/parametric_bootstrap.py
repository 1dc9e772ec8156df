"""Parametric bootstrap of the free-run error: the part that the noise of a model causes.

Where the drive amplifies every disturbance (a ripple at creeping speed, a gap), a free run diverges from the record
though the model is right. Simulated records of the model with its own noise give the size of that error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.check.fit import Model, sensor_std
from drivetool.check.heldout.free_run_error import block_start_states, blocks_under_test
from drivetool.check.heldout.scores import Fold
from drivetool.drive.simulation import Plant, Trace
from drivetool.identify.fit import free_run
from drivetool.identify.noise import Noise, with_torque_noise

RECORDS_PER_BLOCK = 4  # a choice: simulated records of every block; the error averages over all blocks


def error_by_noise(models: Sequence[Model], folds: Sequence[Fold], seed: int = 0) -> float:
    """Rms error, of the first output, of free runs over test blocks simulated by the models with their own noise.

    models  per fold, trained on its training samples
    source  parametric bootstrap, Efron and Tibshirani 1993, An Introduction to the Bootstrap, chapter 6
    """
    rng, errors = np.random.default_rng(seed), []
    for model, fold in zip(models, folds, strict=True):
        traces, start_states = blocks_under_test(fold, model.problem.traces), block_start_states(model, fold)
        if not traces:
            continue
        problem, point, _ = free_run(model.fitted, traces, model.noise, start_states)
        std, plants = sensor_std(model), problem.plants(point.values, False)
        for _ in range(RECORDS_PER_BLOCK):
            made = [_simulated_record(plant, t, start, model.noise.over(problem.steps(t)), std, rng)
                    for plant, t, start in zip(plants, traces, point.starts, strict=True)]
            _, _, runs = free_run(model.fitted, made, model.noise, start_states)
            errors += [run[:, 0] - t.outputs[:, 0] for run, t in zip(runs, made, strict=True)]
    return float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2))) if errors else 0.0


def _simulated_record(plant: Plant, trace: Trace, start: np.ndarray, noise: Noise, std: float,
          rng: np.random.Generator) -> Trace:
    """The trace simulated by the plant with new noise; NaN where nothing was measured.

    std  of the first sensor's noise
    """
    outputs = plant.outputs(with_torque_noise(trace, noise, std, rng), start)
    outputs += std * noise.scale * rng.standard_normal(outputs.shape)
    return replace(trace, outputs=np.where(np.isfinite(trace.outputs), outputs, np.nan))
