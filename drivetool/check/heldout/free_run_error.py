"""Free-run error of models on held-out blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.fit import Model, ResidualTests
from drivetool.check.heldout.folds import blocks_of
from drivetool.check.heldout.samples import Samples
from drivetool.check.heldout.scores import Fold
from drivetool.check.outcome import Gain
from drivetool.drive.simulation import Trace
from drivetool.identify.estimate import explains_to_rounding, fit_percent
from drivetool.identify.fit import free_run
from drivetool.identify.noise import filtered

# Times the largest measured value: a free run beyond has diverged, and its square may overflow.
DIVERGENCE_RATIO = 1e3


@dataclass(frozen=True)
class FreeRuns:
    """Free runs over the test blocks: per block measured and simulated (n,) of the first output."""

    measured: tuple[np.ndarray, ...]
    simulated: tuple[np.ndarray, ...]

    @property
    def squares(self) -> np.ndarray:
        """(blocks,) mean squared error."""
        return np.array([np.nanmean((y - s) ** 2) for y, s in zip(self.measured, self.simulated, strict=True)])

    @property
    def rmse(self) -> float:
        """Over all blocks."""
        e = np.concatenate(self.measured) - np.concatenate(self.simulated)
        return float(np.sqrt(np.nanmean(e**2)))

    @property
    def fit(self) -> float:
        """Percent of the motion explained."""
        return fit_percent(np.concatenate(self.measured), np.concatenate(self.simulated))


def blocks_under_test(fold: Samples, traces: Sequence[Trace]) -> list[Trace]:
    """The blocks of a fold's test samples in which the first sensor has a value, as traces of their own."""
    return [replace(traces[i], inputs=traces[i].inputs[a:b], outputs=traces[i].outputs[a:b],
                    origin=traces[i].origin + a * traces[i].step, lead=traces[i].inputs[:a])
            for i, a, b in _test_blocks(fold, traces)]


def _test_blocks(fold: Samples, traces: Sequence[Trace]) -> list[tuple[int, int, int]]:
    """(trace, first sample, end) of the blocks of a fold's test samples in which the first sensor has a value."""
    return [(i, a, b) for i, a, b in blocks_of(traces)
            if fold.test[i][a:b].mean() > 0.5 and np.isfinite(traces[i].outputs[a:b, 0]).any()]


def block_start_states(model: Model, fold: Fold) -> list[np.ndarray]:
    """Per block of test samples the model's filtered state at its start.

    Where a torque depends on an angle without a sensor, only this gives the angle: fitted from zero, the start of a
    ripple of several orders would end in a local optimum. Empty elsewhere.
    """
    problem, roles = model.problem, model.task.roles.outputs
    states = problem.states
    if "angle" not in states or any(role.endswith("angle") for role in roles):
        return []
    passes = filtered(problem, model.point, model.noise)
    return [passes[i].states[a, :len(states)].copy() for i, a, _ in _test_blocks(fold, problem.traces)]


def held_out_free_runs(models: Sequence[Model], folds: Sequence[Fold]) -> FreeRuns:
    """Free runs of the model of each fold over its held-out blocks; only start states are fitted."""
    measured, simulated = [], []
    for model, fold in zip(models, folds, strict=True):
        traces = blocks_under_test(fold, model.problem.traces)
        if not traces:
            continue
        _, _, runs = free_run(model.fitted, traces, model.noise, block_start_states(model, fold))
        measured += [t.outputs[:, 0] for t in traces]
        simulated += [_clipped_run(r[:, 0], t.outputs[:, 0]) for t, r in zip(traces, runs, strict=True)]
    return FreeRuns(tuple(measured), tuple(simulated))


def exact_to_rounding(model: Model) -> bool:
    """Whether free runs of a model over whole records reproduce the first output to rounding."""
    traces = model.problem.traces
    return explains_to_rounding(traces, free_run(model.fitted, traces, model.noise)[2])


def _clipped_run(simulated: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """A run (n,), limited to DIVERGENCE_RATIO times the measured maximum: beyond, its square may overflow."""
    limit = DIVERGENCE_RATIO * max(float(np.nanmax(np.abs(measured), initial=0.0)), 1e-300)
    return np.clip(np.nan_to_num(simulated, nan=limit), -limit, limit)


def gain_of(before: FreeRuns, after: FreeRuns, unit: str, segment: float, floor: float,
            unexplained: float) -> Gain:
    """The gain between the free runs of two models over the same blocks."""
    return gain_by_blocks((before.rmse, after.rmse), (before.fit, after.fit), [before.squares, after.squares], unit,
                          segment, floor, unexplained)


def gain_by_blocks(errors: tuple[float, float], fits: tuple[float, float], squares: Sequence[np.ndarray], unit: str,
                   segment: float, floor: float, unexplained: float) -> Gain:
    """The gain between two models, before and after, with its scatter over the common test blocks.

    The delta method turns the scatter of squares into that of roots: d sqrt(q) = dq / (2 sqrt(q)).

    errors   rms over all blocks; fits: in per cent; squares: (blocks,) mean squared errors each
    """
    roots = [s / max(2.0 * e, 1e-300) for s, e in zip(squares, errors, strict=True)]
    return Gain(
        unit=unit, segment=segment, held_out_rmse_before=errors[0], held_out_rmse_after=errors[1],
        rmse_std=_std_of_mean(roots[0] - roots[1]), held_out_fit_before=fits[0], held_out_fit_after=fits[1],
        noise_floor=floor, unexplained_percent=unexplained, blocks=len(squares[0]),
        rmse_bar=_std_of_mean(squares[0] - squares[1]) / max(sum(errors), 1e-300))


def _std_of_mean(values: np.ndarray) -> float:
    """Standard error of the mean of (blocks,) values; NaN for one."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else np.nan


def unexplained_percent(gain: float, left: ResidualTests) -> float:
    """Share of the attainable log likelihood that is still missing, in per cent."""
    total = max(gain, 0.0) + left.total
    return float(100.0 * left.total / total) if total > 0.0 else 0.0
