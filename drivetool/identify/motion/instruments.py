"""The motion as the reference of the loop predicts it: an instrument without the noise that the loop feeds back.

The reference contains no noise. A regression on the reference and its past splits the measured motion into the
predicted part and the rest. The predicted part is the instrument, and the controller need not be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from drivetool.identify.channels import feedback_in
from drivetool.logs import Experiment

REFERENCES = ("reference_angle", "reference_speed", "reference_torque")
# Memories of a loop, in samples: a drive's loop is sampled four to two hundred times in its slowest time constant.
LOOP_TIME_CONSTANTS = np.geomspace(4.0, 200.0, 5)


def reference_of(experiments: Sequence[Experiment], sensor: str) -> tuple[str | None, str]:
    """(the reference that every recording has, None: there is no valid one; why not).

    It must move, and not depend on the sensor: the reference from an outer loop contains the sensor's noise.
    """
    there = [r for r in REFERENCES if all(r in e.signals and _moves(e, r) for e in experiments)]
    valid = [r for r in there if not feedback_in(experiments, sensor, r).significant]
    if valid:
        return valid[0], ""
    return None, f"{there[0]} depends on the motion, as the output of an outer loop" if there else (
        "no reference of the loop is logged")


def _moves(e: Experiment, role: str) -> bool:
    values = np.concatenate([e.signals[role][a:b] for a, b in e.segments])
    return bool(np.isfinite(values).any() and np.nanmax(values) > np.nanmin(values))


def predicted_by_reference(experiments: Sequence[Experiment], sensor: str,
                           reference: str) -> tuple[tuple[Experiment, ...], int]:
    """(the experiments with the prediction by the reference as sensor signal, number of fitted coefficients).

    sensor     role that is replaced; reference: role, of the same motion or a torque
    source     Van den Hof and Schrama 1993, the first of their two stages
    """
    each, own = [_reference_regressors(e, sensor, reference) for e in experiments], 2 * len(experiments)
    # An offset and a drift of each recording's own.
    columns = [np.column_stack([shared, np.zeros((e.size, own))])
               for e, (shared, _) in zip(experiments, each, strict=True)]
    for i, (e, c) in enumerate(zip(experiments, columns, strict=True)):
        place = c.shape[1] - own + 2 * i
        c[:, place], c[:, place + 1] = 1.0, np.linspace(-1.0, 1.0, e.size)
    rows = np.concatenate(columns)
    wanted = np.concatenate([e.signals[sensor] - given for e, (_, given) in zip(experiments, each, strict=True)])
    used = np.isfinite(wanted) & np.isfinite(rows).all(axis=1)
    size = np.sqrt(np.mean(rows[used] ** 2, axis=0))
    size[size == 0.0] = 1.0
    factors = np.linalg.lstsq(rows[used] / size, wanted[used], rcond=1e-10)[0] / size
    made = tuple(replace(e, signals={**e.signals, sensor: given + c @ factors})
                 for e, c, (_, given) in zip(experiments, columns, each, strict=True))
    return made, len(factors)


def _reference_regressors(e: Experiment, sensor: str, reference: str) -> tuple[np.ndarray, np.ndarray]:
    """((n, m) regressors from the reference, (n,) the reference itself in the sensor's unit)."""
    of_angle = reference.endswith("angle")
    given, found = np.full(e.size, np.nan), []
    for first, last in e.segments:
        part = slice(first, last)
        value = _gaps_held(e.signals[reference][part])
        columns = np.column_stack([c for s in _torque_components(value, e.step, reference) for c in _low_passed(s)])
        if reference.endswith("torque"):
            value = np.zeros(len(value))
        if of_angle and sensor.endswith("speed"):
            value, columns = np.gradient(value, e.step), np.gradient(columns, e.step, axis=0)
        elif not of_angle and sensor.endswith("angle"):
            value, columns = (np.cumsum(v, axis=0) * e.step for v in (value, columns))
        given[part] = value
        found.append((part, columns))
    columns = np.full((e.size, found[0][1].shape[1]), np.nan)
    for part, values in found:
        columns[part] = values
    return columns, given


def _torque_components(value: np.ndarray, step: float, reference: str) -> tuple[np.ndarray, ...]:
    """Signals that the required torque of a reference consists of: speed, acceleration and direction."""
    if reference.endswith("torque"):
        return (value,)
    speed = np.gradient(value, step) if reference.endswith("angle") else value
    side = np.sign(np.where(np.abs(speed) > 1e-9 * np.abs(speed).max(), speed, 0.0))
    return speed, np.gradient(speed, step), side


def _low_passed(shape: np.ndarray) -> list[np.ndarray]:
    """A signal, and its low-pass filtered versions with several time constants."""
    found = [shape]
    for samples in LOOP_TIME_CONSTANTS:
        p = np.exp(-1.0 / samples)
        found.append(scipy.signal.lfilter([1.0 - p], [1.0, -p], shape, zi=[p * shape[0]])[0])
    return found


def _gaps_held(values: np.ndarray) -> np.ndarray:
    """The values with gaps filled: a reference holds until the next value."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(last < 0, np.argmax(known), last)]
