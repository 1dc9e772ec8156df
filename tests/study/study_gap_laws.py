"""Light rigs whose gap is crossed, with a shaft torque: which law of the gap is named, and is it the machine's?

    python -m tests.study.study_gap_laws [rigs] [shift] [share of the damping] [law of all rigs]

Even seeds have their damping in the contact, odd ones in the gap too, unless one law is asked for. The half gap is
0.3 to 6 times the twist at 100 Nm, the damping 1 to 10 times that of `rig_of`; the drive knows all values but the
gap, with a third of the damping. The gain of a law is its lead in log likelihood when each is fitted from the
truth. With little damping (a share of 0.001, say) no law shows.

A line per rig: law, the tool's, its gain, gap and damping over the truth's with their errors in standard
deviations, warnings. Last, the counts of rigs on which the gain is above CLEAR_GAIN, and below HIDDEN_GAIN.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from typing import get_args

import numpy as np

from drivetool.drive import two_mass
from drivetool.identify.backlash import backlash
from drivetool.identify.estimate import Estimate
from drivetool.identify.noise import Noise, filtered, fit_innovations, fit_ratio, minus_log_likelihood
from drivetool.identify.setup import Options, Roles, Task, first_point
from drivetool.identify.shaft_torque.gap_laws import MIN_LAW_LEAD
from tests.light_rigs import STEP, Sensors, channels, rig_of
from tests.simulator import experiments
from tests.simulator.machine import Law, Machine, running
from tests.simulator.records import Channels
from tests.study.study_shaft_torque import ROLES, opened, truth_of

FIRST_SEED, RIGS = 490_000, 40
TWIST_TORQUE = 100.0  # Nm at which the twist is counted
CLEAR_GAIN, HIDDEN_GAIN = 25.0, 3.0  # log likelihood


def gap_rig(seed: int, share: float = 1.0, law: Law | None = None) -> Machine:
    """A light rig with a gap; the law alternates, unless it is given. share: of the damping that it would have."""
    rng, rig = np.random.default_rng(seed), rig_of(seed)
    half = TWIST_TORQUE / rig.stiffness[0] * rng.uniform(0.3, 6.0)
    return replace(rig, half_gap=(float(half),), law=law or ("inside", "always")[seed % 2],
                   damping=(float(share * rig.damping[0] * rng.uniform(1.0, 10.0)),))


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


def gain_of_law(machine: Machine, seed: int) -> float:
    """Log likelihood by which the machine's law leads the others, gap and damping of each fitted from the truth."""
    record = opened(gap_record(machine, seed), "gap", ROLES)
    known = truth_of(machine) | {"shaft.half_gap": machine.half_gap[0]}
    roles, values = Roles(("motor_torque",), ("motor_speed", "shaft_torque")), {}
    for law in get_args(Law):
        drive = replace(two_mass().with_values(known), damping_law=law)
        task = Task(drive, ("shaft.damping", "shaft.half_gap"), roles, (record,))
        problem = task.problem()
        point = first_point(drive, problem, roles)
        noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
        values[law] = min(fit_innovations(problem, point, noise, near_optimum=True, max_rounds=30).value,
                          minus_log_likelihood(filtered(problem, point, noise, keep=False)))
    return min(v for law, v in values.items() if law != machine.law) - values[machine.law]


def main(rigs: int = RIGS, shift: int = 0, share: float = 1.0, law: Law | None = None) -> None:
    """Print the table."""
    counts: dict[str, Counter[str]] = {"plain": Counter(), "hidden": Counter(), "between": Counter()}
    inside = intervals = 0
    for seed in range(FIRST_SEED + shift, FIRST_SEED + shift + rigs):
        machine = gap_rig(seed, share, law)
        estimate, lead = fitted(machine, seed), gain_of_law(machine, seed)
        lines = {p.name: p for p in estimate.parameters}
        findings = {f.code: f for f in estimate.findings}
        stated = findings.get("gap-law")
        decided = stated is not None and stated.evidence.get("log_likelihood_lead", 0.0) > MIN_LAW_LEAD
        named = estimate.drive.damping_law if decided else "-"
        kind = "plain" if lead > CLEAR_GAIN else "hidden" if abs(lead) < HIDDEN_GAIN else "between"
        open_answer = "nothing" if stated is None else "undetermined"
        counts[kind][open_answer if named == "-" else "right" if named == machine.law else "wrong"] += 1
        cells = []
        for name, true in (("shaft.half_gap", machine.half_gap[0]), ("shaft.damping", machine.damping[0])):
            p = lines[name]
            off = None if p.std is None else (p.value - true) / p.std
            cells.append(f"{p.value / true:.4f} ({'-' if off is None else f'{off:.1f}'})")
            if name == "shaft.half_gap" and p.ci95 is not None:
                intervals, inside = intervals + 1, inside + (p.ci95[0] <= true <= p.ci95[1])
        warnings = [f.code for f in estimate.findings if f.severity != "note"]
        print(seed, machine.law, named, f"{lead:.1f}", *cells, warnings, flush=True)
    for kind, found in counts.items():
        print(f"{kind}: {dict(sorted(found.items()))}")
    print(f"half gap inside {inside} of {intervals}")


if __name__ == "__main__":
    main(*(kind(word) for kind, word in zip((int, int, float, str), sys.argv[1:], strict=False)))
