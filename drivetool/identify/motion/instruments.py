"""The motion as the reference of the loop foretells it: noise of sensor and torque is in the one it fed back into.

The reference is not moved by noise. Regressed on it and its past, the measured motion splits into what the
reference makes of it and the rest; the first serves as instrument, and no knowledge of the controller is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from drivetool.identify.channels import feedback_in
from drivetool.logs import Experiment

REFERENCES = ("reference_angle", "reference_speed", "reference_torque")
# Memories of a loop, in samples: a drive's loop is sampled four to two hundred times in its slowest time constant.
MEMORIES = np.geomspace(4.0, 200.0, 5)


def reference_of(experiments: Sequence[Experiment], sensor: str) -> tuple[str | None, str]:
    """(the reference that every recording has, None: there is no valid one; why not).

    It must move, and not answer the sensor: what an outer loop asks for has the sensor's noise in it.
    """
    there = [r for r in REFERENCES if all(r in e.signals and _moves(e, r) for e in experiments)]
    valid = [r for r in there if not feedback_in(experiments, sensor, r).there]
    if valid:
        return valid[0], ""
    return None, f"{there[0]} answers the motion, as what an outer loop asks for" if there else (
        "no reference of the loop is logged")


def _moves(e: Experiment, role: str) -> bool:
    values = np.concatenate([e.signals[role][a:b] for a, b in e.segments])
    return bool(np.isfinite(values).any() and np.nanmax(values) > np.nanmin(values))


def foretold(experiments: Sequence[Experiment], sensor: str, reference: str) -> tuple[tuple[Experiment, ...], int]:
    """(the experiments with what the reference foretells in place of the sensor's signal, numbers fitted for that).

    sensor     role that is replaced; reference: role, of the same motion or a torque
    source     Van den Hof and Schrama 1993, the first of their two stages
    """
    each, own = [_columns(e, sensor, reference) for e in experiments], 2 * len(experiments)
    # A zero and a drift of each recording's own.
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


def _columns(e: Experiment, sensor: str, reference: str) -> tuple[np.ndarray, np.ndarray]:
    """((n, m) what a loop may make of the reference, (n,) the reference itself in the sensor's unit)."""
    of_angle = reference.endswith("angle")
    given, found = np.full(e.size, np.nan), []
    for first, last in e.segments:
        part = slice(first, last)
        value = _bridged(e.signals[reference][part])
        columns = np.column_stack([c for s in _shapes(value, e.step, reference) for c in _remembered(s)])
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


def _shapes(value: np.ndarray, step: float, reference: str) -> tuple[np.ndarray, ...]:
    """Torque that a reference asks for: of an angle by its speed, direction and acceleration."""
    if reference.endswith("torque"):
        return (value,)
    speed = np.gradient(value, step) if reference.endswith("angle") else value
    side = np.sign(np.where(np.abs(speed) > 1e-9 * np.abs(speed).max(), speed, 0.0))
    return speed, np.gradient(speed, step), side


def _remembered(shape: np.ndarray) -> list[np.ndarray]:
    """A signal, and what memories of several lengths keep of it."""
    found = [shape]
    for samples in MEMORIES:
        p = np.exp(-1.0 / samples)
        found.append(lfilter([1.0 - p], [1.0, -p], shape, zi=[p * shape[0]])[0])
    return found


def _bridged(values: np.ndarray) -> np.ndarray:
    """Without missing values: a reference stays until the next."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(last < 0, np.argmax(known), last)]
