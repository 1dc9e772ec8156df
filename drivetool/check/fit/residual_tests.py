"""Residual tests: structure in the innovations of a model that noise does not explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from drivetool.check.fit.model import (
    FIT_ERRORS,
    Masks,
    Model,
    all_samples,
    fit,
    over_traces,
    sensor_std,
    sensor_variance,
    with_likeliest_noise,
)
from drivetool.check.fit.quantisation import MIN_ROUNDING_VARIANCE_SHARE, resolution
from drivetool.drive.simulation import Filtered, ObserverGains
from drivetool.identify.noise import filtered, with_disturbance_state, with_torque_noise
from drivetool.identify.problem import Normal, Problem, schur

RESIDUAL_LAGS = 20  # a choice: of autocorrelation, as usual for a whiteness test (Ljung 1999, section 16.6)
VARIANCE_WINDOW = 0.1  # s; a choice: long against the sampling step, short against the motion
RESIDUAL_BINS = 16  # of speed and torque. A choice: records of a thousand samples still have 60 in each
# Share of the information of a direction that each half of the records must have. A choice: with less, its
# estimate is that of the other half.
MIN_HALF_INFORMATION = 0.05
START_STATE_RIDGE = 1e-6  # of the information of a start state; only keeps the equations solvable
MIN_DIRECTION_INFORMATION = 1e-9  # of the best known direction, below which rounding decides
# Standard deviations of a chi-square above its mean. A choice: several tests per model must not raise false
# alarms.
CHI2_SIGNIFICANCE = 6.0
SIMULATED_FIT_ITERATIONS = 5  # a choice: the fit starts at the true values
# Share of the gain, and log likelihood, that the residuals may still have for an identified cause to be
# trusted. A choice: no law is exact.
MAX_RESIDUAL_SHARE, MAX_RESIDUAL_GAIN = 0.15, 10.0
# Factor by which quantisation may leave more than in one simulated record: that scatters (a choice).
QUANTISATION_MARGIN = 1.5


@dataclass(frozen=True)
class ResidualTests:
    """Log likelihood that a better model could still gain, at least, by test; zero where noise explains it.

    memory   innovations that are correlated from sample to sample
    size     innovations whose variance changes over time
    place    a mean that depends on speed or torque
    time     parameters that differ between the first and the second half of the records
    """

    memory: float
    size: float
    place: float
    time: float = 0.0

    @property
    def total(self) -> float:
        """The largest of them: they overlap."""
        return max(self.memory, self.size, self.place, self.time)


def run_residual_tests(model: Model, held: Masks = ()) -> ResidualTests:
    """The residual tests of a model over its records, from the first output.

    held  per trace (n,) samples of held-out records, none of those that the model was fitted to: the noise of these
          is estimated on them

    Quantisation leaves correlated errors where the motion is slow. What it leaves in simulated records of the
    model itself, with the same quantisation, is subtracted.
    """
    found = _residual_gains(model, model.problem, held)
    steps = _quantisation_steps(model)
    # Simulated records lack the low-frequency share of torque noise, which leaves correlated residuals by itself.
    if found.total == 0.0 or steps[0] == 0.0 or (model.noise.slow is not None and not is_coarse(model)):
        return found
    rounding = _residual_gains(model, _simulated_records(model, steps), held)
    return ResidualTests(*(max(0.0, getattr(found, name) - QUANTISATION_MARGIN * getattr(rounding, name))
                       for name in ("memory", "size", "place", "time")))


def residuals_large(residual_gain: float, gained: float) -> bool:
    """Whether the residuals are too large for an identified cause to be trusted; both log likelihoods."""
    return residual_gain > max(MAX_RESIDUAL_SHARE * gained, MAX_RESIDUAL_GAIN)


def gain_from_quantisation(base: Model, cause: Model, masks: Masks) -> float:
    """Log likelihood that a cause gains on simulated records of the base, by quantisation alone.

    Zero where the step is below the noise: rounding is then part of the noise. Zero, too, where a fit fails. Both
    are fitted from the noise of either: only one form may suit the rounding errors.
    """
    steps = _quantisation_steps(base)
    if not is_coarse(base):
        return 0.0
    traces = _simulated_records(base, steps).traces
    try:
        without, with_cause = (
            min(fit(replace(m, problem=replace(m.problem, traces=traces), noise=noise), masks,
                    max_iterations=SIMULATED_FIT_ITERATIONS).value
                for noise in (base.noise, cause.noise)) for m in (base, cause))
    except FIT_ERRORS:  # a failed fit is no evidence
        return 0.0
    return without - with_cause


def is_coarse(model: Model) -> bool:
    """Whether quantisation is a large share of a sensor's noise."""
    noise = sensor_std(model) * model.noise.scale / model.noise.scale[0]
    return bool(np.any(_quantisation_steps(model)**2 / 12.0 > MIN_ROUNDING_VARIANCE_SHARE * noise**2))


def _quantisation_steps(model: Model) -> np.ndarray:
    """(ny,) quantisation steps of the outputs, zero where there are none."""
    outputs = np.concatenate([t.outputs for t in model.problem.traces])
    return np.array([resolution(y[np.isfinite(y)]) or 0.0 for y in outputs.T])


def _simulated_records(model: Model, steps: np.ndarray) -> Problem:
    """The records simulated from the model and its noise, quantised."""
    rng = np.random.default_rng(1)
    problem, noise = model.problem, model.noise
    passes = filtered(problem, model.point, noise, keep=False)
    first = np.sqrt(sensor_variance(passes, all_samples(problem)))
    sensors = np.sqrt(np.maximum((first * noise.scale) ** 2 - steps**2 / 12.0, 0.0))
    traces = []
    for trace, start, plant in zip(problem.traces, model.point.starts, problem.plants(model.point.values, False),
                                   strict=True):
        clean = plant.outputs(with_torque_noise(trace, noise.over(problem.steps(trace)), first, rng), start)
        clean += sensors * rng.standard_normal(clean.shape)
        rounded = np.where(steps > 0.0, np.round(clean / np.where(steps > 0.0, steps, 1.0)) * steps, clean)
        outputs = np.where(np.isfinite(trace.outputs), rounded, np.nan)
        traces.append(replace(trace, outputs=outputs))
    return replace(problem, traces=tuple(traces))


def _passes(model: Model, held: Masks) -> list[Filtered]:
    """A Kalman pass per trace; over held-out records under their own likeliest noise."""
    passes = filtered(model.problem, model.point, model.noise)
    held_out = [i for i, mask in enumerate(held) if mask.any()]
    if held_out:
        own = with_likeliest_noise(over_traces(model, held_out), [held[i] for i in held_out])
        for i, passed in zip(held_out, filtered(own.problem, own.point, own.noise), strict=True):
            passes[i] = passed
    return passes


def _residual_gains(model: Model, problem: Problem, held: Masks = ()) -> ResidualTests:
    """The residual tests of a model over the records of a problem."""
    passes = _passes(replace(model, problem=problem), held)
    z, torque, speed, lengths = [], [], [], []
    for f, t in zip(passes, problem.traces, strict=True):
        e = f.innovations[:, 0] / np.sqrt(f.variance[:, 0])
        good = np.flatnonzero(np.isfinite(e[1:]))
        z.append(e[1 + good])
        # Of the sample before: by feedback the torque of the same instant depends on the measured output.
        torque.append(t.inputs[good, 0])
        speed.append(f.states[good, 0])
        lengths.append(round(VARIANCE_WINDOW / t.step))
    scale = np.sqrt(np.mean(np.concatenate(z) ** 2))
    z = [e / max(scale, 1e-300) for e in z]
    return ResidualTests(_autocorrelation_gain(z), _variance_gain(z, max(lengths[0], 10)),
                     max(_mean_gain(z, speed), _mean_gain(z, torque)), _halves_gain(model, problem, passes))


def _chi2_excess(chi: float, degrees: int) -> float:
    """Half of a chi-square's excess over its chance level."""
    return max(0.0, 0.5 * (chi - degrees - CHI2_SIGNIFICANCE * np.sqrt(2.0 * degrees)))


def _autocorrelation_gain(z: list[np.ndarray]) -> float:
    """The gain of an autoregressive model of the innovations.

    The sum of squared correlations (portmanteau) counts a narrow-band disturbance once per lag.
    """
    products = np.zeros(RESIDUAL_LAGS + 1)
    for e in z:
        products += [e[: max(len(e) - k, 0)] @ e[k:] for k in range(RESIDUAL_LAGS + 1)]
    n = sum(len(e) for e in z)
    if products[0] <= 0.0:
        return 0.0
    # A series correlated to the last digit is predicted exactly: the share stays below one.
    predicted = float(products[1:] @ scipy.linalg.solve_toeplitz(products[:-1], products[1:]))
    explained = min(predicted / products[0], 1.0 - 1e-12)
    return _chi2_excess(-n * float(np.log1p(-explained)), RESIDUAL_LAGS)


def _variance_gain(z: list[np.ndarray], length: int) -> float:
    """Scatter of the mean square over short pieces, against that of Gaussian noise with its own tails."""
    squares = [np.minimum(e[: len(e) // length * length].reshape(-1, length) ** 2, 25.0) for e in z
               if len(e) >= length]
    if not squares:
        return 0.0
    squares = np.concatenate(squares)
    # The scatter within windows is the reference: heavy tails alone are no structure.
    within = float(np.mean(np.var(squares, axis=1, ddof=1))) / length
    means = squares.mean(axis=1)
    if within <= 0.0:
        return 0.0
    return _chi2_excess(float(np.sum((means - means.mean()) ** 2) / within), len(means) - 1)


def _halves_gain(model: Model, problem: Problem, passes: Sequence[Filtered]) -> float:
    """The gain if each half of every record had its own parameters (score test).

    From the gradients of the two halves at the common estimate, equal and opposite but for chance; only in
    directions that both halves identify.
    """
    halves = []
    for late in (False, True):
        gains = [ObserverGains(f.gains.gain,
                               f.gains.weight * ((np.arange(len(f.innovations)) >= 0.5 * len(f.innovations))
                                                 == late)[:, None]) for f in passes]
        halves.append(problem.with_memory(model.noise.memory).normal(with_disturbance_state(model.point,
                                                                                            model.noise), gains))
    if not all(np.all(np.isfinite(part)) for h in halves for part in (h.shared, h.slope, *h.own, *h.cross)):
        return 0.0  # a model that diverges: its parameters are not identifiable
    (first, first_slope), (second, second_slope) = (_without_starts(half, halves) for half in halves)
    whole = first + second
    # A parameter without information, on its bound say, is in no direction.
    information = np.diag(whole) * problem.size**2
    if not np.all(np.isfinite(whole)) or not information.max() > 0.0:
        return 0.0
    informative = np.flatnonzero(information > MIN_DIRECTION_INFORMATION**2 * information.max())
    size = np.sqrt(np.diag(whole)[informative])
    eigenvalues, basis = np.linalg.eigh(whole[np.ix_(informative, informative)] / np.outer(size, size))
    good = eigenvalues > MIN_DIRECTION_INFORMATION * eigenvalues.max()
    basis = basis[:, good] / np.sqrt(eigenvalues[good]) / size[:, None]
    first, first_slope, second_slope = (
        first[np.ix_(informative, informative)], first_slope[informative], second_slope[informative])
    share, rotation = np.linalg.eigh(basis.T @ first @ basis)
    both = (share > MIN_HALF_INFORMATION) & (share < 1.0 - MIN_HALF_INFORMATION)
    basis, share = (basis @ rotation)[:, both], share[both]
    difference = (1.0 - share) * (basis.T @ first_slope) - share * (basis.T @ second_slope)
    variance = sum(half.cost for half in halves) / max(problem.count - problem.unknowns, 1)
    return _chi2_excess(float(np.sum(difference**2 / (share * (1.0 - share)))) / variance, int(both.sum()))


def _without_starts(half: Normal, halves: Sequence[Normal]) -> tuple[np.ndarray, np.ndarray]:
    """(matrix, slope) of the parameters by one half of the records, start states eliminated.

    The later half may have no information on these: a small ridge keeps the equations solvable.
    """
    own = tuple(o + START_STATE_RIDGE * np.diag(np.diag(sum(both))) for o, both in zip(
        half.own, zip(*(h.own for h in halves), strict=True), strict=True))
    matrix, slope, _ = schur(replace(half, own=own))
    return matrix, slope


def _mean_gain(z: list[np.ndarray], where: list[np.ndarray]) -> float:
    e, x = np.concatenate(z), np.concatenate(where)
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, RESIDUAL_BINS + 1)))
    if len(edges) < 4:
        return 0.0
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(index, minlength=len(edges) - 1)
    sums = np.bincount(index, weights=e, minlength=len(edges) - 1)
    good = count > 10
    return _chi2_excess(float(np.sum(sums[good] ** 2 / count[good])), int(good.sum()))
