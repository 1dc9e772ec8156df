"""Light rigs whose gap is crossed, with a shaft torque: which law of the gap is named, and is it the machine's?

    python -m tests.study.study_gap_laws [rigs] [shift]

Even seeds have their damping in the contact, odd ones in the gap too. The half gap is 0.3 to 6 times the twist at
100 Nm, the damping 1 to 10 times that of `rig_of`; the drive knows all values but the gap, with a third of the
damping. A line per rig: law, the tool's, its lead, gap and damping over the truth's with their errors in standard
deviations, warnings. Last, the counts.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from drivetool.drive.chain import two_mass
from drivetool.identify.backlash import backlash
from drivetool.identify.estimate import Estimate
from drivetool.identify.options import Options
from tests.light_rigs import STEP, Sensors, channels, rig_of
from tests.simulator import experiments
from tests.simulator.machine import Machine, running
from tests.simulator.records import Channels
from tests.study.study_shaft_torque import ROLES, opened, truth_of

FIRST_SEED, RIGS = 490_000, 40
LEVEL = 100.0  # Nm at which the twist is counted


def gap_rig(seed: int) -> Machine:
    """A light rig with a gap; the law alternates."""
    rng, rig = np.random.default_rng(seed), rig_of(seed)
    half = LEVEL / rig.stiffness[0] * rng.uniform(0.3, 6.0)
    return replace(rig, half_gap=(float(half),), law=("inside", "always")[seed % 2],
                   damping=(float(rig.damping[0] * rng.uniform(1.0, 10.0)),))


def gap_record(machine: Machine, seed: int, duration: float = 11.0) -> Channels:
    """Torque steps of both signs about what keeps the speed."""
    base = running(machine, 110.0).torque
    torque = experiments.alternating(base, (40.0, 80.0), (0.25, 0.5), int(duration), 0.4, STEP, seed)
    return channels(machine, np.round(torque, 3), 110.0, seed, Sensors())


def fitted(machine: Machine, seed: int, damping: float = 0.3) -> Estimate:
    """What backlash finds; damping: the share of it that the drive knows."""
    known = truth_of(machine)
    known["shaft.damping"] *= damping
    return backlash([opened(gap_record(machine, seed), "gap", ROLES)], two_mass().with_values(known), Options())


def main(rigs: int = RIGS, shift: int = 0) -> None:
    """Print the table."""
    right = wrong = untold = inside = intervals = 0
    for seed in range(FIRST_SEED + shift, FIRST_SEED + shift + rigs):
        machine = gap_rig(seed)
        estimate = fitted(machine, seed)
        lines = {p.name: p for p in estimate.parameters}
        told = {f.code: f for f in estimate.findings}
        named = estimate.drive.damping_law if "gap-law" in told else "-"
        right, wrong = right + (named == machine.law), wrong + (named not in (machine.law, "-"))
        untold += named == "-"
        cells = []
        for name, true in (("shaft.half_gap", machine.half_gap[0]), ("shaft.damping", machine.damping[0])):
            p = lines[name]
            off = None if p.std is None else (p.value - true) / p.std
            cells.append(f"{p.value / true:.4f} ({'-' if off is None else f'{off:.1f}'})")
            if name == "shaft.half_gap" and p.ci95 is not None:
                intervals, inside = intervals + 1, inside + (p.ci95[0] <= true <= p.ci95[1])
        loud = [f.code for f in estimate.findings if f.severity != "note"]
        print(seed, machine.law, named, *cells, loud, flush=True)
    print(f"right {right}, wrong {wrong}, none named {untold} of {rigs}; half gap inside {inside} of {intervals}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
