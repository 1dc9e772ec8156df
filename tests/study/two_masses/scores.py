"""Errors and coverage of intervals from the rows of a results file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tests.study.missing_laws.scores import ROUNDING
from tests.study.two_masses.estimators import HALF_GAP, NAMES

SINGLE = ("motor.inertia", "load.inertia", "shaft.stiffness", HALF_GAP)  # parameters that have a truth each
VISCOUS = ("motor.viscous", "load.viscous", "total.viscous")
COULOMB = ("motor.coulomb", "load.coulomb")
IDLE = ("motor.idle_torque", "load.idle_torque", "total.idle_torque")
# What intervals are about, with the number of places where each is looked at.
ABOUT = {"motor inertia": 1, "load inertia": 1, "stiffness": 1, "friction": 3, "half gap": 1}


@dataclass(frozen=True)
class Score:
    """One estimator on one record; errors and half-widths are absolute, NaN where there is no answer or interval.

    motor_inertia, load_inertia, stiffness, half_gap  errors over the truth; the gap's only where the model has one
    friction  root mean square error of the curve over its mean, over the speeds visited
    idle      error of the idle torque over rated torque
    ..._half  half-widths over the same, of friction at the middle mark
    over      (k,) error over half-width per name of ABOUT; friction at three marks against the nearest line
    seconds   of processor time
    """

    seconds: float
    motor_inertia: float = np.inf
    load_inertia: float = np.inf
    stiffness: float = np.inf
    half_gap: float = np.nan
    friction: float = np.inf
    idle: float = np.inf
    motor_inertia_half: float = np.nan
    load_inertia_half: float = np.nan
    stiffness_half: float = np.nan
    half_gap_half: float = np.nan
    friction_half: float = np.nan
    over: Mapping[str, np.ndarray] = field(
        default_factory=lambda: {name: np.full(k, np.nan) for name, k in ABOUT.items()})


def score(row: Mapping) -> Score:
    """What a row is worth; a failed fit has errors without bound, so that it counts in every quantile."""
    gap = row.get("gap", False)
    if row.get("failed"):
        return Score(row["seconds"], half_gap=np.inf if gap else np.nan)
    truth, value = row["truth"], dict(zip(NAMES, row["value"], strict=True))
    curve, mean = np.array(truth["curve"]), float(np.mean(truth["curve"]))
    marks = np.array(truth["marks"])
    viscous, coulomb, idle = (sum(value[name] or 0.0 for name in names) for names in (VISCOUS, COULOMB, IDLE))
    true = np.array([truth["motor_inertia"], truth["load_inertia"], truth["stiffness"],
                     truth["half_gap"] if gap else np.nan])
    errors = np.abs(np.array([np.inf if value[name] is None else value[name] for name in SINGLE]) - true)
    halves = np.where(np.isnan(true), np.nan, half_widths(row)[[NAMES.index(name) for name in SINGLE]])
    nearest = truth["line"][0] * marks + truth["line"][1]
    friction_halves = friction_half(row, marks)
    on_line = _over(np.abs(viscous * marks + coulomb - nearest), friction_halves, nearest)
    single = _over(errors, halves, true)[:, None]
    wrong = viscous * np.array(truth["speeds"]) + coulomb - curve
    return Score(
        row["seconds"], *map(float, errors / true), float(np.sqrt(np.mean(wrong**2))) / mean,
        abs(idle - truth["idle"]) / truth["rated"], *map(float, halves / true), float(friction_halves[1]) / mean,
        dict(zip(ABOUT, (*single[:3], on_line, single[3]), strict=True)))


def half_widths(row: Mapping) -> np.ndarray:
    """Half the stated 95 % intervals in the order of NAMES, NaN where none is stated."""
    return np.array([np.nan if not ends or None in ends else 0.5 * (ends[1] - ends[0]) for ends in row["ci95"]])


def friction_half(row: Mapping, marks: np.ndarray) -> np.ndarray:
    """(n,) half-widths [N m] of the friction of both bodies at speeds, NaN where a part of it has no interval.

    They are as many of its stds as the tool's own intervals are of theirs.
    """
    fitted = [i for i, name in enumerate(NAMES) if name in (*VISCOUS, *COULOMB) and row["value"][i] is not None
              and row["status"][i] != "held"]
    link = np.array([[np.nan if row["correlation"][i][j] is None else row["correlation"][i][j] for j in fitted]
                     for i in fitted]).reshape(len(fitted), len(fitted))
    by_speed = np.array([NAMES[i] in VISCOUS for i in fitted], bool)
    parts = half_widths(row)[fitted] * np.where(by_speed, marks[:, None], 1.0)
    return np.sqrt(np.maximum(np.einsum("mi,ij,mj->m", parts, link, parts), 0.0))


def _over(errors: np.ndarray, halves: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(n,) errors over half-widths; zero where the error is mere rounding, infinite where the width is zero."""
    over = np.divide(errors, halves, out=np.full(len(errors), np.inf), where=halves != 0.0)
    return np.where(errors > ROUNDING * np.abs(true), over, 0.0 * halves)
