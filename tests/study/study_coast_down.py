"""Coverage and scatter of coast-downs by counts: ratios, a scale by torque, supply or an added inertia, breakaway.

And a model of one coast-down, judged by others from higher speeds, and by those of a drive with a drag besides.

    python -m tests.study.study_coast_down 200
    python -m tests.study.study_coast_down 60 supplied
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from drivetool.check.validation import CoastDownModel, ValidateOptions, validate_coast_down
from drivetool.drive import one_body
from drivetool.identify.setup import Options, as_stator_voltages
from drivetool.identify.steady import steady
from tests.coasting import RPM, Motor, counts, driven_then_off, motion, recording
from tests.induction import ELECTRICAL, Machine, switched
from tests.simulator.induction import up_and_down

PAPER, ADDED, SPEED = Motor(), 5e-5, 5.0
OPTIONS = Options(method="coast-down")
RATIOS = {"viscous_over_inertia": PAPER.viscous / PAPER.inertia,
          "coulomb_over_inertia": PAPER.coulomb / PAPER.inertia}
VALUES = {"motor.inertia": PAPER.inertia, "motor.viscous": PAPER.viscous, "motor.coulomb": PAPER.coulomb}
WITH_BREAKAWAY = replace(PAPER, surplus=0.5 * PAPER.coulomb, breakaway_speed=SPEED)


def plain(seed, angles):
    """One coast-down; counts begin anywhere in its first 400 samples."""
    first = int(np.random.default_rng(seed).integers(0, 400))
    return [recording(seed, motor_angle=counts(angles["plain"][first:], seed))], one_body(), OPTIONS, RATIOS


def driven(seed, angles):
    """Half a second under torque, then off."""
    first = int(np.random.default_rng(seed).integers(0, 400))
    e = angles["driven"]
    cut = {"motor_torque": e.signals["motor_torque"][first:], "motor_angle": counts(angles["turned"][first:], seed)}
    return [recording(seed, **cut)], one_body(), OPTIONS, VALUES


def supplied(seed, angles):
    """Run up by an induction motor from rest, switched off, coasting down; by what its converter says."""
    first, e = int(np.random.default_rng(seed).integers(0, 400)), angles["switched"]
    signals = {name: values[first:] for name, values in e.signals.items()}
    cut = recording(seed, **signals | {"motor_angle": counts(angles["up and down"][first:], seed)})
    experiments, drive = as_stator_voltages([cut], one_body().with_values(ELECTRICAL), off_too=True)
    return experiments, drive, OPTIONS, VALUES


def added(seed, angles):
    """Two coast-downs, the second with a known inertia added."""
    first = int(np.random.default_rng(seed).integers(0, 400))
    pair = [recording(2 * seed + k, f"{k}.parquet", motor_angle=counts(angles[n][first:], 2 * seed + k))
            for k, n in enumerate(("plain", "loaded"))]
    drive = replace(one_body(), records={"1.parquet": pair[1].sha256}).with_values(
        {"motor.added_inertia@1.parquet": ADDED})
    return pair, drive, OPTIONS, VALUES


def breakaway(seed, angles):
    """To standstill, breakaway torque 1.5 times the Coulomb friction."""
    first = int(np.random.default_rng(seed).integers(0, 400))
    truth = RATIOS | {"breakaway_over_inertia": WITH_BREAKAWAY.surplus / PAPER.inertia,
                      "motor.breakaway_speed": SPEED}
    how = replace(OPTIONS, free=("motor.breakaway", "motor.breakaway_speed"))
    return [recording(seed, motor_angle=counts(angles["breakaway"][first:], seed))], one_body(), how, truth


def judged(n: int) -> None:
    """Print, per supply frequency, median and largest rmse by the same drive and by one with drag."""
    fast = 2240 * RPM / 40  # of one Hz
    drag = replace(PAPER, drag=0.01 * PAPER.friction(40 * fast) / (40 * fast) ** 2)
    runs = {(h, m): motion(motor, lambda t: 0.0, 1.02 * fast * h, 80 * RPM, 5.0)[0]
            for h in (40, 45, 50, 55) for m, motor in (("same", PAPER), ("drag of 1 %", drag))}
    found: dict[tuple[int, str], list[tuple[float, float]]] = {}
    for seed in range(n):
        def record(h: int, motor: str, seed: int = seed):
            first = int(np.random.default_rng((seed, h)).integers(0, 400))
            return recording(1000 * h + seed, motor_angle=counts(runs[h, motor][first:], 1000 * h + seed))

        ratios = {p.name: p.value for p in steady([record(40, "same")], one_body(), OPTIONS).ratios}
        model = CoastDownModel("coast.yaml", one_body().with_values({
            "motor.inertia": 1.0, "motor.viscous": ratios["viscous_over_inertia"],
            "motor.coulomb": ratios["coulomb_over_inertia"]}), ratios=True)
        for h, motor in runs:
            if (h, motor) != (40, "same"):
                angle, speed = validate_coast_down([record(h, motor)], [model], ValidateOptions()).checks
                found.setdefault((h, motor), []).append((angle.rmse_counts, speed.rmse / RPM))
    for (h, motor), rows in found.items():
        angle, speed = np.array(rows).T
        print(f"{h} Hz, {motor}: angle {np.median(angle):.4g} (largest {angle.max():.4g}) count/sqrt(12), "
              f"speed {np.median(speed):.2g} ({speed.max():.2g}) rpm", flush=True)


CASES = {case.__name__: case for case in (plain, driven, supplied, added, breakaway)}


def main(n: int, *names: str) -> None:
    """Print, per case and figure: intervals that hold, median of std over value, scatter over value."""
    heavy = replace(PAPER, inertia=PAPER.inertia + ADDED)
    up = motion(PAPER, lambda t: 0.06, 100.0, 0.0, 0.5)
    down = motion(PAPER, lambda t: 0.0, float(up[1][-1]), 80 * RPM, 5.0)
    angles = {"plain": motion(PAPER, lambda t: 0.0, 2300 * RPM, 80 * RPM, 5.0)[0],
              "loaded": motion(heavy, lambda t: 0.0, 2300 * RPM, 80 * RPM, 5.0)[0],
              "breakaway": motion(WITH_BREAKAWAY, lambda t: 0.0, 2300 * RPM, 1e-3, 5.0)[0],
              "turned": np.concatenate([up[0][:-1], up[0][-1] + down[0]]), "driven": driven_then_off(0),
              "switched": switched(0), "up and down": up_and_down(Machine())[0]}
    for case in map(CASES.__getitem__, names or CASES):
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
    if not names:
        judged(n)


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
