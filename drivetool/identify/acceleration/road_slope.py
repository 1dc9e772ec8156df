"""Recordings up and down one road: the difference of their constant torques gives its slope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance, Estimate, line_of
from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from drivetool.logs import Experiment, number_duplicates
from drivetool.quantity import name_of, parse_name, record_of, with_parts

STANDARD_GRAVITY = 9.80665  # m/s^2, CGPM 1901
# Probability by chance, below which recordings have different constant torques, or intervals no common line. A
# choice: one false alarm in a thousand records.
RECORDINGS_DIFFER_SIGNIFICANCE = 1e-3
# Standard deviations of a torque from zero, from which it is stated as a slope: 99.7 % of a normal one.
ROAD_SLOPE_SIGNIFICANCE = 3.0
IDLE_TORQUE = "motor.idle_torque"


@dataclass(frozen=True)
class RoadFit:
    """A fit of one body, and the parts of its constant torque.

    by_record    recording -> its constant torque, where they differ
    along, std   constant torque that changes sign with the direction of the drive on the road, at the motor; None:
                 the recordings identify none
    mean, mean_std  of the constant torque if the recordings are of one road up and down
    """

    estimate: Estimate
    by_record: dict[str, float] = field(default_factory=dict)
    along: float | None = None
    std: float = 0.0
    mean: float = 0.0
    mean_std: float = 0.0


def fit_with_mean_torque(shared: Estimate, experiments: Sequence[Experiment], start: Drive,
                       options: Options) -> RoadFit:
    """The fit with one constant torque, or where the recordings contradict that, with one of each and their mean.

    The population of the recordings is unknown: their scatter is included in the interval of the mean. Two groups
    that agree within may be of one road up and down. They are divided at the largest difference of neighbouring
    torques; half of the difference of the groups acts along the road.

    shared  the fit with one constant torque
    """
    if IDLE_TORQUE in options.hold or len(experiments) < 2:
        return _with_common_torque(shared)
    labels = number_duplicates([e.name for e in experiments])
    own = {with_parts(IDLE_TORQUE, record=label): start.values[IDLE_TORQUE] for label in labels}
    separate = replace(start, records={label: e.sha256 for label, e in zip(labels, experiments, strict=True)})
    separate = separate.with_values({**start.values, **own})
    found = greybox(experiments, separate, replace(options, free=tuple(own)))
    names, covariance = list(own), found.covariance
    if covariance is None or not set(names) <= set(covariance.names):
        return _with_common_torque(shared)
    values = np.array([found.drive.values[n] for n in names])
    matrix = covariance.part(names).matrix
    if _values_agree(values, matrix):
        return _with_common_torque(shared)
    order = np.argsort(values, kind="stable")
    edge = int(np.argmax(np.diff(values[order]))) + 1
    up, down = np.zeros(len(values)), np.zeros(len(values))
    down[order[:edge]], up[order[edge:]] = 1.0 / edge, 1.0 / (len(values) - edge)
    along, mean = 0.5 * (up - down), 0.5 * (up + down)
    whole = _with_mean(found, names, mean, float(along @ values))
    by_record = dict(zip(labels, values.tolist(), strict=True))
    if not all(_values_agree(values[part], matrix[np.ix_(part, part)]) for part in (order[:edge], order[edge:])):
        return RoadFit(whole, by_record)
    return RoadFit(whole, by_record, float(along @ values), float(np.sqrt(along @ matrix @ along)),
                 float(mean @ values), float(np.sqrt(mean @ matrix @ mean)))


def _values_agree(values: np.ndarray, matrix: np.ndarray) -> bool:
    """Whether values with a covariance differ by no more than that."""
    between = np.diff(np.eye(len(values)), axis=0)
    distance = between @ values
    chi2 = float(distance @ np.linalg.solve(between @ matrix @ between.T, distance)) if len(values) > 1 else 0.0
    return len(values) < 2 or bool(scipy.stats.chi2.sf(chi2, len(values) - 1) > RECORDINGS_DIFFER_SIGNIFICANCE)


def _with_common_torque(shared: Estimate) -> RoadFit:
    """In a drive that turns in both directions, a constant torque is no friction: it acts along the road."""
    both = next((p for p in shared.parameters if p.name == "motor.coulomb" and p.status == "fitted"), None)
    idle = next((p for p in shared.parameters if p.name == IDLE_TORQUE and p.std is not None), None)
    if both is None or idle is None or abs(idle.value) < ROAD_SLOPE_SIGNIFICANCE * idle.std:
        return RoadFit(shared)
    return RoadFit(shared, {}, idle.value, idle.std)


def _with_mean(found: Estimate, names: Sequence[str], weights: np.ndarray, distance: float) -> Estimate:
    """The fit with a mean in place of the recordings' constant torques.

    distance  half of the difference of their groups, a standard deviation of the mean
    """
    covariance = found.covariance
    line = np.zeros((1, len(covariance.names)))
    line[0, [covariance.names.index(n) for n in names]] = weights
    kept = [i for i, n in enumerate(covariance.names) if n not in names]
    line = np.vstack([np.eye(len(covariance.names))[kept], line])
    matrix = line @ covariance.matrix @ line.T
    matrix[-1, -1] += distance**2
    value = float(weights @ [found.drive.values[n] for n in names])
    idle = line_of(found.drive, IDLE_TORQUE, value).replace(start=found.drive.value(IDLE_TORQUE)).with_interval(
        float(np.sqrt(matrix[-1, -1])), std_between=distance)
    values = {n: v for n, v in found.drive.values.items() if not record_of(n)} | {IDLE_TORQUE: value}
    lines = (*(p for p in found.parameters if not record_of(p.name) and p.name != IDLE_TORQUE), idle)
    return replace(found, drive=replace(found.drive, values=values, records={}), parameters=lines,
                   covariance=Covariance((*(covariance.names[i] for i in kept), IDLE_TORQUE), matrix))


def road_slope_findings(found: RoadFit, estimate: Estimate, drive: Drive, target: str) -> list[Finding]:
    """Findings on the torque along the road, as a slope where the drive carries a mass at a radius.

    estimate  with the drive's own parameters
    """
    low, high = (min(found.by_record.values()), max(found.by_record.values())) if found.by_record else (0.0, 0.0)
    owner, suffix, _ = parse_name(target)
    if found.along is None and not found.by_record:
        return []
    unit = f"{drive.torque_unit} at the motor"
    if found.along is None or (suffix != "carried_mass" and found.by_record):
        return [Finding(
            "warning", "constant-load",
            f"The recordings have different constant torques, {low:.4g} to {high:.4g} {unit}. The stated "
            "constant torque is their mean, and its interval includes their scatter.", dict(found.by_record),
            "Look for what changed between them: a load, a slope, the temperature.")]
    size, std = found.along, found.std
    if suffix != "carried_mass":
        return [Finding(
            "note", "constant-load", f"A constant torque of {size:.4g} +- {std:.2g} {unit} acts, independent of "
            "the direction of motion.", {"torque": size, "std": std},
            "Look for the cause: a weight, a slope, an offset of the torque channel.")]
    mass = estimate.line(target)
    force = drive.gear_ratios()[-1] / estimate.drive.value(name_of(owner, "radius"))
    slope = 100.0 * force * size / (mass.value * STANDARD_GRAVITY)
    error = abs(slope) * float(np.hypot(std / size, (mass.std or 0.0) / mass.value))
    text = (f"A constant torque of {size:.4g} +- {std:.2g} {unit} acts, independent of the direction of motion: "
            f"the slope of the road is {slope:.3g} +- {error:.1g} %.")
    if found.by_record:
        text = (f"The recordings have different constant torques, {low:.4g} to {high:.4g} {unit}, and the stated "
                f"interval includes their scatter. If they were recorded on one road in both directions, its slope "
                f"is {slope:.3g} +- {error:.1g} %, and the constant torque is {found.mean:.5g} +- "
                f"{found.mean_std:.2g}.")
    return [Finding(
        "note", "constant-load", text,
        {"slope_percent": slope, "std": error, "force": force * size} | (
            {"mean": found.mean, "mean_std": found.mean_std} if found.by_record else {}),
        "Where the road is level, look for wind, a load or the temperature.")]
