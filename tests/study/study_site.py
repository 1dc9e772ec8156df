"""A site of 200 recordings on disk: good, truncated, short and mislabelled ones of 8 machines, two of which drift.

    python -m tests.study.study_site FOLDER [seed] [kills]

The site is run whole by one worker, and by two that are killed at random times and started again. Stated are what
became of the good and of the bad recordings, the alarms, whether both runs gave the same bytes, time and memory.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from tests import sites
from tests.simulator import experiments
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine, running
from tests.simulator.records import Channels, white_noise, write_mcap, write_parquet

MACHINES, RECORDINGS, STEP, DURATION = 8, 25, 1e-3, 6.0
SCATTER = 1.0 / 60.0  # of a parameter from recording to recording, over its value
GAP_MACHINE, GAP_STEP, GAP_PLACE = 3, 0.10, 14  # ten percent are six such deviations
DRIFT_MACHINE, DRIFT = 5, 0.4
PRESS = Machine(
    inertia=(0.6, 5.2), viscous=(0.8, 0.0), coulomb=(5.0, 0.0), idle_torque=(0.0, 8.0), stiffness=(3300.0,),
    damping=(3.1,), half_gap=(0.010,))
START = {"motor.inertia": (0.55, "kg m^2"), "load.inertia": (5.5, "kg m^2"), "shaft.stiffness": (3000.0, "Nm/rad"),
         "shaft.damping": (3.0, "Nm s/rad"), "shaft.half_gap": (9.0, "mrad"), "motor.coulomb": (4.0, "Nm"),
         "motor.viscous": (0.7, "Nm s/rad"), "load.idle_torque": (6.0, "Nm"), "load.viscous": (0.0, "Nm s/rad")}
FAULTS = ("truncated", "truncated", "short", "short", "unit", "unit", "rpm", "foreign")


@dataclass(frozen=True)
class Recorded:
    """A recording of the site: its path, what is wrong with it, if anything."""

    path: Path
    wrong: str = ""


def machine_of(rng: np.random.Generator, base: Machine, gap: float = 1.0, viscous: float = 0.0) -> Machine:
    """A machine as it is on a day; gap: factor, viscous: standard deviations that are added."""
    f = 1.0 + SCATTER * rng.standard_normal(4)
    return replace(
        base, half_gap=(base.half_gap[0] * f[0] * gap,),
        viscous=(base.viscous[0] * (f[1] + SCATTER * viscous), 0.0),
        coulomb=(base.coulomb[0] * f[2], 0.0), inertia=(base.inertia[0], base.inertia[1] * f[3]))


def channels_of(machine: Machine, seed: int, duration: float = DURATION) -> Channels:
    """Speed control on trapezoids of both directions with a multisine on top."""
    reference = experiments.trapezoids(6.0, 0.75, 0.35, duration, STEP, seed)
    ahead = experiments.multisine(np.arange(2.0, 26.0), 0.7, duration, STEP, seed)
    start = running(machine, 0.0)
    controller = PI(reference, 20.0, 40.0, start.torque, 60.0, 1e-3)
    run = simulate_fast(machine, ahead, STEP, start, controller, white_noise(len(reference), 0.3, 2 * seed),
                        sensor_noise=white_noise(len(reference), 0.02, 2 * seed + 1), resolution=1e-5)
    return {"motor_torque": (run.command, "Nm"), "motor_speed": (run.measured, "rad/s")}


def write_site(folder: Path, seed: int) -> list[Recorded]:
    """The recordings and the site file; every other machine logs MCAP."""
    rng, found = np.random.default_rng(seed), []
    places = rng.permutation(MACHINES * RECORDINGS)[:len(FAULTS)].tolist()
    wrong = dict(zip(places, FAULTS, strict=True))
    for m in range(MACHINES):
        base = replace(PRESS, viscous=(rng.uniform(0.6, 1.0), 0.0), coulomb=(rng.uniform(4.0, 6.0), 0.0),
                       half_gap=(rng.uniform(0.008, 0.012),), inertia=(0.6, rng.uniform(4.5, 6.0)))
        for k in range(RECORDINGS):
            gap = 1.0 + GAP_STEP * (m + 1 == GAP_MACHINE and k >= GAP_PLACE)
            machine = machine_of(rng, base, gap, DRIFT * k * (m + 1 == DRIFT_MACHINE))
            kind = wrong.get(m * RECORDINGS + k, "")
            suffix = "mcap" if m % 2 and kind != "truncated" else "parquet"
            path = folder / "logs" / f"press {m + 1}" / f"{k + 1:02d}.{suffix}"
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path, machine, kind, 100_000 * seed + m * RECORDINGS + k)
            found.append(Recorded(path, kind))
    parameters = {name: {"value": value, "unit": unit} for name, (value, unit) in START.items()}
    (folder / "start.yaml").write_text(yaml.safe_dump(
        {"schema": "drivetool/parameters/1", "parameters": parameters}, sort_keys=False))
    sites.write_site(folder, [{"files": "logs/**/*.*"}], [
        {"command": "backlash --params start.yaml --free all --hold load.viscous --starts 1"}])
    return found


def write(path: Path, machine: Machine, fault: str, seed: int) -> None:
    """One recording, with what is wrong about it."""
    if fault == "foreign":  # of a machine of another size
        machine = replace(machine, inertia=(0.9, 9.0), stiffness=(5000.0,))
    channels = dict(channels_of(machine, seed, 0.02 if fault == "short" else DURATION))
    torque, speed = channels["motor_torque"][0], channels["motor_speed"][0]
    if fault == "unit":
        channels["motor_torque"] = torque, "rad/s"
    if fault == "rpm":
        channels["motor_speed"] = speed * 30.0 / np.pi, "rad/s"
    (write_mcap if path.suffix == ".mcap" else write_parquet)(path, channels, STEP)
    if fault == "truncated":
        path.write_bytes(path.read_bytes()[:path.stat().st_size // 2])


def run(folder: Path, out: str, workers: int) -> subprocess.Popen[str]:
    """The running process of the site."""
    return subprocess.Popen(
        [sys.executable, "-m", "drivetool", "batch", "site.yaml", "--workers", str(workers), "--out", out],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env=os.environ | {"PYTHONPATH": str(Path.cwd())})


def killed(folder: Path, out: str, kills: int, seconds: float, seed: int) -> list[int]:
    """Kill the run at random times, each within its share of the seconds; results that stood after each."""
    rng, result_counts = np.random.default_rng(seed), []
    for _ in range(kills):
        process = run(folder, out, 2)
        time.sleep(rng.uniform(0.0, 2.0 * seconds / kills) + rng.uniform(0.0, 4.0))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        result_counts.append(len(list((folder / out).rglob("backlash.yaml"))))
    return result_counts


def outcome(rows: Sequence[dict], trends: dict, recorded: Sequence[Recorded], folder: Path) -> None:
    """Print what became of the recordings, and the alarms."""
    problem = {row["recording"]: row["problem"] for row in rows}
    doubted = {row["recording"] for row in rows if "suspect-unit" in (row["findings"] or "")}
    outlying = {f["evidence"]["recording"] for f in trends["findings"] if f["code"] == "outlying-recording"}
    names = {r: r.path.relative_to(folder).as_posix() for r in recorded}
    good = [r for r in recorded if not r.wrong]
    print(f"good {len(good)}: {sum(problem[names[r]] is None for r in good)} fitted, "
          f"{sum(names[r] in outlying for r in good)} outlying")
    for r in recorded:
        if r.wrong:
            named_sets = (("suspect-unit", doubted), ("outlying", outlying))
            said = problem[names[r]] or " ".join(word for word, several in named_sets if names[r] in several)
            print(f"  {r.wrong:9s} {names[r]}: {said or 'NOT NAMED'}")
    for f in trends["findings"]:
        if f["code"] in ("trend-alarm", "small-change"):
            print(f"  {f['code']}: {f['text']}")


def main(folder: Path, seed: int = 0, kills: int = 20) -> None:
    """Write the site, run it both ways, print the figures."""
    recorded = write_site(folder, seed)
    began = time.monotonic()
    whole = run(folder, "whole", 1)
    said = whole.communicate()[0]
    seconds = time.monotonic() - began
    rows = sites.table(folder / "whole")
    costs = {(row["recording"], row["step"]): (row["seconds"], row["peak_memory_mb"]) for row in rows}
    taken = [pair[0] for pair in costs.values() if pair[0] is not None]
    print(said.splitlines()[-1])
    print(f"exit codes {whole.returncode}; {seconds:.0f} s, {sum(taken):.0f} s of them in steps; median "
          f"{np.median(taken):.2f} s, peak memory {max(pair[1] or 0.0 for pair in costs.values()):.0f} MB")
    outcome(rows, yaml.safe_load((folder / "whole" / "trends.yaml").read_text()), recorded, folder)
    if kills:
        result_counts = killed(folder, "killed", kills, seconds / 2.0, seed)
        last = run(folder, "killed", 2)
        last.communicate()
        same = sites.compared(folder / "whole") == sites.compared(folder / "killed")
        print(f"killed {kills} times (results after each: {result_counts}): exit code {last.returncode}, "
              f"{'the same bytes' if same else 'OTHER BYTES'}")
    print(Counter(r.wrong or "good" for r in recorded))


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
