"""What `drivetool greybox` says of a record, by criterion and by what is freed."""

from __future__ import annotations

import numpy as np

from tests.study.shared.command import greybox
from tests.study.two_masses import machine
from tests.study.two_masses.record import STEP, Record, draw

HALF_GAP = "shaft.half_gap"
# Parameters that are read from an answer, where sums may stand for their parts.
NAMES = (*machine.NAMES, "load.coulomb", "total.viscous", "total.idle_torque")
SCATTER = 0.15  # of the logarithm of a start value about the truth
# What is freed beside what the record has begins at a guess: a share of the motor's dry friction, and of the twist
# at rated torque.
GUESSED_FRICTION, GUESSED_GAP = 0.5, 0.1


def start_values(record: Record, seed: int, freed: tuple[str, ...] = ()) -> dict[str, float]:
    """Name -> a value about the machine's own; the half gap only where it is in the model or freed.

    freed  names that are fitted besides
    """
    rng = np.random.default_rng([seed, 40503])
    values = record.machine.values
    off = dict(zip(machine.NAMES, np.exp(SCATTER * rng.standard_normal(len(machine.NAMES))), strict=True))
    found = {name: float(values[name] * off[name]) for name in machine.NAMES if name != HALF_GAP or record.gap}
    if "load.coulomb" in freed:
        found["load.coulomb"] = GUESSED_FRICTION * found["motor.coulomb"]
    if HALF_GAP in freed and not record.gap:
        found[HALF_GAP] = GUESSED_GAP * record.truth.rated / found["shaft.stiffness"]
    return found


def fit(record: Record, seed: int, estimator: str) -> dict:
    """`drivetool greybox` in this process; values, stds and intervals in the order of NAMES.

    estimator  a criterion of the command line, and names that are freed besides: innovations+load.coulomb. The half
               gap of a model that has one is freed always
    returns    as shared.command.greybox
    """
    criterion, *freed = estimator.split("+")
    words = ["--drive", "two-mass", "--criterion", criterion]
    for name in dict.fromkeys([*freed, *([HALF_GAP] if record.gap else [])]):
        words += ["--free", name]
    return greybox(STEP, record.channels, start_values(record, seed, tuple(freed)), NAMES, words)


def warm_up(estimators: tuple[str, ...]) -> None:
    """One fit of each, without and with a gap, so that no row counts the loading of compiled code."""
    for situation in ("quiet", "gap+quiet"):
        record = draw(situation, "", 7, 1, 2.0)
        for estimator in estimators:
            fit(record, 1, estimator)
