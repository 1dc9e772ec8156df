"""The black box with a shaft torque: motor torque to speed and to shaft torque, two transfer functions of a drive.

The reference fits the two separately, to speed and to shaft torque, and converts them. They have the poles, the
inertias and the stiffness in common: here both are fitted together, in the drive's own parameters, starting from
the result of the transfer function to the speed alone. So it needs no start values either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.drive import TOTALS, Drive
from drivetool.identify.estimate import Estimate
from drivetool.identify.fit import (
    by_innovations,
    by_simulation,
    segment_of,
    with_coloured_noise,
    with_friction_parts,
)
from drivetool.identify.greybox import ALL
from drivetool.identify.outcome import compose
from drivetool.identify.setup import Options, Roles, Task
from drivetool.logs import Experiment
from drivetool.quantity import name_of, names_of, owner_of, quantity_of

# Findings of the fit to the speed alone that those of the fit to both replace.
REPLACED_CODES = ("innovations-correlated", "torque-source", "not-identifiable",
            "negative-estimate", "simulation-criterion")


def with_shaft_torque(estimate: Estimate, experiments: Sequence[Experiment], drive: Drive, roles: Roles,
                      options: Options) -> Estimate:
    """The estimate of a black box with its parameters by both outputs.

    estimate     by the speed alone, whose coefficients, poles and response it keeps
    experiments  as they were fitted
    drive        before the step; the viscous friction that it knows is kept, the idle torque is of each record
    roles        of `setup.both_outputs`
    """
    failed = any(f.severity == "failure" for f in estimate.findings)
    if failed or estimate.drive.missing():
        return estimate
    shut = {name_of(s, "half_gap"): 0.0 for s in drive.shafts}
    initial = with_friction_parts(replace(estimate.drive, values=estimate.drive.values | shut))
    frictions = ("total.viscous", *names_of(drive.bodies, "viscous"))
    given = any(n in drive.values or n in options.hold for n in frictions)
    known = given and not {ALL, *frictions} & set(options.free)
    names = {n for n in initial.quantities if quantity_of(n) in ("inertia", "stiffness", "damping")
             and owner_of(n) in (*initial.bodies, *initial.shafts)}
    names |= set() if known else set(names_of(initial.bodies, "viscous"))
    names |= set() if "total.idle_torque" in options.hold else set(names_of(initial.bodies, "idle_torque"))
    free = tuple(n for n in initial.quantities if n in names and n not in options.hold)
    task = Task(initial, free, roles, tuple(experiments))
    if options.criterion == "simulation":
        outcome = by_simulation(task, segment_of(options), [{}], near_optimum=True)
    else:
        outcome = with_coloured_noise(by_innovations(task, [{}]))
    before = replace(drive, values={n: v for n, v in drive.values.items() if n not in TOTALS})
    found = compose("blackbox", before, outcome, options)
    gaps = {n: drive.values[n] for n in shut if n in drive.values}
    values = {n: v for n, v in outcome.drive.values.items() if n not in shut} | gaps
    lines = tuple(p.replace(value=gaps.get(p.name, p.value), start=gaps.get(p.name, p.start))
                  for p in found.parameters if p.name not in shut or p.name in gaps)
    findings = (*(f for f in estimate.findings if f.code not in REPLACED_CODES),
                *(f for f in found.findings if f.code != "held-values-dominate"))
    return replace(
        found, drive=replace(outcome.drive, values=values), parameters=lines, findings=findings,
        details={**estimate.details, **found.details},
        fit={**found.fit, "speed_alone_fit_percent": estimate.fit["simulation_fit_percent"]},
        exhibits=(*found.exhibits, *(e for e in estimate.exhibits if e.kind != "record")))
