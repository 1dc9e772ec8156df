"""The kernel's machine code is stored intact, in the right place, and loaded without the compiler."""

import contextlib
import importlib
import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from drivetool.drive.compile import build, lowered, machine_code
from drivetool.drive.compile.lowered import SOURCES
from drivetool.errors import DriveToolError
from drivetool.progress import progress_to

PARTS = sorted(machine_code.COMPILED_WITH)
SMALL_UNIT = "switch_late"  # a part that comes alone
SIMULATION_SCRIPT = """
import sys
import numpy as np
from drivetool.drive.assemble import Layout
from drivetool.drive.simulation.augment import plant_of
from drivetool.drive.chain import two_mass
from drivetool.drive.simulation.simulate import Trace

drive = two_mass().with_values({"motor.inertia": 0.6, "load.inertia": 5.2, "shaft.stiffness": 3300.0,
                                "shaft.damping": 3.1, "load.drag": 0.1})
plant = plant_of(drive, Layout((), ("motor_torque",), ("motor_speed",), 1e-3, gradient=False))
plant.outputs(Trace(np.full((100, 1), 5.0), np.zeros((100, 1)), 1e-3), np.zeros(3))
print(*sys.modules)
"""
TUNING_SCRIPT = """
import sys
import numpy as np
from drivetool.tune.speed_loop import absolute_integrals

assert np.allclose(absolute_integrals(np.array([[-2.0 + 0j]]), np.array([[1.0 + 0j]])), 0.5)
print(*sys.modules)
"""


@pytest.mark.parametrize("script", [SIMULATION_SCRIPT, TUNING_SCRIPT], ids=["simulation", "tuning"])
def test_what_is_compiled_is_loaded_without_the_compiler(script):
    for _ in range(2):  # the first may compile, which it does elsewhere
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        assert "llvmlite" in done.stdout.split() and "numba" not in done.stdout.split()


@pytest.mark.parametrize("part", PARTS)
def test_every_part_is_there(part):
    file, name = part.split(".")
    assert callable(getattr(importlib.import_module(f"{machine_code.KERNEL}.{file}"), name).made)


def test_every_unit_is_a_part():
    units = []
    for file in sorted(SOURCES.rglob("*.py")):
        if "@as_unit(" in file.read_text():
            module = importlib.import_module(f"{machine_code.KERNEL}.{file.stem}")
            units += [f"{file.stem}.{name}" for name, value in vars(module).items()
                      if hasattr(value, "made") and value.home == module.__name__]
    assert sorted(units) == PARTS


@pytest.fixture
def place(monkeypatch, tmp_path):
    """An empty folder in place of the one where machine code is kept, in this process and in others."""
    found = tmp_path / "code" / machine_code.folder().name
    found.mkdir(parents=True, mode=0o700)
    found.parent.chmod(0o700)
    monkeypatch.setattr(machine_code, "folder", lambda: found)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(found.parent))
    return found


@pytest.fixture
def compiler(monkeypatch):
    """What the compiler is called with; it does what `does` holds, and takes no time."""
    calls = Compiler()
    monkeypatch.setattr(subprocess, "Popen", calls.start)
    return calls


class Compiler:
    """A compiler that is not the real one: the tests are about when it is called, and not how it compiles."""

    def __init__(self):
        self.called, self.does, self.says, self.code = [], lambda words: None, (), 0
        self.running = 0

    @contextlib.contextmanager
    def start(self, words, stdout, **_):
        self.called.append(words)
        self.running += 1
        self.does(words)
        os.write(stdout, "".join(self.says).encode())
        yield SimpleNamespace(returncode=self.code)
        self.running -= 1


@pytest.mark.slow
def test_the_machine_code_of_a_part_is_always_the_same(monkeypatch, here, kept):
    """Neither files in the current folder nor Numba's settings reach the compiler."""
    (here / "numba.py").write_text("raise ImportError('not to be imported')")
    (here / ".numba_config.yaml").write_text("boundscheck: 1\n")
    for name in ("NUMBA_BOUNDSCHECK", "NUMBA_DISABLE_JIT", "NUMBA_OPT"):
        monkeypatch.setenv(name, "1")
    before = machine_code.intact_code(SMALL_UNIT)
    (kept / f"{SMALL_UNIT}.o").unlink()
    machine_code.prepare([SMALL_UNIT])
    assert machine_code.intact_code(SMALL_UNIT) == before
    assert not list(kept.glob("*.part"))


def test_a_compiler_that_fails_is_an_error_in_a_sentence(monkeypatch, place, tmp_path):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "llvmlite.py").write_text("raise ImportError('a broken installation')")
    with pytest.raises(DriveToolError, match=r"a broken installation.*requirements") as error:
        machine_code.prepare([SMALL_UNIT])
    assert str(place) in error.value.wanted and not list(place.glob("*.o"))


def compiling(place):
    """A process that compiles a small part into a folder, unless another does."""
    return subprocess.Popen(
        [sys.executable, "-m", "drivetool.drive.compile.build", str(os.getpid()), str(place),
         f"events.{SMALL_UNIT}"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})


def test_of_processes_that_start_together_one_compiles(place):
    """The second waits for the first, and then finds the file there; another part does not wait."""
    fcntl = pytest.importorskip("fcntl")
    with (place / f"{SMALL_UNIT}.lock").open("w") as first:
        fcntl.flock(first, fcntl.LOCK_EX)
        second = compiling(place)
        with pytest.raises(subprocess.TimeoutExpired):
            second.wait(1.0)
        machine_code.store(place, SMALL_UNIT, b"code")
        with machine_code.only_compiler(place, "write_law_torques") as missing:
            assert missing
    assert second.wait(20.0) == 0 and machine_code.intact_code(SMALL_UNIT) == b"code"


def test_a_compiler_ends_with_the_process_that_started_it(place):
    fcntl = pytest.importorskip("fcntl")
    script = ("import sys; from drivetool.drive.compile import machine_code as m; print(flush=True); "
              "m.prepare(['switch_late'])")
    with (place / f"{SMALL_UNIT}.lock").open("w") as first:
        fcntl.flock(first, fcntl.LOCK_EX)
        starter = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE,
                                   env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
        starter.stdout.readline()
        compilers = wait_for(lambda: processes_with(str(place)))
        starter.kill()
        starter.communicate()
        assert compilers and wait_for(lambda: not processes_with(str(place)))


def processes_with(word):
    """Ids of running processes that have a word in their command line."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if word.encode() in file.read_bytes().split(b"\0"):
                found.append(file.parent.name)
    return found


def wait_for(condition, seconds=10.0):
    """What a condition gives as soon as it is true; the last value after that time."""
    end = time.monotonic() + seconds
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.02)
    return found


# The text that comes with the sources

def test_the_text_is_that_of_the_sources():
    """Else run `make kernel`: without the text each fresh machine compiles for minutes."""
    assert [part for part in PARTS if lowered.text_of(part) is None] == []


@pytest.mark.parametrize("damage", ["missing", "cut", "no text", "other sources"])
def test_a_text_that_is_not_that_of_the_sources_is_not_used(tmp_path, monkeypatch, damage):
    file = tmp_path / lowered.ARCHIVES[0]
    lowered.write_archive(file, {"run.run": "text"})
    assert lowered.archive(file) == {"run.run": "text"}
    lowered.archive.cache_clear()
    if damage == "missing":
        file.unlink()
    elif damage == "cut":
        file.write_bytes(file.read_bytes()[:-5])
    elif damage == "no text":
        file.write_bytes(b"text")
    else:
        monkeypatch.setattr(lowered, "source_digest", lambda: "other")
    assert lowered.archive(file) == {}


@pytest.fixture
def without_text(place, monkeypatch, tmp_path):
    """The compiler takes sources that come without their text."""
    shutil.copytree(SOURCES.parent, tmp_path / "drivetool", ignore=shutil.ignore_patterns("*.xz", "__pycache__"))
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.slow
def test_without_the_text_numba_makes_it(without_text):
    machine_code.prepare([SMALL_UNIT])
    assert machine_code.intact_code(SMALL_UNIT) is not None


def test_with_neither_text_nor_numba_a_sentence_says_so(without_text, tmp_path):
    (tmp_path / "numba.py").write_text("raise ModuleNotFoundError(name='numba')")
    with pytest.raises(DriveToolError, match=rf"found neither LLVM text of events.{SMALL_UNIT}[^\n]*numba"):
        machine_code.prepare([SMALL_UNIT])


def test_a_text_that_this_llvm_does_not_read_is_made_anew(monkeypatch):
    text = lowered.text_of(f"events.{SMALL_UNIT}")
    monkeypatch.setattr(build, "text_of", lambda part: text.replace("{", "{ an unknown instruction", 1))
    monkeypatch.setattr(build, "lowered", lambda part: text)
    assert build.object_of(f"events.{SMALL_UNIT}") == build.emitted(text)


# Damaged files. A process that loads one is killed by it: each test loads in a process of its own.

@pytest.fixture(scope="module")
def whole():
    """The machine code of a small part, as it is kept."""
    machine_code.prepare([SMALL_UNIT])
    return machine_code.object_file(SMALL_UNIT)


@pytest.fixture
def kept(whole, place):
    """A folder with a copy of the machine code of a small part."""
    shutil.copy(whole, place)
    return place


def changed(kept, what):
    """The bytes of another file, or None where there is none."""
    whole = (kept / f"{SMALL_UNIT}.o").read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 3] ^= 0x10
    machine_code.store(kept, "write_law_torques",
                       machine_code.intact_code(SMALL_UNIT).replace(SMALL_UNIT.encode(), b"write_law_torques"))
    return {"empty": b"", "short": whole[:10], "cut": whole[:len(whole) // 2], "cut by a byte": whole[:-1],
            "longer": whole + b"\0", "a bit": bytes(flipped), "no digest": whole[:-machine_code.DIGEST],
            "noise": random.Random(1).randbytes(len(whole)),
            "another part": (kept / "write_law_torques.o").read_bytes()}.get(what)


# Replaces the compiler by a copy and logs each call: the test is about when it compiles, not how.
LOADER_SCRIPT = """
import contextlib, shutil, subprocess, sys, time, types
from pathlib import Path
import drivetool.drive.compile.machine_code as machine_code

def run(words, **_):
    time.sleep(float(sys.argv[1]))
    place = machine_code.object_file("switch_late")
    with machine_code.only_compiler(place.parent, "switch_late") as missing:
        if not missing:
            return contextlib.nullcontext(types.SimpleNamespace(stdout=(), returncode=0))
        with open("log", "a") as log:
            print(*words[-1:], file=log)
        if place.is_dir():
            machine_code.store(place.parent, "switch_late", Path("good").read_bytes()[:-machine_code.DIGEST])
        else:
            shutil.copy("good", place.with_name("temporary"))
            place.with_name("temporary").replace(place)
    return contextlib.nullcontext(types.SimpleNamespace(stdout=(), returncode=0))

subprocess.Popen = run
print(machine_code.address("switch_late") > 0)
"""


def loaded(kept, processes):
    """How often it is compiled when so many processes load it at once."""
    work = kept.parent
    (work / "log").touch()
    wait = 0.3 if processes > 1 else 0.0  # for the others to find the file damaged too
    running = [subprocess.Popen([sys.executable, "-c", LOADER_SCRIPT, str(wait)], cwd=work,
                                stdout=subprocess.PIPE, text=True,
                                env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
               for _ in range(processes)]
    assert [(p.communicate()[0], p.returncode) for p in running] == [("True\n", 0)] * processes
    return (work / "log").read_text().split()


@pytest.mark.parametrize("what, processes", [
    ("empty", 3), *((what, 1) for what in ("short", "cut", "cut by a byte", "longer", "a bit", "no digest", "noise",
                                           "another part", "another version", "folder", "full folder", "loop"))])
def test_a_damaged_file_is_compiled_anew_once(kept, what, processes):
    file = kept / f"{SMALL_UNIT}.o"
    content = changed(kept, what)
    shutil.copy(file, kept.parent / "good")
    if what == "another version":
        aside = kept.parent / "kernel-other"
        aside.mkdir()
        machine_code.store(aside, SMALL_UNIT, machine_code.intact_code(SMALL_UNIT))
        content = (aside / file.name).read_bytes()
    file.unlink()
    if content is not None:
        file.write_bytes(content)
    elif what == "loop":  # as unreadable to root as to anybody
        file.symlink_to(file)
    else:
        file.mkdir()
        if what == "full folder":
            (file / "notes.txt").write_text("not ours")
    assert loaded(kept, processes) == [f"events.{SMALL_UNIT}"]
    assert machine_code.intact_code(SMALL_UNIT) is not None
    if what == "full folder":
        assert [f.read_text() for f in kept.rglob("notes.txt")] == ["not ours"]


def test_a_whole_file_is_loaded_as_it_is(kept):
    assert loaded(kept, 1) == []


def test_what_was_checked_is_what_is_loaded(monkeypatch, kept):
    """A file that changes meanwhile is not read twice."""
    reads, read = [], machine_code.read_regular
    monkeypatch.setattr(machine_code, "read_regular", lambda file: reads.append(file.name) or read(file))
    monkeypatch.setattr(machine_code, "_engine", lambda: Mock(get_function_address=lambda _: 1))
    assert machine_code._load(SMALL_UNIT) == 1 and reads == [f"{SMALL_UNIT}.o"]


@pytest.mark.usefixtures("compiler")
def test_a_disk_that_damages_every_file_is_an_error_in_a_sentence(kept):
    (kept / f"{SMALL_UNIT}.o").write_bytes(b"")
    with pytest.raises(DriveToolError, match="damaged file as soon as it is written"):
        machine_code._load(SMALL_UNIT)


# All parts at once

@pytest.fixture
def compiled(monkeypatch, place, compiler):
    """(compiled parts, numbers of compilers in parallel), with a compiler that takes no time."""
    monkeypatch.setattr(machine_code, "MAX_COMPILERS", 2)
    parts, peak = [], []

    def compile_parts(words):
        peak.append(compiler.running)
        for part in words[words.index(str(place)) + 1:]:
            parts.append(part)
            machine_code.store(place, part.partition(".")[2], part.encode())

    compiler.does = compile_parts
    return parts, peak


def test_all_parts_are_compiled_once_and_two_at_once(compiled):
    parts, most = compiled
    machine_code.prepare()
    assert sorted(parts) == PARTS and max(most) == 2
    machine_code.prepare()
    assert len(parts) == len(PARTS)


def test_only_what_is_missing_is_compiled(compiled, place):
    parts, _ = compiled
    machine_code.prepare()
    parts.clear()
    (place / "kalman_3.o").unlink()
    (place / "write_law_torques.o").write_bytes(b"")
    machine_code.prepare(["switch_late"])
    assert not parts
    machine_code.prepare()
    assert sorted(parts) == ["filter.kalman_3", "smooth_events.write_law_torques"]


def test_a_part_comes_with_what_it_calls_alone(compiled):
    parts, _ = compiled
    machine_code.prepare(["run_3", "switch_late"])
    assert sorted(parts) == ["events.step_through_events", "events.switch_late", "modes.compute_mode", "run.run_3"]


@pytest.mark.parametrize("says, code", [(["run.run_3\n", "modes.compute_mode\n", "a warning\n"], 0), ((), 0),
                                        (["run.run_3\n", "ValueError: broken\n"], 1)])
def test_progress_counts_parts_and_not_processes(monkeypatch, place, compiler, says, code):
    """Also where the compiler says less than it should, or fails."""
    monkeypatch.setattr(machine_code, "MAX_COMPILERS", 1)
    compiler.says, compiler.code = says, code
    lines = []
    with progress_to(lambda *line: lines.append(line)), \
            pytest.raises(DriveToolError, match="ValueError: broken") if code else contextlib.nullcontext():
        machine_code.prepare(["run_3"])
    assert len(compiler.called) == 1
    ready = sum(name.strip() in PARTS for name in says)
    assert [done for _, done, _ in lines] == [*range(ready + 1), 3]
    assert {(stage, total) for stage, _, total in lines} == {("first use: 3 parts of the kernel are compiled", 3)}


def test_a_compiler_names_each_part_as_it_is_ready(place):
    assert not machine_code.intact_code(SMALL_UNIT)
    assert list(machine_code._compile(["events.switch_late"])) == ["events.switch_late"]
    assert machine_code.intact_code(SMALL_UNIT)


def test_a_folder_that_is_cleared_meanwhile_is_made_again(place, compiler):
    shutil.rmtree(place.parent)
    compiler.does = lambda words: machine_code.store(place, SMALL_UNIT, b"code")
    machine_code.prepare([SMALL_UNIT])
    assert machine_code.intact_code(SMALL_UNIT) == b"code"
