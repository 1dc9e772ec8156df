"""Recordings that go up and down one road: what their constant torques differ by is its slope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from drivetool.drive import AT, Drive
from drivetool.errors import Finding
from drivetool.identify.estimate import Z95, Covariance, Estimate, Parameter
from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from drivetool.logs import Experiment, numbered

STANDARD_GRAVITY = 9.80665  # m/s^2, CGPM 1901
# Probability by chance, below which recordings have constant torques of their own, or intervals no common line.
UNLIKELY = 1e-3
APART = 3.0  # standard deviations: a torque along the way of so many is stated as a slope
IDLE = "motor.idle_torque"


@dataclass(frozen=True)
class Found:
    """A fit of one body, and what its constant torque is made of.

    by_record    recording -> its constant torque, where they differ
    along, std   constant torque that changes sign with the direction of the drive on the road, at the motor; None:
                 the recordings do not tell one
    mean, mean_std  of the constant torque if the recordings are of one road up and down
    """

    estimate: Estimate
    by_record: dict[str, float] = field(default_factory=dict)
    along: float | None = None
    std: float = 0.0
    mean: float = 0.0
    mean_std: float = 0.0


def mean_of_recordings(shared: Estimate, experiments: Sequence[Experiment], start: Drive,
                       options: Options) -> Found:
    """The fit with one constant torque, or where the recordings contradict that, with one of each and their mean.

    Nobody knows of what the recordings are a sample: how they differ goes into the interval of the mean. If they
    are of two groups that agree within, they may be of one road up and down. Parted where their torques lie
    farthest apart, half of the difference acts along the way.

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
    if _agree(values, matrix):
        return _of_one(shared)
    order = np.argsort(values, kind="stable")
    edge = int(np.argmax(np.diff(values[order]))) + 1
    up, down = np.zeros(len(values)), np.zeros(len(values))
    down[order[:edge]], up[order[edge:]] = 1.0 / edge, 1.0 / (len(values) - edge)
    along, mean = 0.5 * (up - down), 0.5 * (up + down)
    whole = _with_mean(found, names, mean, float(along @ values))
    by_record = dict(zip(labels, values.tolist(), strict=True))
    if not all(_agree(values[part], matrix[np.ix_(part, part)]) for part in (order[:edge], order[edge:])):
        return Found(whole, by_record)
    return Found(whole, by_record, float(along @ values), float(np.sqrt(along @ matrix @ along)),
                 float(mean @ values), float(np.sqrt(mean @ matrix @ mean)))


def _agree(values: np.ndarray, matrix: np.ndarray) -> bool:
    """Whether values with a covariance differ by no more than that."""
    between = np.diff(np.eye(len(values)), axis=0)
    distance = between @ values
    chi2 = float(distance @ np.linalg.solve(between @ matrix @ between.T, distance)) if len(values) > 1 else 0.0
    return len(values) < 2 or bool(stats.chi2.sf(chi2, len(values) - 1) > UNLIKELY)


def _of_one(shared: Estimate) -> Found:
    """Where the drive turns both ways, a constant torque is no friction: it acts along the way."""
    both = next((p for p in shared.parameters if p.name == "motor.coulomb" and p.status == "fitted"), None)
    idle = next((p for p in shared.parameters if p.name == IDLE and p.std is not None), None)
    if both is None or idle is None or abs(idle.value) < APART * idle.std:
        return Found(shared)
    return Found(shared, {}, idle.value, idle.std)


def _with_mean(found: Estimate, names: Sequence[str], weights: np.ndarray, apart: float) -> Estimate:
    """The fit with a mean in the place of its recordings' constant torques.

    apart  how far they lie from it, which is a standard deviation of it
    """
    covariance = found.covariance
    line = np.zeros((1, len(covariance.names)))
    line[0, [covariance.names.index(n) for n in names]] = weights
    kept = [i for i, n in enumerate(covariance.names) if n not in names]
    line = np.vstack([np.eye(len(covariance.names))[kept], line])
    matrix = line @ covariance.matrix @ line.T
    matrix[-1, -1] += apart**2
    value, std = float(weights @ [found.drive.values[n] for n in names]), float(np.sqrt(matrix[-1, -1]))
    idle = Parameter(IDLE, value, found.drive.unit(IDLE), found.drive.value(IDLE), std,
                     (value - Z95 * std, value + Z95 * std), std_between=apart)
    values = {n: v for n, v in found.drive.values.items() if AT not in n} | {IDLE: value}
    lines = (*(p for p in found.parameters if AT not in p.name and p.name != IDLE), idle)
    return replace(found, drive=replace(found.drive, values=values, records={}), parameters=lines,
                   covariance=Covariance((*(covariance.names[i] for i in kept), IDLE), matrix))


def slope_of_the_road(found: Found, estimate: Estimate, drive: Drive, target: str) -> list[Finding]:
    """What acts along the way, as a slope where the drive carries a mass at a radius.

    estimate  with the drive's own parameters
    """
    low, high = (min(found.by_record.values()), max(found.by_record.values())) if found.by_record else (0.0, 0.0)
    owner, suffix = target.rpartition(".")[::2]
    if found.along is None and not found.by_record:
        return []
    unit = f"{drive.torque_unit} at the motor"
    if found.along is None or (suffix != "carried_mass" and found.by_record):
        return [Finding(
            "warning", "constant-torque-along",
            f"The recordings have constant torques of their own, {low:.4g} to {high:.4g} {unit}. The stated one is "
            "their mean, and how they differ is in its interval.", dict(found.by_record),
            "Look for what changed between them: a load, a slope, the temperature.")]
    size, std = found.along, found.std
    if suffix != "carried_mass":
        return [Finding(
            "note", "constant-torque-along", f"In both directions {size:.4g} +- {std:.2g} {unit} act.",
            {"torque": size, "std": std}, "Look for what pulls: a weight, a slope, an offset of the torque.")]
    mass = next(p for p in estimate.parameters if p.name == target)
    force = drive.turns()[-1] / estimate.drive.value(f"{owner}.radius")
    slope = 100.0 * force * size / (mass.value * STANDARD_GRAVITY)
    error = abs(slope) * float(np.hypot(std / size, (mass.std or 0.0) / mass.value))
    told = f"In both directions {size:.4g} +- {std:.2g} {unit} act: the road slopes {slope:.3g} +- {error:.1g} %."
    if found.by_record:
        told = (f"The recordings have constant torques of their own, {low:.4g} to {high:.4g} {unit}, and how they "
                f"differ is in the stated interval. If they drive one road up and down, it slopes {slope:.3g} +- "
                f"{error:.1g} %, and the constant torque is {found.mean:.5g} +- {found.mean_std:.2g}.")
    return [Finding(
        "note", "slope-of-the-road", told,
        {"slope_percent": slope, "std": error, "force": force * size} | (
            {"mean": found.mean, "mean_std": found.mean_std} if found.by_record else {}),
        "Where the road is level, look for wind, a load or the temperature.")]
