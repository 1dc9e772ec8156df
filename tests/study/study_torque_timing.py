"""Torque logged in its cycle, one sample late or one early, on random rigs with noisy torque: is it found?

    python -m tests.study.study_torque_timing [rigs] [first]
    python -m tests.study.study_torque_timing hidden [machine ...]
    python -m tests.study.study_torque_timing look [machine ...]

Motor speed of two masses by the independent simulator, fitted by the right model from starts 10 % off. Per kind of
record: in how many the shift was found as it was, and in how many another one was. With `hidden`: records of six
seconds with one hidden effect each, or none, by the command line; effects of which anything is said. With `look`:
the same of the first record of each, as `inspect` looks at it.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml

from drivetool.check.faults import torque_timing_findings
from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from drivetool.logs.door import open_experiment
from tests.hidden import CODES, greybox_options, make_case, write_start
from tests.hidden.command import run
from tests.recover import drive_like, linear_record
from tests.simulator.machine import machine_by_seed

RIGS, FIRST = 40, 100
TIMING_CODES = {"torque-shifted", "torque-filtered", "input-delay"}
SHIFTS = {"right": 0, "late": 1, "early": -1}
NAMES = ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "total.viscous", "total.idle_torque"]


def timing_codes(seed: int, shift: str) -> set[str]:
    """The codes about the cycle of the torque; late or early in the place of that of a shift."""
    machine = machine_by_seed(seed)
    record = linear_record(machine, seed)
    signals = {**record.signals, "motor_torque": np.roll(record.signals["motor_torque"], SHIFTS[shift])}
    found = greybox([replace(record, signals=signals)], drive_like(machine, NAMES, 0.1), Options())
    return {f.code if f.code != "torque-shifted" else "late" if f.evidence["shift"] < 0.0 else "early"
            for f in found.findings if f.code in TIMING_CODES}


def main(rigs: int = RIGS, first: int = FIRST) -> None:
    """Print the table."""
    for shift in SHIFTS:
        found = [timing_codes(seed, shift) for seed in range(first, first + rigs)]
        right = sum(f == {shift} for f in found)
        wrong = sum(bool(f - {shift}) for f in found)
        print(f"{shift:6s} found {right}, found wrongly {wrong} of {rigs}", flush=True)


def hidden(*seeds: int) -> None:
    """Print what greybox says of records in which something else is wrong, or nothing."""
    count = 0
    for seed in seeds or (700_001, 700_002, 700_003):
        for effect in (*CODES, ()):
            with TemporaryDirectory() as place:
                folder, labels = Path(place, "r"), Path(place, "l")
                folder.mkdir()
                labels.mkdir()
                case = make_case(effect, seed, seed=seed, duration=6.0)
                logs, _ = case.write(folder, labels, visibility=False)
                start = write_start(case, folder)
                run(folder, ["greybox", *(Path(log).name for log in logs), "--params", Path(start).name, "--out",
                             "b.yaml", *greybox_options(case)])
                found = yaml.safe_load((folder / "b.yaml").read_text())["findings"]
            said = {f["code"] for f in found} & TIMING_CODES
            count += 1
            if said:
                print(f"{effect} in {seed}: {', '.join(sorted(said))}", flush=True)
    print(f"of {count} records")


def inspect_records(*seeds: int) -> None:
    """Print what a look at each record says of the torque, without a model."""
    for seed in seeds or (700_001, 700_002):
        for effect in (*CODES, ()):
            with TemporaryDirectory() as place:
                folder, labels = Path(place, "r"), Path(place, "l")
                folder.mkdir()
                labels.mkdir()
                logs, _ = make_case(effect, seed, seed=seed, duration=6.0).write(folder, labels, visibility=False)
                said = {f.code for f in torque_timing_findings(open_experiment(logs[0]))} & TIMING_CODES
            if said:
                print(f"{effect} in {seed}: {', '.join(sorted(said))}", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["hidden"]:
        hidden(*map(int, sys.argv[2:]))
    elif sys.argv[1:2] == ["look"]:
        inspect_records(*map(int, sys.argv[2:]))
    else:
        main(*map(int, sys.argv[1:]))
