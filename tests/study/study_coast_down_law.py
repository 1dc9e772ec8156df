"""Breakaway friction that a coast-down is fitted without: how often it is named, and its gain is inside.

    python -m tests.study.study_coast_down_law 12
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import yaml

from tests.hidden.command import run
from tests.hidden.test_coasting import COAST, PAPER, finding, steady, write_coast_down

KNOWN = ("--set", "motor.inertia=1", "--hold", "motor.inertia")
LAW = ("--free", "motor.breakaway", "--free", "motor.breakaway_speed")


def run_record(folder: Path, seed: int) -> tuple[str, float, float, float]:
    """(law that is named, lower end, gain on another run, upper end) in per cent."""
    hidden = replace(PAPER, surplus=0.5 * PAPER.coulomb, breakaway_speed=5.0)
    for name, number in (("coast", seed), ("another", 1000 + seed)):
        write_coast_down(folder / f"{name}.parquet", hidden, number, end=1e-3)
    plain, _ = steady(folder, "coast.parquet", *COAST, *KNOWN)
    said = finding(plain, "nonlinear-friction")["evidence"]
    (folder / "out.yaml").rename(folder / "plain.yaml")
    steady(folder, "coast.parquet", *COAST, *KNOWN, *LAW)
    run(folder, ["validate", "another.parquet", "--map", "map.yaml", "--params", "plain.yaml", "--params",
                 "out.yaml", "--out", "checked.yaml"])
    checks = yaml.safe_load((folder / "checked.yaml").read_text())["checks"]
    before, after = (check["rmse"] for check in checks if check["output"] == "motor_angle")
    return said["law"], said["gain_low"], 100.0 * (1.0 - after / before), said["gain_high"]


def main(n: int) -> None:
    """Print every run, and how many of the gains are inside."""
    inside = 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(481, 481 + 2 * n, 2):
            law, low, gain, high = run_record(Path(folder), seed)
            inside += low <= gain <= high
            print(f"{seed}: {law}, {gain:.2f} % in {low:.2f} to {high:.2f} %", flush=True)
    print(f"{inside} of {n} inside")


if __name__ == "__main__":
    main(int(sys.argv[1]))
