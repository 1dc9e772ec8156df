"""What `batch` costs beside the fits themselves, as ratios: python -m pytest -m bench -s tests/bench/test_batch.py

With another number of recordings: python -m tests.bench.test_batch FOLDER 1000
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests import sites
from tests.places import RIG

pytestmark = pytest.mark.bench

RECIPE = [{"command": "greybox --params start.yaml"}]
BY_HAND = """
import os, sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO, TextIOWrapper, BytesIO
from drivetool.cli.command_line import app

def greybox(path):
    with redirect_stdout(TextIOWrapper(BytesIO())), redirect_stderr(StringIO()):
        try:
            app(["greybox", path, "--params", "start.yaml", "--quiet", "--out", "-"], prog_name="drivetool")
        except SystemExit as left:
            assert not left.code

greybox(sys.argv[1])  # imports, and the machine code is loaded
before = sum(os.times()[:2])
for path in sys.argv[2:]:
    greybox(path)
print((sum(os.times()[:2]) - before) / len(sys.argv[2:]))
"""


def record(folder: Path, count: int) -> list[str]:
    """The main recording of the tour so many times, each of another content; the file that greybox begins with."""
    read = pq.read_table(RIG / "steps.parquet")
    names = [f"logs/press {i % 8 + 1}/{i // 8:03d}.parquet" for i in range(count)]
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(read.replace_schema_metadata({**(read.schema.metadata or {}), "of": name}), path)
    for step, log, more in (("steady", "steady", []), ("blackbox", "steps", ["--params", "steady.yaml"])):
        command(folder, step, RIG / f"{log}.parquet", *more, "--quiet", "--out", f"{step}.yaml").check_returncode()
    command(folder, "greybox", RIG / "steps.parquet", "--params", "steady.yaml", "--params", "blackbox.yaml",
            "--quiet", "--out", "start.yaml").check_returncode()
    sites.write_site(folder, [{"files": "logs/**/*.parquet"}], RECIPE)
    return names


def command(folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
    """drivetool with these words, in a folder."""
    return subprocess.run([sys.executable, "-m", "drivetool", *map(str, words)], cwd=folder, env=environment(),
                          capture_output=True, text=True)


def environment() -> dict[str, str]:
    """That of the workers: this source, one thread."""
    return os.environ | {"PYTHONPATH": str(Path(__file__).parents[2]), "OPENBLAS_NUM_THREADS": "1",
                         "OMP_NUM_THREADS": "1"}


def processor_time(folder: Path, names: list[str]) -> tuple[float, float, float]:
    """(s per recording by batch, s per recording by hand in one process, largest memory of a step in MB)."""
    before = os.times()
    done = command(folder, "batch", "site.yaml", "--workers", "2")
    after = os.times()
    assert done.returncode == 0, done.stderr
    cost = after.children_user + after.children_system - before.children_user - before.children_system
    alone = subprocess.run([sys.executable, "-c", BY_HAND, *names[:21]], cwd=folder, env=environment(),
                           capture_output=True, text=True, check=True)
    memory = max(row["peak_memory_mb"] for row in sites.table(folder / "site-results"))
    return cost / len(names), float(alone.stdout), memory


def side_by_side(folder: Path, count: int) -> float:
    """The time of two batches of one worker each, side by side, over that of one batch of two workers."""
    whole, halves = folder / "whole", [folder / "a", folder / "b"]
    for place, size in ((whole, count), *((half, count // 2) for half in halves)):
        record(place, size)
    words = [sys.executable, "-m", "drivetool", "batch", "site.yaml", "--workers"]
    began = time.perf_counter()
    runs = [subprocess.Popen([*words, "1"], cwd=half, env=environment(), stderr=subprocess.DEVNULL)
            for half in halves]
    assert [run.wait() for run in runs] == [0, 0]
    separate, began = time.perf_counter() - began, time.perf_counter()
    subprocess.run([*words, "2"], cwd=whole, env=environment(), stderr=subprocess.DEVNULL, check=True)
    return separate / (time.perf_counter() - began)


def test_a_recording_costs_little_more_than_by_hand(tmp_path):
    batch, alone, memory = processor_time(tmp_path, record(tmp_path, 100))
    print(f"\n100 recordings: {batch:.2f} s of processor time each, by hand {alone:.2f} s, "
          f"ratio {batch / alone:.2f}; at most {memory:.0f} MB")
    assert batch <= 1.3 * alone


def test_two_workers_reach_what_two_runs_side_by_side_do(tmp_path):
    ratio = side_by_side(tmp_path, 80)
    print(f"\ntwo workers: {ratio:.2f} of what two runs of one worker each reach")
    assert ratio >= 0.9


if __name__ == "__main__":
    where = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
    each = processor_time(where, record(where, int(sys.argv[2]) if len(sys.argv) > 2 else 100))
    print(f"{each[0]:.3f} s each, by hand {each[1]:.3f} s, ratio {each[0] / each[1]:.3f}; at most {each[2]:.0f} MB")
