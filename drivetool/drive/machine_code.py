"""The machine code of the kernel: compiled once, kept in a folder, and loaded without the compiler.

To load the compiler, and what it keeps by itself, takes longer than most fits do.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import llvmlite
from llvmlite import binding as llvm

from drivetool.drive.system import MADE_FOR, MOST_LAWS, MOST_STATES
from drivetool.errors import DriveToolError
from drivetool.progress import counted

KEPT, DAY = 3, 86400.0  # other versions' folders that stay, and any that was in use within a day [s]

# The parts, file and name: the first group that has a part which is needed is compiled as far as it is not there
# yet, what stands in one line one after the other, for it has much in common, and the lines beside one another.
# Two lines, for a third on two cores keeps one of them from the longest.
STEP = ("events.rough_step", "modes.work_out")
GROUPS = (
    *(((f"run.run{size}", f"filter.kalman{size}"), STEP) for size in ("", *(f"_{n}" for n in MADE_FOR))),
    (("run.run_laws", "smooth.law_motion", "smooth.law_columns", "smooth_events.law_rough_step",
      "smooth_events.show"),
     ("filter.kalman_laws", "filter.spread", "filter.join", "smooth.law_transition", "laws.law_torque",
      "modes.work_out")),
    (("events.switch_late",),),
    *(((f"filter.spread_{n}", f"filter.join_{n}"),) for n in MADE_FOR),
    *(((f"smooth_sized.law_columns_{n}_{nl}",),
       (f"smooth_sized.law_motion_{n}_{nl}", f"smooth_sized.law_transition_{n}_{nl}"))
      for n in range(1, MOST_STATES + 1) for nl in range(1, MOST_LAWS + 1)),
)
# Arguments of the parts that Python calls: tables, then numbers.
NUMBERS = {"run": 1, "kalman": 2}

_lock = threading.Lock()
_temporary: list[tempfile.TemporaryDirectory] = []  # gone when this process ends


def versions() -> str:
    """What machine code depends on besides its sources: the compiler and the processor."""
    llvm.initialize_native_target()
    return " ".join([llvmlite.__version__, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()])


def folder_name() -> str:
    """Carries a hash of all sources of the kernel, for any part may call any function, and of the versions."""
    here = Path(__file__).parent
    sources = b"".join(file.read_bytes() for file in sorted(here.rglob("*.py")))
    return "kernel-" + hashlib.sha256(sources + versions().encode()).hexdigest()[:16]


@cache
def folder() -> Path:
    """Where the machine code of this version is kept: beside the sources, in the user's cache, or for now only."""
    here, name = Path(__file__).parent / "__pycache__", folder_name()
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    places = [Path(base)] if (base := os.environ.get("NUMBA_CACHE_DIR")) else [here, Path(home) / "drivetool"]
    for place in places:
        try:
            (place / name).mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(place / name, os.W_OK):
            prune(place / name)
            return place / name
    _temporary.append(tempfile.TemporaryDirectory(prefix="drivetool-"))
    return Path(_temporary[0].name)


def prune(used: Path) -> None:
    """Mark the folder of this version as in use, and remove those of versions long gone beside it.

    Another process may do the same, or still run an older version: that is no error.
    """
    try:
        used.mkdir(parents=True, exist_ok=True)
        os.utime(used)
        others = [(f.stat().st_mtime, f) for f in used.parent.glob("kernel-*") if f != used]
    except OSError:
        return
    for when, other in sorted(others, reverse=True)[KEPT:]:
        if when < time.time() - DAY:
            shutil.rmtree(other, ignore_errors=True)


def compile_with(name: str) -> None:
    """Compile the group of a part."""
    group = next(g for g in GROUPS if any(part.endswith(f".{name}") for line in g for part in line))

    def one(line: tuple[str, ...]) -> None:
        missing = [part for part in line if not object_file(part.partition(".")[2]).exists()]
        if not missing:
            return
        done = subprocess.run([sys.executable, "-m", "drivetool.drive.build", str(folder()), *missing],
                              capture_output=True, text=True, env=_environment())
        if done.returncode != 0:
            last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise DriveToolError(f"the kernel, compiled in {folder()}", last,
                                 "Install drivetool's requirements again; is there room on the disk?")

    with only_here(), ThreadPoolExecutor(len(group)) as pool:
        for _ in counted("first use: the kernel is compiled", pool.map(one, group), len(group)):
            pass


@contextmanager
def only_here() -> Iterator[None]:
    """Of processes that start together one compiles, and the others find it done.

    Where files cannot be locked each does it for itself, which does no harm.
    """
    with (folder() / "lock").open("w") as file:
        with suppress(ImportError, OSError):
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _environment() -> dict[str, str]:
    """This process's, with the places it imports from: a script may have added some."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "NUMBA_DISABLE_JIT": "0"}


@cache
def _engine() -> llvm.ExecutionEngine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(jit=True)
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)


_addresses: dict[str, int] = {}


def address(name: str) -> int:
    """Where a part of the kernel lies in memory; compiled with its group if it has not been yet."""
    if name not in _addresses:
        with _lock:
            if name not in _addresses:
                _addresses[name] = _loaded(name)
    return _addresses[name]


def _loaded(name: str) -> int:
    if not object_file(name).exists():
        compile_with(name)
    engine = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(object_file(name).read_bytes()))
    engine.finalize_object()
    return engine.get_function_address(symbol(name))


def object_file(name: str) -> Path:
    """Where the machine code of a part is kept."""
    return folder() / f"{name}.o"


def symbol(name: str) -> str:
    """What a part is called in its object file."""
    return f"drivetool_{name}"


@cache
def function(name: str):
    """A part that Python calls, with addresses of tables first and numbers then; other threads go on meanwhile."""
    kind, _, made_for = name.partition("_")
    tables, numbers = (4 if made_for == "laws" else 3), NUMBERS[kind]
    kinds = [ctypes.c_void_p] * tables + [ctypes.c_double] * numbers
    return ctypes.CFUNCTYPE(ctypes.c_int64, *kinds)(address(name))
