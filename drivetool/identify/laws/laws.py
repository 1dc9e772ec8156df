"""Laws that a drive may lack, as torques over its motion: removed as known torques, each with a factor.

A law is a nuisance here, not a parameter of the drive: `diagnose` identifies causes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from drivetool.finding import Finding
from drivetool.identify.estimate import FoundLaw
from drivetool.identify.motion import Motion, Motions
from drivetool.logs import Experiment
from drivetool.quantity import name_of

STRIBECK_NAME = "Stribeck friction"  # as the names of these laws begin
STRIBECK_WIDTHS = (0.02, 0.05, 0.1, 0.2)  # of a Stribeck peak, over the top speed: a decade in steps of two
# Of the time in each direction, a choice: less leaves Coulomb friction and idle torque collinear.
MIN_DIRECTION_SHARE = 0.02
ANGLE_BINS = 64  # bins of a period, a choice: fine against the harmonics 1 and 2, coarse enough to be visited
# Share of its power that a wave over the angle may have as a constant. A drive that hardly turns does not identify
# the period: such a wave is collinear with inertia and idle torque.
MAX_CONSTANT_SHARE = 0.5
# Of the torque for a law, of the value for a disagreement; a choice: less is not reported.
MIN_REPORTED_SHARE = 0.01
TORQUE_HARMONICS = range(3, 41)  # of the angle, above the two that gravity and a crank have


Part = Literal["friction", "inertia", "idle torque", "nothing"]
MEASUREMENT_NOISE = "measurement noise of the logged torque"


@dataclass(frozen=True)
class Law:
    """A torque that brakes a body, over its motion.

    name     as reported
    columns  one array per experiment, a row (m,) per sample where it is known, of size one
    of       what of the body it is a part of: friction that is alike in both directions, inertia, or the idle
             torque, of which it has the mean; or nothing
    inertia  (m,) of which it has this share
    body     that it brakes
    parameter  of the drive that the law is equal to, to be freed in its place
    positive   whether its first factor is positive in any drive
    known      (n,) per experiment where it is known, which leaves pauses out; None: everywhere
    """

    name: str
    columns: tuple[np.ndarray, ...]
    of: Part
    inertia: np.ndarray | None = None
    body: str = "motor"
    parameter: str = ""
    positive: bool = False
    known: tuple[np.ndarray, ...] | None = None

    @property
    def size(self) -> int:
        """How many columns it has."""
        return self.columns[0].shape[1]

    def on_grid(self, experiment: int) -> np.ndarray:
        """(n, m) its columns over all samples of the experiment of that number; NaN where it is not known."""
        if self.known is None:
            return self.columns[experiment]
        found = np.full((len(self.known[experiment]), self.size), np.nan)
        found[self.known[experiment]] = self.columns[experiment]
        return found


def places_of(laws: Sequence[Law], first: int = 0) -> list[slice]:
    """The columns of each law in a table of all of them, whose columns begin there."""
    return [slice(a, b) for a, b in pairwise(np.cumsum([first, *(law.size for law in laws)]).tolist())]


def measurement_noise_law(noise: Sequence[np.ndarray]) -> tuple[Law, ...]:
    """Measurement noise of the logged motor torque as a law, if there is any.

    noise  per experiment (n,) what is likely to be noise of the logged torque
    """
    size = float(np.sqrt(np.mean(np.concatenate(noise) ** 2)))
    return (Law(MEASUREMENT_NOISE, tuple(n[:, None] / size for n in noise), "nothing",
                positive=True),) if size > 0.0 else ()


def law_library(body_motions: Motions, turns: bool, body: str = "motor", name_suffix: str = "") -> tuple[Law, ...]:
    """Every law over the motion of a body.

    turns  whether it turns, so that its torque may repeat with the angle
    body   whose motion it is
    among  what is added to the names, so that they say which body it is
    """
    motions, top = body_motions.each, body_motions.top
    longest = max(m.time[-1] - m.time[0] for m in motions)
    found = []

    def law(name: str, of: Callable[[Motion, np.ndarray, np.ndarray], Sequence[np.ndarray]],
            part: Part = "idle torque", inertia: np.ndarray | None = None, parameter: str = "") -> None:
        columns = [np.column_stack(of(m, m.speed / top, 2.0 * (m.time - m.time[0]) / longest - 1.0))
                   for m in motions]
        size = np.sqrt(np.nanmean(np.concatenate(columns) ** 2, axis=0))
        if np.all(np.isfinite(size)) and np.all(size > 1e-9 * np.nanmax(np.abs(np.concatenate(columns)))):
            share = None if inertia is None else inertia / size
            known = tuple(np.isfinite(c).all(axis=1) for c in columns)
            found.append(Law(name + name_suffix, tuple(c[k] / size for c, k in zip(columns, known, strict=True)),
                             part, share, body, parameter, known=known))

    if moves_in_both_directions(motions):
        law("direction-dependent friction", lambda m, v, t: [np.abs(v)])
        law("time-varying friction", lambda m, v, t: [t * m.side])
    if body != "motor":
        law("dry friction", lambda m, v, t: [m.side], "friction", parameter=name_of(body, "coulomb"))
    law("friction that grows with the square of the speed", lambda m, v, t: [v * np.abs(v)], "friction")
    for w in STRIBECK_WIDTHS:
        law(f"{STRIBECK_NAME} with a Stribeck speed of {w:g} times the maximum speed",
            lambda m, v, t, w=w: [m.side * np.exp(-(v / w) ** 2)], "friction")
    law("torque changing linearly with time", lambda m, v, t: [t])
    orders = [k for k in (1, 2, *TORQUE_HARMONICS) if turns
              and np.sum(_mean_over_angles(motions, k) ** 2) < MAX_CONSTANT_SHARE]
    for k, name in ((1, "inertia varying once per turn"), (2, "inertia varying twice per turn")):
        if k in orders:
            law(name, lambda m, v, t, k=k: [
                m.acceleration * np.cos(k * m.angle) - 0.5 * k * m.speed**2 * np.sin(k * m.angle),
                m.acceleration * np.sin(k * m.angle) + 0.5 * k * m.speed**2 * np.cos(k * m.angle)],
                "inertia", _mean_over_angles(motions, k))
    for k in orders:
        law(f"torque ripple of order {k}",
            lambda m, v, t, k=k: [np.cos(k * m.angle), np.sin(k * m.angle)])
    return tuple(found)


def moves_in_both_directions(motions: Sequence[Motion]) -> bool:
    """Whether the motor turns both ways: with one direction, a part that differs by it is friction itself."""
    side = np.concatenate([np.where(m.slow, 0.0, m.side) for m in motions])  # at standstill the sign is noise
    return bool(min(np.mean(side > 0.0), np.mean(side < 0.0)) > MIN_DIRECTION_SHARE)


def _mean_over_angles(motions: Sequence[Motion], order: int) -> np.ndarray:
    """(2,) mean of the cosine and sine of a multiple of the angle over the angles visited, each counted once.

    Over time it would follow the motion, whose acceleration is larger where the inertia is less.
    """
    phase = order * np.concatenate([m.angle for m in motions]) / (2.0 * np.pi)
    bins = np.unique(np.floor(np.mod(phase[np.isfinite(phase)], 1.0) * ANGLE_BINS))
    centres = 2.0 * np.pi * (bins + 0.5) / ANGLE_BINS
    return np.array([np.cos(centres).mean(), np.sin(centres).mean()])


def significant_laws(laws: Sequence[FoundLaw], experiments: Sequence[Experiment]) -> dict[str, float]:
    """The laws with more than a hundredth of the motor's torque, each with its share."""
    torque = np.concatenate([e.signals["motor_torque"][a:b] for e in experiments for a, b in e.segments])
    size = float(np.sqrt(np.mean(torque**2)))
    return {law.name: float(np.linalg.norm(law.factors)) / size for law in laws
            if np.linalg.norm(law.factors) > MIN_REPORTED_SHARE * size}


def model_error(shares: Mapping[str, float], guess: str | None = None) -> Finding:
    """The finding on a drive model that lacks a law.

    heavy  laws with their shares of the torque; guess: the one to report, None: the largest
    """
    guess = guess or (max(shares, key=shares.__getitem__) if shares else None)
    text = "The model lacks a physical effect" + (f" (most likely {guess})" if guess else "")
    return Finding(
        "warning", "model-error", f"{text}; a noise model would hide it.",
        {f"share of the torque: {n}": s for n, s in shares.items()},
        "Run diagnose on this file; intervals, where there are any, include the differences between the candidate "
        "models.")
