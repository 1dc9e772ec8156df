"""Two seconds of each rig of Table 6.2 by the black box with a shaft torque: errors and scatter over noise draws.

    python -m tests.study.study_blackbox_torque [draws]

Per parameter: the median error, and the scatter of the draws over the median stated standard deviation. That is the
bound that a maximum-likelihood fit of both transfer functions reaches.
"""

from __future__ import annotations

import sys

import numpy as np

from drivetool.drive import two_mass
from drivetool.identify.blackbox import blackbox
from drivetool.identify.setup import Options
from tests.light_rigs import HEAVY, TABLE, steps_record
from tests.study.study_shaft_torque import opened, truth_of

FIRST_SEED, DRAWS = 480_200, 20
SHAPE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")


def main(draws: int = DRAWS) -> None:
    """Print the table."""
    for name, machine, shift in (("light", TABLE, 0), ("heavy", HEAVY, 1000)):
        true, values, stds = truth_of(machine), [], []
        for seed in range(FIRST_SEED + shift, FIRST_SEED + shift + draws):
            record = opened(steps_record(machine, seed, duration=2.0), "steps")
            lines = {p.name: p for p in blackbox([record], two_mass(), Options()).parameters}
            values.append([lines[n].value for n in SHAPE])
            stds.append([lines[n].std or np.nan for n in SHAPE])
        found, stated = np.array(values), np.array(stds)
        for j, parameter in enumerate(SHAPE):
            off = 100.0 * np.median(np.abs(found[:, j] / true[parameter] - 1.0))
            print(f"{name} {parameter:<16} median error {off:.3g} %  scatter over stated "
                  f"{found[:, j].std(ddof=1) / np.nanmedian(stated[:, j]):.2f}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
