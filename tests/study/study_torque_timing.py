"""Torque logged in its cycle, one sample late or one early, on random rigs with noisy torque: what is told of it?

    python -m tests.study.study_torque_timing [rigs] [first]

Motor speed of two masses by the independent simulator, fitted by the right model from starts 10 % off. Per kind of
record: in how many the shift was told as it was, and in how many another one was.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from drivetool.identify.greybox import greybox
from drivetool.identify.options import Options
from tests.recover import drive_like, linear_record
from tests.simulator.machine import machine_by_seed

RIGS, FIRST = 40, 100
WAYS = {"right": 0, "late": 1, "early": -1}
NAMES = ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "total.viscous", "total.idle_torque"]


def told(seed: int, way: str) -> set[str]:
    """The codes about the cycle of the torque."""
    machine = machine_by_seed(seed)
    record = linear_record(machine, seed)
    signals = {**record.signals, "motor_torque": np.roll(record.signals["motor_torque"], WAYS[way])}
    found = greybox([replace(record, signals=signals)], drive_like(machine, NAMES, 0.1), Options())
    return {f.code for f in found.findings} & {"torque-late", "torque-early"}


def main(rigs: int = RIGS, first: int = FIRST) -> None:
    """Print the table."""
    for way in WAYS:
        found = [told(seed, way) for seed in range(first, first + rigs)]
        right = sum(f == {f"torque-{way}"} for f in found)
        wrong = sum(bool(f - {f"torque-{way}"}) for f in found)
        print(f"{way:6s} told {right}, told wrongly {wrong} of {rigs}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
