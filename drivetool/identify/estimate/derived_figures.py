"""Figures that follow from the parameters: resonances, their damping, the total inertia; forces at a radius."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import Drive, resonances
from drivetool.errors import DriveToolError
from drivetool.identify.estimate.estimate import Covariance, Parameter
from drivetool.quantity import name_of, names_of, quantity_of, record_of

RESONANCE_QUANTITIES = ("inertia", "carried_mass", "stiffness")
# Measured at the machine. Fitted values are relative to them: a figure of the whole drive does not depend on them.
GEOMETRY = ("ratio", "radius")
# Kind of force -> friction it is, unit, power of the lever.
FRICTION_FORCES = {
    "constant": ("idle_torque", "N", 1), "coulomb": ("coulomb", "N", 1), "viscous": ("viscous", "N s/m", 2)}
STD_DIFFERENCE_STEP = 1e-3  # of a standard deviation: difference step; small for curvature, large for rounding
MIN_RELATIVE_STD = 1e-9  # relative std below which it is rounding of the central differences
# Relative change of a figure per relative change of an unknown parameter from which the figure depends on it. A
# choice: 1 % is below the uncertainty of most figures.
MIN_RELATIVE_EFFECT = 1e-2


def derived_figures_of(drive: Drive, lines: Sequence[Parameter], covariance: Covariance | None,
            exact: Collection[str] = ()) -> tuple[Parameter, ...]:
    """One line per figure, with the interval that follows from the covariance of the parameters.

    Where a body has a radius, the friction of the whole drive as forces there. With a shaft, and with all its
    values, resonances and the total inertia. Resonances and anti-resonances from motor torque to motor speed are
    those of the undamped drive. The damping ratio is that of the poles and zeros, with the bodies' friction.
    No interval where a figure depends on a parameter that the record does not identify.

    drive    with its values
    lines    of its parameters; covariance: of those that have intervals
    exact    names that are held on request: they count as known
    returns  none for a drive of one rotor
    source   Tallfors 2005, sec. 2.1
    """
    try:
        figures = _figures_of(drive)
    except (DriveToolError, np.linalg.LinAlgError):
        return ()
    if not figures:
        return ()
    covariance = _finite_part(covariance)
    # Where all inertias and stiffnesses are held or guessed, no figure of them has an interval.
    has_shape = covariance is not None and any(quantity_of(n) in RESONANCE_QUANTITIES for n in covariance.names)
    known = () if covariance is None else covariance.names
    unknown = [p for p in lines if p.std is None and not (p.status == "held" and p.name in exact)
               and not record_of(p.name) and p.name in drive.values and quantity_of(p.name) not in GEOMETRY]
    stds = {} if covariance is None else dict(zip(known, np.sqrt(np.diag(covariance.matrix)), strict=True))
    try:
        slopes = np.array([_figure_derivatives(drive, n, STD_DIFFERENCE_STEP * stds[n], figures) for n in known])
        unknown_of = _moving_parameters(drive, unknown, figures)
    except (DriveToolError, np.linalg.LinAlgError):
        return ()
    slopes = slopes.reshape(len(known), len(figures))
    found = []
    for k, (name, (value, unit)) in enumerate(figures.items()):
        line = Parameter(name=name, value=value, unit=unit)
        has_information = covariance is not None and (has_shape or name.partition("_")[0] in FRICTION_FORCES)
        variance = float(slopes[:, k] @ covariance.matrix @ slopes[:, k]) if has_information else 0.0
        if unknown_of[k] or not MIN_RELATIVE_STD * abs(value) < np.sqrt(max(variance, 0.0)) < np.inf:
            reason = (f"it depends on {', '.join(unknown_of[k])}, for which there is no interval" if unknown_of[k]
                      else "none of its parameters was fitted in this step")
            found.append(line.without_interval(reason, "held"))
            continue
        low = 0.0 if name.startswith(("coulomb_", "viscous_")) else -np.inf  # as the friction itself
        found.append(line.with_interval(float(np.sqrt(variance)), (low, np.inf)))
    return tuple(found)


def _finite_part(covariance: Covariance | None) -> Covariance | None:
    """The part with finite variances."""
    if covariance is None:
        return None
    variances = zip(covariance.names, np.diag(covariance.matrix), strict=True)
    part = covariance.part(n for n, variance in variances if np.isfinite(variance))
    return part if part is not None and np.isfinite(part.matrix).all() else None


def _figures_of(drive: Drive) -> dict[str, tuple[float, str]]:
    """Name -> (value, unit); several of a kind are numbered by frequency."""
    found, count = _friction_forces(drive), {"resonance": 0, "anti-resonance": 0}
    if not drive.shafts or drive.missing():
        return found
    for mode in resonances(drive):
        count[mode.kind] += 1
        name = mode.kind.replace("-", "_") + (str(count[mode.kind]) if count[mode.kind] > 1 else "")
        found[name] = (mode.frequency_hz, "Hz")
        found[f"{name}_damping_ratio"] = (mode.damping_ratio, "")
    found["total_inertia_at_motor"] = (drive.referred_inertia, drive.unit(name_of(drive.bodies[0], "inertia")))
    return found


def _friction_forces(drive: Drive) -> dict[str, tuple[float, str]]:
    """Friction of the whole drive, referred to the mass at the last body with a radius."""
    found: dict[str, tuple[float, str]] = {}
    owner = next((b for b in reversed(drive.bodies) if name_of(b, "radius") in drive.values), None)
    if owner is None or (drive.torque_unit, drive.motion_unit) != ("Nm", "rad"):
        return found
    # Of the motor per metre.
    lever = drive.gear_ratios()[drive.bodies.index(owner)] / drive.values[name_of(owner, "radius")]
    for kind, (suffix, unit, power) in FRICTION_FORCES.items():
        names = [f"total.{suffix}", *names_of(drive.bodies, suffix)]
        if any(drive.values.get(n) for n in names):
            referred = drive.values.get(names[0], drive.referred_to_motor(suffix))
            found[f"{kind}_force_at_{owner}"] = (referred * lever**power, unit)
    return found


def _figure_derivatives(drive: Drive, name: str, step: float, figures: dict[str, tuple[float, str]]) -> list[float]:
    """Derivatives of the figures over a parameter."""
    if name not in drive.values or step == 0.0:
        return [0.0] * len(figures)
    ends = [_figures_of(replace(drive, values={**drive.values, name: drive.values[name] + side * step}))
            for side in (1.0, -1.0)]
    return [(ends[0][n][0] - ends[1][n][0]) / (2.0 * step) if all(n in e for e in ends) else np.nan
            for n in figures]


def _moving_parameters(drive: Drive, unknown: Sequence[Parameter],
                       figures: dict[str, tuple[float, str]]) -> list[list[str]]:
    """Of each figure, the unknown parameters that move it when they change by a tenth, or by their interval."""
    found: list[list[str]] = [[] for _ in figures]
    for p in unknown:
        step = 0.1 * max(abs(drive.values[p.name]), p.ci95[1] - p.ci95[0] if p.ci95 is not None else 0.0)
        low, high = drive.quantity(p.name).bounds
        for k, slope in enumerate(_figure_derivatives(drive, p.name, step, figures) if low < step < high else ()):
            value = list(figures.values())[k][0]
            if not abs(slope * step) < 0.1 * MIN_RELATIVE_EFFECT * abs(value):
                found[k].append(p.name)
    return found
