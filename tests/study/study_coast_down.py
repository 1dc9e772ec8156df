"""Coverage and scatter of coast-downs by counts: ratios, a stretch under torque, an added inertia, breakaway.

    python -m tests.study.study_coast_down 200
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from drivetool.drive.chain import one_body
from drivetool.identify.options import Options
from drivetool.identify.steady import steady
from tests.coasting import RPM, Motor, counts, driven_then_off, motion, recording

PAPER, ADDED, SPEED = Motor(), 5e-5, 5.0
HOW = Options(method="coast-down")
RATIOS = {"viscous_over_inertia": PAPER.viscous / PAPER.inertia,
          "coulomb_over_inertia": PAPER.coulomb / PAPER.inertia}
VALUES = {"motor.inertia": PAPER.inertia, "motor.viscous": PAPER.viscous, "motor.coulomb": PAPER.coulomb}
BROKEN = replace(PAPER, surplus=0.5 * PAPER.coulomb, breakaway_speed=SPEED)


def plain(seed, angles):
    """One run-down; counts begin anywhere in its first 400 samples."""
    first = int(np.random.default_rng(seed).integers(0, 400))
    return [recording(seed, motor_angle=counts(angles["plain"][first:], seed))], one_body(), HOW, RATIOS


def driven(seed, angles):
    """Half a second under torque, then off."""
    first = int(np.random.default_rng(seed).integers(0, 400))
    e = angles["driven"]
    cut = {"motor_torque": e.signals["motor_torque"][first:], "motor_angle": counts(angles["turned"][first:], seed)}
    return [recording(seed, **cut)], one_body(), HOW, VALUES


def added(seed, angles):
    """Two run-downs, the second with a known inertia added."""
    first = int(np.random.default_rng(seed).integers(0, 400))
    pair = [recording(2 * seed + k, f"{k}.parquet", motor_angle=counts(angles[n][first:], 2 * seed + k))
            for k, n in enumerate(("plain", "loaded"))]
    drive = replace(one_body(), records={"1.parquet": pair[1].sha256}).with_values(
        {"motor.added_inertia@1.parquet": ADDED})
    return pair, drive, HOW, VALUES


def breakaway(seed, angles):
    """To standstill, breakaway torque 1.5 times the Coulomb friction."""
    first = int(np.random.default_rng(seed).integers(0, 400))
    truth = RATIOS | {"breakaway_over_inertia": BROKEN.surplus / PAPER.inertia, "motor.breakaway_speed": SPEED}
    how = replace(HOW, free=("motor.breakaway", "motor.breakaway_speed"))
    return [recording(seed, motor_angle=counts(angles["breakaway"][first:], seed))], one_body(), how, truth


def main(n: int) -> None:
    """Print, per case and figure: intervals that hold, median of std over value, scatter over value."""
    heavy = replace(PAPER, inertia=PAPER.inertia + ADDED)
    up = motion(PAPER, lambda t: 0.06, 100.0, 0.0, 0.5)
    down = motion(PAPER, lambda t: 0.0, float(up[1][-1]), 80 * RPM, 5.0)
    angles = {"plain": motion(PAPER, lambda t: 0.0, 2300 * RPM, 80 * RPM, 5.0)[0],
              "loaded": motion(heavy, lambda t: 0.0, 2300 * RPM, 80 * RPM, 5.0)[0],
              "breakaway": motion(BROKEN, lambda t: 0.0, 2300 * RPM, 1e-3, 5.0)[0],
              "turned": np.concatenate([up[0][:-1], up[0][-1] + down[0]]), "driven": driven_then_off(0)}
    for case in (plain, driven, added, breakaway):
        found: dict[str, list[tuple[float, float, bool]]] = {}
        for seed in range(48_000, 48_000 + n):
            experiments, drive, how, truth = case(seed, angles)
            estimate = steady(experiments, drive, how)
            lines = {p.name: p for p in (*estimate.parameters, *estimate.ratios)}
            for name, value in truth.items():
                p = lines[name]
                held = p.ci95 is not None and p.ci95[0] <= value <= p.ci95[1]
                found.setdefault(name, []).append((p.value / value, (p.std or np.inf) / value, held))
        for name, rows in found.items():
            value, std, held = (np.array(column) for column in zip(*rows, strict=True))
            print(f"{case.__name__} {name}: {held.sum()} of {n}, std {100 * np.median(std):.2g} %, "
                  f"scatter {100 * value.std(ddof=1):.2g} %, mean {100 * (value.mean() - 1):+.1g} %", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
