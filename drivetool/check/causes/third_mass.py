"""A further elastic mass, behind the load or between motor and load."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Bounds, Start

if TYPE_CHECKING:
    from drivetool.check.fit import Model
    from drivetool.check.outcome import State
    from drivetool.identify.setup import Task

QUIETER = 0.1  # torque noise under which a third mass is also looked for, over the base's
HIDING = 20.0  # log likelihood that so quiet a noise must cost, for a louder one to hide anything
FAR = 10.0  # by which inertia, stiffness and damping may leave their start
LIGHTEST = 0.002  # damping ratio below which none falls: it would ring through the record, and steel does not
ROUNDS = 3  # of a fit of the base under the quieter noise


def _starts(base: Model) -> list[Start]:
    from drivetool.check.fit import everything, fit, judge, may_have_tip

    if not may_have_tip(base.task.drive):
        return []
    # A resonance that the base lacks may pass for torque noise, under which a third mass gains nothing any more.
    masks, noise = everything(base.problem), replace(base.noise, ratio=QUIETER * base.noise.ratio)
    quiet = replace(base, noise=noise, value=judge(base.problem, base.point, noise, masks))
    if quiet.value > base.value + HIDING:
        quiet = fit(quiet, masks, most=ROUNDS, renewed=False)
    unheard = [] if quiet.value < base.value + HIDING else _likely(quiet)
    return [Start(task, ()) for task in _likely(base)] + [Start(task, (), quiet) for task in unheard]


def _likely(base: Model) -> list[Task]:
    from drivetool.check.starts import likely_large_tips, likely_middles, likely_tips

    return [*likely_tips(base), *likely_large_tips(base), *likely_middles(base)]


def _bounds(base: Model, task: Task) -> Bounds:
    """Not far from where it was looked for, or it would ring as fast as nothing in the record, at length.

    It is looked for damped, and may be so less.
    """
    from drivetool.check.fit import third_of
    from drivetool.identify.laws import tip_names

    if task.drive.bodies == base.task.drive.bodies:
        return {}
    names = tip_names(base.task.drive, third_of(task.drive))
    inertia, stiffness, damping = (task.drive.values[n] for n in names)
    least = 2.0 * LIGHTEST * float(np.sqrt(stiffness * inertia))
    return dict(zip(names, ((inertia / FAR, inertia * FAR), (stiffness / FAR, stiffness * FAR),
                            (min(damping, least), max(damping, least) * FAR)), strict=True))


def _absent(_: Model) -> tuple[State, str]:
    return "not-shown", "the drive is no two-mass drive, or a third mass would ring too fast for the sampling rate"


CAUSES = (Cause(
    "third-mass", "a further elastic mass",
    "Part of the load swings on a shaft or coupling of its own: there is one resonance more than the model had.",
    "Look for the next coupling or a soft mounting; a sensor at the load shows it best.", of="the chain",
    law="a further inertia behind a further shaft", absent=_absent,
    starts=_starts, costly=True, sizes=("inertia", "stiffness", "damping"), bodies=2, bounds=_bounds,
    needs="excitation around its resonance; a sensor at the load shows it best"),)
