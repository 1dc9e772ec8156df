"""A further elastic mass, behind the load or between motor and load."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Bounds, Start

if TYPE_CHECKING:
    from drivetool.check.fit import Model
    from drivetool.identify.setup import Task

# Torque noise over the base's, under which a third mass is also searched (a choice: a tenth)
QUIET_NOISE_RATIO = 0.1
# Log likelihood that so small a noise must cost: else the base's noise hides nothing (a choice)
MIN_QUIET_NOISE_COST = 20.0
# Factor by which inertia, stiffness and damping may leave their start: beyond, the fit leaves the record's
# frequencies.
MAX_START_RATIO = 10.0
MIN_DAMPING_RATIO = 0.002  # Damping ratio. Below, a mode would oscillate throughout the record; steel has more.
QUIET_FIT_ITERATIONS = 3  # a choice: iterations of a fit of the base under the smaller noise


def _starts(base: Model) -> list[Start]:
    from drivetool.check.fit import all_samples, fit, masked_loss, may_have_third_mass

    if not may_have_third_mass(base.task.drive):
        return []
    # A missing resonance may be estimated as torque noise, under which a third mass gains nothing.
    masks, noise = all_samples(base.problem), replace(base.noise, ratio=QUIET_NOISE_RATIO * base.noise.ratio)
    quiet = replace(base, noise=noise, value=masked_loss(base.problem, base.point, noise, masks))
    if quiet.value > base.value + MIN_QUIET_NOISE_COST:
        quiet = fit(quiet, masks, max_iterations=QUIET_FIT_ITERATIONS, refit_noise=False)
    hidden = [] if quiet.value < base.value + MIN_QUIET_NOISE_COST else _likely_tasks(quiet)
    return [Start(task, ()) for task in _likely_tasks(base)] + [Start(task, (), quiet) for task in hidden]


def _likely_tasks(base: Model) -> list[Task]:
    from drivetool.check.starts import likely_end_masses, likely_intermediate_masses, likely_large_end_masses

    return [*likely_end_masses(base), *likely_large_end_masses(base), *likely_intermediate_masses(base)]


def _bounds(base: Model, task: Task) -> Bounds:
    """Not far from its start, or it would become an undamped mode outside the record's frequencies.

    Its start is well damped, and the fit may reduce the damping.
    """
    from drivetool.check.fit import third_mass_of
    from drivetool.identify.laws import third_mass_names

    if task.drive.bodies == base.task.drive.bodies:
        return {}
    names = third_mass_names(base.task.drive, third_mass_of(task.drive))
    inertia, stiffness, damping = (task.drive.values[n] for n in names)
    min_damping = 2.0 * MIN_DAMPING_RATIO * float(np.sqrt(stiffness * inertia))
    return dict(zip(names, ((inertia / MAX_START_RATIO, inertia * MAX_START_RATIO),
                            (stiffness / MAX_START_RATIO, stiffness * MAX_START_RATIO),
                            (min(damping, min_damping), max(damping, min_damping) * MAX_START_RATIO)), strict=True))


NO_STARTS = "the drive is no two-mass drive, or a third mass would ring too fast for the sampling rate"
CAUSES = (Cause(
    "third-mass", "a further elastic mass",
    "Part of the load is connected by a further elastic shaft or coupling: the drive has one more resonance than "
    "the model.", "Look for the next coupling or a soft mounting; a sensor at the load identifies it best.",
    of="the chain", law="a further inertia behind a further shaft", absent=("not-shown", NO_STARTS),
    starts=_starts, costly=True, sizes=("inertia", "stiffness", "damping"), bodies=2, bounds=_bounds,
    needs="excitation around its resonance; a sensor at the load identifies it best"),)
