"""Recordings that go up and down one road: what their constant torques differ by is its slope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from drivetool.drive.chain import AT, Drive
from drivetool.errors import Finding
from drivetool.identify.estimate import Covariance, Estimate, Parameter
from drivetool.identify.greybox import greybox
from drivetool.identify.options import Options
from drivetool.identify.results import Z95
from drivetool.logs.experiment import Experiment, numbered

STANDARD_GRAVITY = 9.80665  # m/s^2, CGPM 1901
# Probability of the difference between the recordings' constant torques by chance, below which each has its own.
UNLIKELY = 1e-3
APART = 3.0  # standard deviations: a torque along the way of so many is stated as a slope
IDLE = "motor.idle_torque"


@dataclass(frozen=True)
class Found:
    """A fit of one body, and what its constant torque is made of.

    by_record    recording -> its constant torque, where they differ
    along, std   constant torque that changes sign with the direction of the drive on the road, at the motor; None:
                 the recordings do not tell one
    """

    estimate: Estimate
    by_record: dict[str, float] = field(default_factory=dict)
    along: float | None = None
    std: float = 0.0


def mean_of_recordings(shared: Estimate, experiments: Sequence[Experiment], start: Drive,
                       options: Options) -> Found:
    """The fit with one constant torque, or where the recordings contradict that, with one of each and their mean.

    The mean is that of both groups, those that drive up and those that drive down: the recordings are parted where
    their torques lie farthest apart.

    shared  the fit with one constant torque
    """
    if IDLE in options.hold or len(experiments) < 2:
        return _of_one(shared)
    labels = numbered([e.name for e in experiments])
    own = {f"{IDLE}{AT}{label}": start.values[IDLE] for label in labels}
    apart = replace(start, records={label: e.sha256 for label, e in zip(labels, experiments, strict=True)})
    apart = apart.with_values({**start.values, **own})
    found = greybox(experiments, apart, replace(options, free=tuple(own)))
    names, covariance = list(own), found.covariance
    if covariance is None or not set(names) <= set(covariance.names):
        return _of_one(shared)
    places = [covariance.names.index(n) for n in names]
    values = np.array([found.drive.values[n] for n in names])
    matrix = covariance.matrix[np.ix_(places, places)]
    between = np.diff(np.eye(len(values)), axis=0)
    distance = between @ values
    chi2 = float(distance @ np.linalg.solve(between @ matrix @ between.T, distance))
    if stats.chi2.sf(chi2, len(values) - 1) > UNLIKELY:
        return _of_one(shared)
    order = np.argsort(values, kind="stable")
    edge = int(np.argmax(np.diff(values[order]))) + 1
    up, down = np.zeros(len(values)), np.zeros(len(values))
    down[order[:edge]], up[order[edge:]] = 1.0 / edge, 1.0 / (len(values) - edge)
    along = 0.5 * (up - down)
    return Found(_with_mean(found, names, 0.5 * (up + down)), dict(zip(labels, values.tolist(), strict=True)),
                 float(along @ values), float(np.sqrt(along @ matrix @ along)))


def _of_one(shared: Estimate) -> Found:
    """Where the drive turns both ways, a constant torque is no friction: it acts along the way."""
    both = next((p for p in shared.parameters if p.name == "motor.coulomb" and p.status == "fitted"), None)
    idle = next((p for p in shared.parameters if p.name == IDLE and p.std is not None), None)
    if both is None or idle is None or abs(idle.value) < APART * idle.std:
        return Found(shared)
    return Found(shared, {}, idle.value, idle.std)


def _with_mean(found: Estimate, names: Sequence[str], weights: np.ndarray) -> Estimate:
    """The fit with a mean in the place of its recordings' constant torques."""
    covariance = found.covariance
    line = np.zeros((1, len(covariance.names)))
    line[0, [covariance.names.index(n) for n in names]] = weights
    kept = [i for i, n in enumerate(covariance.names) if n not in names]
    line = np.vstack([np.eye(len(covariance.names))[kept], line])
    matrix = line @ covariance.matrix @ line.T
    value, std = float(weights @ [found.drive.values[n] for n in names]), float(np.sqrt(matrix[-1, -1]))
    idle = Parameter(IDLE, value, found.drive.unit(IDLE), found.drive.value(IDLE), std,
                     (value - Z95 * std, value + Z95 * std))
    values = {n: v for n, v in found.drive.values.items() if AT not in n} | {IDLE: value}
    lines = (*(p for p in found.parameters if AT not in p.name and p.name != IDLE), idle)
    return replace(found, drive=replace(found.drive, values=values, records={}), parameters=lines,
                   covariance=Covariance((*(covariance.names[i] for i in kept), IDLE), matrix))


def slope_of_the_road(found: Found, estimate: Estimate, drive: Drive, target: str) -> list[Finding]:
    """What acts along the way, as a slope where the drive carries a mass at a radius.

    estimate  with the drive's own parameters
    """
    if found.along is None:
        return []
    size, where = found.along, " and ".join(found.by_record) if len(found.by_record) == 2 else "the recordings"
    what = (f"The constant torques of {where} differ by {2.0 * size:.4g} +- {2.0 * found.std:.2g} "
            f"{drive.torque_unit} at the motor" if found.by_record else
            f"In both directions {size:.4g} +- {found.std:.2g} {drive.torque_unit} act at the motor")
    mass = next(p for p in estimate.parameters if p.name == target)
    owner, suffix = target.rpartition(".")[::2]
    if suffix != "carried_mass":
        return [Finding("note", "constant-torque-along", f"{what}.", {"torque": size, "std": found.std},
                        "Look for what changed between them: a load, a slope, the temperature.")]
    force = drive.turns()[-1] / estimate.drive.value(f"{owner}.radius")
    slope = 100.0 * force * size / (mass.value * STANDARD_GRAVITY)
    std = abs(slope) * float(np.hypot(found.std / size, (mass.std or 0.0) / mass.value))
    mean = " The stated constant torque is the mean of up and down." if found.by_record else ""
    return [Finding(
        "note", "slope-of-the-road",
        f"{what}: a slope of the road of {slope:.3g} +- {std:.1g} %, if both directions are of one road.{mean}",
        {"slope_percent": slope, "std": std, "force": force * size},
        "Where the road is level, look for wind, a load or the temperature.")]
