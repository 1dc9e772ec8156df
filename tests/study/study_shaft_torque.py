"""Light rigs with a shaft-torque sensor: do the intervals of the default fit hold, given the values of `steady`?

    python -m tests.study.study_shaft_torque [rigs] [shift] [duration]

Every rig runs at three speeds for `steady`, then makes torque steps for `greybox`, which is given what `steady`
found and start values 20 to 60 % off. A line per parameter: of how many rigs the 95 % interval held the truth, the
median half width over the value. Then on how many rigs the joint normalised error was below the 99.9 % quantile of
chi-square, and whose estimates still hold a sum.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from drivetool.drive import two_mass
from drivetool.identify.estimate import Estimate
from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from drivetool.identify.steady import steady
from drivetool.logs.door import open_experiment
from tests.light_rigs import STEP, rig_of, steady_record, steps_record
from tests.simulator.machine import Machine
from tests.simulator.records import Channels, write_parquet

FIRST_SEED, RIGS = 470_000, 200
ROLES = ("motor_torque", "motor_speed", "shaft_torque")
QUANTILE = 0.999


def truth_of(machine: Machine) -> dict[str, float]:
    """The machine's values under the tool's names."""
    bodies = {f"{body}.{name}": getattr(machine, name)[i] for i, body in enumerate(("motor", "load"))
              for name in ("inertia", "viscous", "idle_torque")}
    return bodies | {f"shaft.{name}": getattr(machine, name)[0] for name in ("stiffness", "damping")}


def opened(record: Channels, name: str, roles: tuple[str, ...] = ROLES):
    """The record as the tool reads it from a file."""
    with tempfile.TemporaryDirectory() as room:
        path = Path(room) / f"{name}.parquet"
        write_parquet(path, {role: record[role] for role in roles}, STEP)
        return open_experiment(path)


def fitted(machine: Machine, seed: int, duration: float) -> Estimate:
    """What greybox finds with the steady step's values."""
    rng, true = np.random.default_rng(seed), truth_of(machine)
    start = two_mass().with_values({n: true[n] * rng.uniform(1.2, 1.6) ** rng.choice([-1, 1]) for n in (
        "motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")})
    steady_fit = steady([opened(steady_record(machine, 3 * seed), "steady")], start, Options())
    return greybox([opened(steps_record(machine, 3 * seed + 1, duration=duration), "steps")], steady_fit.drive,
                   Options(known=steady_fit.covariance))


def main(rigs: int = RIGS, shift: int = 0, duration: float = 8.0) -> None:
    """Print the table."""
    held: dict[str, list[bool]] = {}
    widths: dict[str, list[float]] = {}
    inside, sums, without_interval = 0, [], []
    for seed in range(FIRST_SEED + shift, FIRST_SEED + shift + rigs):
        machine = rig_of(seed)
        true, estimate = truth_of(machine), fitted(machine, seed, duration)
        lines = {p.name: p for p in estimate.parameters}
        sums += [seed] if any(n.startswith("total.") for n in lines) else []
        for name, value in true.items():
            line = lines[name]
            if line.ci95 is None:
                without_interval.append((seed, name, line.status))
                continue
            held.setdefault(name, []).append(line.ci95[0] <= value <= line.ci95[1])
            widths.setdefault(name, []).append(0.5 * (line.ci95[1] - line.ci95[0]) / abs(value))
        covariance = estimate.covariance
        if covariance is not None:
            error = np.array([lines[n].value - true[n] for n in covariance.names])
            distance = float(error @ np.linalg.solve(covariance.matrix, error))
            good = distance < chi2.ppf(QUANTILE, len(error))
            inside += good
            if not good:
                print(f"{seed}: joint error {distance:.1f} of {len(error)}", flush=True)
        else:
            print(f"{seed}: no covariance: {[f.code for f in estimate.findings]}", flush=True)
    for name, each in held.items():
        print(f"{name:18s} {sum(each):4d} of {len(each)}  half width {100.0 * np.median(widths[name]):.2g} %")
    print(f"joint error below the quantile: {inside} of {rigs}; with a sum: {sums}; "
          f"without interval: {without_interval}")


if __name__ == "__main__":
    main(*(kind(word) for kind, word in zip((int, int, float), sys.argv[1:], strict=False)))
