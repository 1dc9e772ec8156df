"""How the kernel's machine code is kept: whole, in the right place, and loaded without the compiler."""

import importlib
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from drivetool.drive import machine_code
from drivetool.errors import DriveToolError

PARTS = sorted({part for group in machine_code.GROUPS for line in group for part in line})
ALONE = """
import sys
import numpy as np
from drivetool.drive.assemble import Layout
from drivetool.drive.augment import plant_of
from drivetool.drive.chain import two_mass
from drivetool.drive.simulate import Trace

drive = two_mass().with_values({"motor.inertia": 0.6, "load.inertia": 5.2, "shaft.stiffness": 3300.0,
                                "shaft.damping": 3.1, "load.drag": 0.1})
plant = plant_of(drive, Layout((), ("motor_torque",), ("motor_speed",), 1e-3, gradient=False))
plant.outputs(Trace(np.full((100, 1), 5.0), np.zeros((100, 1)), 1e-3), np.zeros(3))
print(*sys.modules)
"""


def test_what_is_compiled_is_loaded_without_the_compiler():
    for _ in range(2):  # the first may compile, which it does elsewhere
        done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, check=True)
        assert "llvmlite" in done.stdout.split() and "numba" not in done.stdout.split()


@pytest.mark.parametrize("part", PARTS)
def test_every_part_is_there(part):
    file, name = part.split(".")
    assert callable(getattr(importlib.import_module(f"drivetool.drive.{file}"), name).made)


def test_every_unit_is_a_part():
    folder = Path(machine_code.__file__).parent
    units = []
    for file in sorted(folder.glob("*.py")):
        if "\nfrom drivetool.drive.compiled import" in file.read_text():
            module = importlib.import_module(f"drivetool.drive.{file.stem}")
            units += [f"{file.stem}.{name}" for name, value in vars(module).items()
                      if hasattr(value, "made") and value.home == module.__name__]
    assert sorted(units) == PARTS


def test_machine_code_of_old_versions_is_removed(tmp_path):
    """What was in use within a day stays, and the newest three; so does what is not ours."""
    for name, days in (("kernel-a", 0.0), ("kernel-b", 0.1), ("kernel-c", 0.2), ("kernel-d", 0.3),
                       ("kernel-e", 2.0), ("kernel-now", 40.0), ("other", 40.0),
                       ("old/kernel-a", 2.0), ("old/kernel-b", 3.0),
                       ("old/kernel-c", 4.0), ("old/kernel-d", 5.0)):
        (tmp_path / name / "sub").mkdir(parents=True)
        os.utime(tmp_path / name, (time.time() - 86400.0 * days,) * 2)
    machine_code.prune(tmp_path / "kernel-now")
    machine_code.prune(tmp_path / "old" / "kernel-new")
    assert {f.name for f in tmp_path.iterdir()} == {*(f"kernel-{k}" for k in "abcd"), "kernel-now", "other", "old"}
    assert {f.name for f in (tmp_path / "old").iterdir()} == {"kernel-a", "kernel-b", "kernel-c", "kernel-new"}


def test_the_folder_is_named_after_all_sources(monkeypatch):
    """A part holds what it calls in other files."""
    before, read = machine_code.folder_name(), Path.read_bytes
    for name in ("run.py", "effects/drag.py"):
        monkeypatch.setattr(Path, "read_bytes", lambda file, name=name: read(file) + (
            b"#" if file.as_posix().endswith(f"drive/{name}") else b""))
        assert machine_code.folder_name() != before


def test_where_nothing_may_be_written_the_code_is_kept_for_now(monkeypatch, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("a file where a folder is wanted")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(taken))
    place = machine_code.folder.__wrapped__()
    assert place.is_dir() and tmp_path not in place.parents
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert machine_code.folder.__wrapped__() == tmp_path / machine_code.folder_name()


def test_a_compiler_that_fails_is_an_error_in_a_sentence(monkeypatch, tmp_path):
    monkeypatch.setattr(machine_code, "folder", lambda: tmp_path)
    monkeypatch.setattr(machine_code, "_environment", lambda: {**os.environ, "PYTHONPATH": str(tmp_path)})
    (tmp_path / "numba.py").write_text("raise ImportError('a broken installation')")
    with pytest.raises(DriveToolError, match=r"a broken installation.*requirements") as error:
        machine_code.compile_with("switch_late")
    assert str(tmp_path) in error.value.wanted and not list(tmp_path.glob("*.o"))


def test_of_processes_that_start_together_one_compiles(monkeypatch, tmp_path):
    """The second waits for the first, and then finds the file there."""
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr(machine_code, "folder", lambda: tmp_path)
    started = []
    monkeypatch.setattr(subprocess, "run", lambda words, **_: started.append(words))
    with (tmp_path / "lock").open("w") as first:
        fcntl.flock(first, fcntl.LOCK_EX)
        second = threading.Thread(target=machine_code.compile_with, args=("switch_late",))
        second.start()
        second.join(0.2)
        assert second.is_alive() and not started
        (tmp_path / "switch_late.o").touch()
    second.join()
    assert not started
