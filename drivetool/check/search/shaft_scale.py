"""The scale of a shaft torque sensor, fitted together with the drive and with all causes found.

From the motor torque alone a short record identifies it to a few per cent. The remaining error is as large as the
effect of a missing law, but a wrong scale can compensate a missing law: so the scale is fitted last.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from drivetool.check.faults import MIN_SHAFT_SCALE_ERROR, SENSOR_SIGNIFICANCE, rescaled
from drivetool.check.fit import FIT_ERRORS, Masks, Model, all_samples, fit, masked_loss, neg_log_p_corrected
from drivetool.check.search.decision import MIN_GAIN_PER_PARAMETER, MIN_LEAD
from drivetool.check.search.result import SearchResult
from drivetool.drive import GEAR_RATIO_EXPONENTS
from drivetool.identify.noise import minimise_by_parabolas
from drivetool.identify.problem import Point
from drivetool.logs import Experiment
from drivetool.quantity import name_of, parse_name

ROLE = "shaft_torque"
FIRST_SCALE_STEP = 0.01  # relative. A choice: scale errors of a few per cent are expected
MAX_LOG_SCALE = 0.3  # beyond about 30 % the motor torque alone identifies the scale
LOG_SCALE_TOLERANCE = 5e-4  # a choice: 0.05 % is below the standard error; a further fit does not pay
# Powers of the gear ratio by which a parameter of a body is smaller when referred to the motor.
GEAR_RATIO_POWERS = {"inertia": 2, **GEAR_RATIO_EXPONENTS}
MAX_ITERATIONS_PER_SCALE = 4  # a choice: each scale starts from the fit of its neighbour
MAX_CURVATURE_TRIALS = 3  # a choice: intervals that are tried until they span about three standard deviations


class ScaleEstimate(NamedTuple):
    """The records with another scale of their shaft torque.

    factor   by which the sensor is too large; std its standard error
    records, values  corrected by the factor, and the drive fitted to those
    """

    factor: float
    std: float
    records: tuple[Experiment, ...]
    values: Mapping[str, float]


def joint_shaft_scale(search: SearchResult, records: Sequence[Experiment]) -> ScaleEstimate | None:
    """The scale of the shaft torque fitted together with the causes; None: no sensor, or its scale is right.

    records  of the search
    """
    model = search.model
    if ROLE not in model.task.roles.outputs:
        return None
    with suppress(*FIT_ERRORS):
        log, std, lead, other = most_likely_scale(model, all_samples(model.problem))
        factor = float(np.exp(log))
        significant = neg_log_p_corrected(lead, 1) > np.log(1.0 / search.options.error_budget)
        if abs(factor - 1.0) > max(MIN_SHAFT_SCALE_ERROR, SENSOR_SIGNIFICANCE * factor * std) and significant:
            return ScaleEstimate(factor, factor * std, rescaled(records, factor), other.fitted.drive.values)
    return None


def most_likely_scale(model: Model, masks: Masks) -> tuple[float, float, float, Model]:
    """(log of the factor of largest likelihood, its std, its gain, the model with it).

    A torque noise that compensates a wrong scale makes the likelihood far from a parabola: so a line search with
    growing steps comes first. The std is infinite where there is no maximum nearby.
    """
    count, known = measured_samples(model, masks), {0.0: with_scale(model, 1.0, masks)}

    def at(log: float) -> float:
        if log not in known:
            near = min(known, key=lambda other: abs(other - log))
            known[log] = with_scale(known[near], float(np.exp(log - near)), masks)
        return known[log].value + count * log

    first_step = FIRST_SCALE_STEP if at(FIRST_SCALE_STEP) < at(-FIRST_SCALE_STEP) else -FIRST_SCALE_STEP
    bracket = [-first_step, 0.0, first_step]
    while at(bracket[-1]) < at(bracket[-2]) and abs(bracket[-1]) < MAX_LOG_SCALE:
        bracket.append(3.0 * bracket[-1] - 2.0 * bracket[-2])
    log = minimise_by_parabolas(at, np.array(bracket), tolerance=LOG_SCALE_TOLERANCE)
    return log, _std_from_curvature(at, log), at(0.0) - at(log), known[log]


def _std_from_curvature(value: Callable[[float], float], center: float) -> float:
    """Standard deviation from the curvature over about three standard deviations on either side."""
    reach = FIRST_SCALE_STEP
    for _ in range(MAX_CURVATURE_TRIALS):
        curvature = (value(center - reach) - 2.0 * value(center) + value(center + reach)) / reach**2
        if not curvature > 0.0:
            return np.inf
        std = float(1.0 / np.sqrt(curvature))
        if reach < 4.0 * std:
            return std
        reach = 3.0 * std
    return std


def with_scale(model: Model, factor: float, masks: Masks) -> Model:
    """The model fitted to its records with their shaft torque divided by a factor."""
    column = model.task.roles.outputs.index(ROLE)
    divisors = np.where(np.arange(len(model.noise.scale)) == column, factor, 1.0)
    traces = tuple(replace(t, outputs=t.outputs / divisors) for t in model.problem.traces)
    problem, noise = replace(model.problem, traces=traces), replace(model.noise, scale=model.noise.scale / divisors)
    start = min((model.point, _rescaled_start(model, factor)), key=lambda p: masked_loss(problem, p, noise, masks))
    return fit(replace(model, problem=problem, point=start, noise=noise), masks,
               max_iterations=MAX_ITERATIONS_PER_SCALE)


def _rescaled_start(model: Model, factor: float) -> Point:
    """All values behind the shaft divided by the factor, the difference given to the motor: same motion."""
    drive, own = model.fitted.drive, dict(zip(model.task.free, model.point.values.tolist(), strict=True))
    motor, gear_ratios = drive.bodies[0], dict(zip(drive.bodies, drive.gear_ratios(), strict=True))
    for name, value in list(own.items()):
        owner, suffix, _ = parse_name(name)
        if owner in drive.shafts and suffix in ("stiffness", "damping"):
            own[name] = value / factor
        elif owner in drive.bodies[1:] and suffix in GEAR_RATIO_POWERS:
            own[name] = value / factor
            at_motor = name_of(motor, suffix)
            if at_motor in own:
                own[at_motor] += (value - own[name]) * gear_ratios[owner] ** -GEAR_RATIO_POWERS[suffix]
    values = np.clip(np.array(list(own.values())), model.problem.low, model.problem.high)
    return replace(model.point, values=values)


def measured_samples(model: Model, masks: Masks) -> int:
    """Number of shaft torque samples in the masks."""
    column = model.task.roles.outputs.index(ROLE)
    return sum(int(np.isfinite(t.outputs[mask, column]).sum())
               for t, mask in zip(model.problem.traces, masks, strict=True))


def scale_improves_likelihood(again: SearchResult, search: SearchResult, factor: float) -> bool:
    """Whether a search over corrected records is likelier than one over the records as they are."""
    samples = measured_samples(search.model, all_samples(search.model.problem))
    lead = search.model.value - again.model.value - samples * float(np.log(abs(factor)))
    return lead > MIN_LEAD + MIN_GAIN_PER_PARAMETER * (1 + len(again.model.task.free) - len(search.model.task.free))
