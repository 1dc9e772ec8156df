"""From a polynomial model to the chain that has its response: inertias, stiffnesses, damping, friction.

The continued fraction of cauer.py gives the chain without damping. A chain of n bodies has 4 n - 2 such
parameters, and a model of order 2 n - 1 as many coefficients: from there the two responses are made equal,
and the covariance of the coefficients goes over to the parameters without a further assumption.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive, chain_alone, state_space
from drivetool.identify.estimate import (
    Z95_ONE_SIDED,
    Covariance,
    Parameter,
    held_line,
    line_of,
    std_by_gradient,
    whole_table,
)
from drivetool.identify.frequency import LineProblem
from drivetool.identify.polynomial.cauer import chain_of
from drivetool.identify.polynomial.pem_figures import MAX_RINGING_DAMPING, ModelFigures
from drivetool.identify.problem import Point, solve
from drivetool.identify.setup import HeldResponse
from drivetool.quantity import name_of, names_of

# Frequencies at which responses are compared, a choice: several per parameter of a chain of four bodies.
RESPONSE_POINTS = 60
TARGET_RESPONSE_RMS = 1e-9  # rms of the relative difference at which the search ends: some digits above rounding
# The same up to which two responses are equal, a choice: far below the noise of any record.
MAX_EQUAL_RESPONSE_RMS = 1e-4
ChainValues = dict[str, tuple[float, float | None]]


def undamped_start_values(drive: Drive, f: ModelFigures) -> dict[str, float]:
    """Start values by the continued fraction; empty if the model has no such chain.

    Friction is shared in proportion to inertia; shaft damping follows from the damping ratio of the resonance.
    """
    n = len(drive.bodies)
    if len(f.resonances) != n - 1 or len(f.notches) != n - 1:
        return {}
    slow = [r.s.real for r in f.poles if r.s.imag == 0.0]
    pole = -min(slow, key=abs) if slow else 0.0
    z, p = (np.array([x.rad_s for x in pairs]) for pairs in (f.notches, f.resonances))
    w = 0.5 * z[0] if n > 1 else np.pi / f.step / 50.0
    g = abs(f.response(np.array([w / (2.0 * np.pi)]))[0][0])
    total = np.prod(1.0 - (w / z) ** 2) / np.prod(1.0 - (w / p) ** 2) / (g * abs(1j * w + pole))
    inertias, stiffnesses = chain_of(float(total), z, p)
    if not inertias:
        return {}
    found, square = {}, 1.0
    for i, body in enumerate(drive.bodies):
        if i:
            shaft, pair = drive.shafts[i - 1], f.resonances[i - 1]
            square *= (drive.value(name_of(shaft, "ratio")) or 1.0) ** 2
            found[name_of(shaft, "stiffness")] = stiffnesses[i - 1] * square
            found[name_of(shaft, "damping")] = 2.0 * max(pair.damping,
                                                         0.0) / pair.rad_s * found[name_of(shaft, "stiffness")]
        found |= _inertia_or_carried_mass(drive, body, inertias[i] * square)
        found[name_of(body, "viscous")] = max(pole, 0.0) * inertias[i] * square
    return found


def _inertia_or_carried_mass(drive: Drive, body: str, inertia: float) -> dict[str, float]:
    """Name -> value of the parameter that sets an inertia: the mass that a body carries, else its own inertia."""
    if not drive.value(name_of(body, "carried_mass")):
        return {name_of(body, "inertia"): inertia}
    radius, own = drive.value(name_of(body, "radius")), drive.value(name_of(body, "inertia")) or 0.0
    return {name_of(body, "carried_mass"): max(inertia - own, 0.01 * inertia) / radius**2}


def conversion(drive: Drive, f: ModelFigures, differenced: int = 0) -> tuple[ChainValues, Covariance | None, str]:
    """(name -> (value, std), covariance, why there is none).

    drive        a chain of n bodies; its ratios are used, its converter takes no part
    differenced  1 if the output is the mean speed over an interval
    """
    n, s = len(drive.bodies), f.fit.structure
    start = {} if f.unstable else undamped_start_values(drive, f)
    if not start:
        return {}, None, (
            f"a chain of {n} bodies has {n - 1} anti-resonances and resonances that alternate, anti-resonance "
            f"first; the model of order {s.order} has "
            f"{len(f.notches)} and {len(f.resonances)}" + (", and is unstable" if f.unstable else ""))
    names = tuple(name for name in drive.quantities if name in start)
    problem = _response_problem(drive.with_values(start), names, f, differenced)
    start_point = Point(np.array([start[name] for name in names]), ())
    solution = solve(problem, start_point, max_iterations=200, relative=1e-14,
                     target_cost=RESPONSE_POINTS * TARGET_RESPONSE_RMS**2)
    r, j = problem.residual(solution.point.values)
    if s.order != 2 * n - 1 or np.sqrt(np.mean(np.abs(r) ** 2)) > MAX_EQUAL_RESPONSE_RMS:
        return {name: (value, None) for name, value in start.items()}, None, ""
    # Both sides as real numbers: the change of the response with the parameters is that with the coefficients.
    over_parameters, over_coefficients = (
        np.vstack([slopes.real, slopes.imag]) for slopes in (j, f.slopes(problem.model.frequency)[1]))
    size = np.linalg.norm(over_parameters, axis=0)
    table = np.linalg.lstsq(over_parameters / size, over_coefficients, rcond=1e-12)[0] / size[:, None]
    matrix = table @ f.fit.covariance @ table.T
    stds = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    found = {name: (float(v), float(d) if np.isfinite(d) and d > 0.0 else None)
             for name, v, d in zip(names, solution.point.values, stds, strict=True)}
    return found, Covariance(names, matrix), ""


def ringing_frequencies(drive: Drive) -> dict[str, float]:
    """|s| of the ringing zeros and poles of the drive in continuous time [rad/s]: notch 1, ..., resonance 1, ..."""
    a, _, _, _ = state_space(chain_alone(drive))
    found = {}
    # The torque enters where the speed is measured: its zeros are the poles with that body held.
    for label, matrix in (("notch", a[1:, 1:]), ("resonance", a)):
        pairs = sorted(abs(s) for s in np.linalg.eigvals(matrix) if s.imag > 0.0
                       and abs(s.real) < MAX_RINGING_DAMPING * abs(s))
        found |= {f"{label} {i}": float(w) for i, w in enumerate(pairs, 1)}
    return found


def ringing_frequencies_with_std(drive: Drive, found: Mapping[str, tuple[float, float | None]],
                                 covariance: Covariance,
                                ) -> dict[str, tuple[float, float | None]]:
    """name -> (rad/s, std) of the drive that a conversion found.

    The zeros of a sampled model are not those of the drive: holding the torque moves a notch, by little, but
    by more than its interval where noise is low.
    """
    values = {**drive.values, **{name: v for name, (v, _) in found.items()}}
    plain = replace(drive, values={n: v for n, v in values.items() if n != "total.viscous"})
    centre, table = ringing_frequencies(plain), {}
    for name in covariance.names:
        d = 1e-6 * max(abs(values[name]), 1e-12)
        up, down = (ringing_frequencies(replace(plain, values=plain.values | {name: values[name] + x}))
                    for x in (d, -d))
        table[name] = {k: (up.get(k, np.nan) - down.get(k, np.nan)) / (2.0 * d) for k in centre}
    return {k: (w, std_by_gradient(np.array([table[name][k] for name in covariance.names]), covariance.matrix))
            for k, w in centre.items()}


def _response_problem(drive: Drive, names: tuple[str, ...], f: ModelFigures, differenced: int) -> LineProblem:
    """The problem of making the chain's response equal to the model's."""
    low = 0.05 * (f.notches[0].rad_s if f.notches else np.pi / f.step / 50.0)
    high = min(2.0 * (f.resonances[-1].rad_s if f.resonances else 20.0 * low), 0.8 * np.pi / f.step)
    hz = np.geomspace(low, high, RESPONSE_POINTS) / (2.0 * np.pi)
    g, _ = f.response(hz)
    if differenced:
        w = 2j * np.pi * hz * f.step
        g = g * w / -np.expm1(-w)
    plain = Drive(drive.name, drive.bodies, drive.shafts, chain_alone(drive).values, drive.torque_unit,
                  drive.motion_unit)
    k = len(names)
    return LineProblem(HeldResponse(plain, names, "motor_speed", f.step, hz), g, np.ones(RESPONSE_POINTS), True,
                       1.0,
                       np.full(k, -np.inf), np.full(k, np.inf),
                       np.array([0.3 * abs(plain.values[n]) + 1e-9 for n in names]))


def chain_parameters(drive: Drive, found: Mapping[str, tuple[float, float | None]], hold: Sequence[str] = (),
             ) -> tuple[Parameter, ...]:
    """One line per value of the drive, held ones included."""
    lines = []
    for name, (value, std) in found.items():
        line, (low, high) = line_of(drive, name, value), drive.quantity(name).bounds
        if name in hold:
            line = held_line(drive, name, f"held at its value; the black box gives {value:.4g}")
        elif not low <= value <= high:
            line = line.beyond_bound(low, None if std is None else Z95_ONE_SIDED * std,
                                     f"came out as {value:.4g}, which is not physical")
        elif std is None:
            line = line.without_interval("a start value: from resonances and notches without damping")
        elif std > abs(value):
            line = line.without_interval(f"its standard deviation ({std:.2g}) is larger than itself",
                                         "not-identifiable")
        else:
            line = line.with_interval(std, (low, high))
        lines.append(line)
    totals = [t for t, suffix in TOTALS.items() if any(n in found for n in names_of(drive.bodies, suffix))]
    return whole_table(lines, drive, replaced=totals)  # the parts of a sum take its place
