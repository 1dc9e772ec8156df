"""What each piece of the kernel's machinery costs at the first use and buys per sample: two tables.

    python -m tests.bench.machinery               all variants, in turn: half an hour on a quiet machine
    python -m tests.bench.machinery VARIANT       nanoseconds per sample of one, as JSON; compiles it if need be

A variant is the kernel with one piece left out, compiled by Numba into a folder of its own under build/machinery,
which a second run takes as it is. All variants are measured in turn, each in processes of its own.
"""

from __future__ import annotations

import json
import os
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PLACE = ROOT / "build" / "machinery"
AS_IT_IS = "as-it-is"
ROUNDS, PASSES = 7, 25  # processes of each variant; passes in each, of which the fastest counts


def leave_out_overlap_marks() -> None:
    """Loops whose arrays might overlap are tested at each call."""
    from numba.core.compiler import Compiler

    from drivetool.drive.compile import numba_private

    numba_private.NoOverlap = Compiler


def leave_out_sizes(*sizes: int) -> None:
    """Drives with these numbers of states run in the code for any number."""
    from drivetool.drive.simulation import augment, simulate

    kept = tuple(n for n in simulate.SIZED_STATE_COUNTS if n not in sizes)
    augment.SIZED_STATE_COUNTS = simulate.SIZED_STATE_COUNTS = kept


def leave_out_sized_laws() -> None:
    """Smooth laws run in the code for any number of them."""
    from drivetool.drive.simulation import augment

    augment.MAX_SIZED_LAWS = 0


VARIANTS: Mapping[str, Callable[[], None]] = {
    AS_IT_IS: lambda: None,
    "no-overlap-marks": leave_out_overlap_marks,
    "no-sizes": lambda: leave_out_sizes(*range(3, 8)),
    "no-sized-laws": leave_out_sized_laws,
}


def passes() -> dict[str, tuple[Callable[[], object], int]]:
    """What is timed: name -> (a pass of the kernel over a record, its samples)."""
    from tests.bench import test_peers
    from tests.bench.records import CASES

    found = {}
    for case, law, shown in (("main", "", "two masses"), ("three", "", "three masses"),
                             ("main", test_peers.DRAG, "two masses, drag")):
        for name, call in test_peers.kernel_calls(case, law).items():
            found[f"{shown}: {name.partition(': ')[2]}"] = call, CASES[case].record().size
    return found | angle_passes()


def angle_passes() -> dict[str, tuple[Callable[[], object], int]]:
    """The same of two masses with an angle sensor: four states."""
    import numpy as np

    from drivetool.identify.noise import Noise, filtered
    from drivetool.identify.setup import first_point, roles_of
    from tests.bench.records import CASES
    from tests.bench.test_convergence import task_of
    from tests.recover import STEP

    case = CASES["main"]
    task, record = task_of(case, case.start()), case.record()
    signals = {"motor_torque": record.signals["motor_torque"],
               "motor_angle": STEP * np.cumsum(record.signals["motor_speed"])}
    record = replace(record, signals=signals)
    task = replace(task, experiments=(record,), roles=roles_of([record], task.drive))
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    trace, start = problem.traces[0], point.starts[0]
    plain, full = problem.plants(point.values, False)[0], problem.plants(point.values, True)[0]
    return {
        "two masses, angle: simulation": (lambda: plain.outputs(trace, start), record.size),
        "two masses, angle: sensitivities": (lambda: full.jacobian(trace, start), record.size),
        "two masses, angle: Kalman pass": (
            lambda: filtered(problem, point, Noise(3.0, None, problem.scale), keep=False), record.size)}


def measured(variant: str) -> dict[str, float]:
    """Nanoseconds per sample of each pass; a part that is missing is compiled before."""
    from drivetool.drive.compile import machine_code

    machine_code.prepare = lambda names: compile_here(variant, names)
    VARIANTS[variant]()
    found = {}
    for name, (call, size) in passes().items():
        call()
        taken = []
        for _ in range(PASSES):
            began = time.process_time()
            call()
            taken.append(time.process_time() - began)
        found[name] = 1e9 * min(taken) / size
    return found


def compile_here(variant: str, names: list[str]) -> None:
    """Compile the parts that are missing with Numba, in a process that leaves the same out."""
    from drivetool.drive.compile import machine_code

    missing = [p for p in machine_code.COMPILED_WITH if p.partition(".")[2] in names]
    subprocess.run([sys.executable, "-m", __spec__.name, variant, *missing], check=True, env=environment(variant))


def compile_parts(variant: str, parts: list[str]) -> None:
    """Lower and emit parts, one after the other, and add what each takes to a table."""
    from drivetool.drive.compile import build, machine_code

    VARIANTS[variant]()
    for part in parts:
        began = time.process_time()
        text = build.lowered(part)
        lowered = time.process_time()
        code = build.emitted(text)
        row = {"part": part, "numba": lowered - began, "llvm": time.process_time() - lowered,
               "instructions": len(re.findall(r"^  \S", text, re.MULTILINE)), "bytes": len(code)}
        with (PLACE / variant / "parts.jsonl").open("a") as table:
            table.write(json.dumps(row) + "\n")
        machine_code.store(machine_code.folder(), part.partition(".")[2], code)


def environment(variant: str) -> dict[str, str]:
    """Machine code in the variant's own folder."""
    return {**os.environ, "NUMBA_CACHE_DIR": str(PLACE / variant), "PYTHONHASHSEED": "0"}


def main() -> None:
    """Both tables, in Markdown."""
    took: dict[str, list[dict[str, float]]] = {variant: [] for variant in VARIANTS}
    for k in range(ROUNDS + 1):
        for variant, rows in took.items():
            (PLACE / variant).mkdir(parents=True, exist_ok=True)
            done = subprocess.run([sys.executable, "-m", __spec__.name, variant], check=True, cwd=ROOT,
                                  stdout=subprocess.PIPE, text=True, env=environment(variant))
            if k:  # the first compiles
                rows.append(json.loads(done.stdout))
    print("| part | Numba, CPU s | LLVM, CPU s | instructions | object kB |\n|---|---|---|---|---|")
    for line in (PLACE / AS_IT_IS / "parts.jsonl").read_text().splitlines():
        row = json.loads(line)
        print(f"| {row['part']} | {row['numba']:.1f} | {row['llvm']:.1f} | {row['instructions']} | "
              f"{row['bytes'] / 1e3:.0f} |")
    print("\n| pass | ns a sample | " + " | ".join(v for v in VARIANTS if v != AS_IT_IS) + " |\n"
          + "|---" * (len(VARIANTS) + 1) + "|")
    for name in took[AS_IT_IS][0]:
        own = [row[name] for row in took[AS_IT_IS]]
        ratios = [f"{statistics.median(r[name] / o for r, o in zip(rows, own, strict=True)):.2f}"
                  for variant, rows in took.items() if variant != AS_IT_IS]
        print(f"| {name} | {min(own):.0f} | " + " | ".join(ratios) + " |")


if __name__ == "__main__":
    if not sys.argv[1:]:
        main()
    elif sys.argv[2:]:
        compile_parts(sys.argv[1], sys.argv[2:])
    else:
        json.dump(measured(sys.argv[1]), sys.stdout)
