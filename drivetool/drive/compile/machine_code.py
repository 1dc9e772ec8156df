"""The machine code of the kernel: compiled once, stored in a folder, and loaded without the compiler.

Loading the compiler and its own cache takes longer than most fits.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from drivetool.drive.arrays import MAX_SIZED_LAWS, MOST_STATES, SIZED_STATE_COUNTS
from drivetool.drive.compile.code_folder import PRIVATE, folder, read_regular, write_whole
from drivetool.errors import DriveToolError
from drivetool.progress import FIRST_USE, counted

if TYPE_CHECKING:
    from llvmlite.binding import ExecutionEngine

KERNEL = "drivetool.drive.kernel"  # where the files of the parts are

# The parts, as file.name, and with each the others that are needed too: it calls them, or is used beside them.
STEP_UNITS = ("events.step_through_events", "modes.compute_mode")
COMPILED_WITH: Mapping[str, tuple[str, ...]] = MappingProxyType({
    **dict.fromkeys(STEP_UNITS, ()), "events.switch_late": (), "smooth_events.write_law_torques": (),
    **{f"{kind}{size}": STEP_UNITS for kind in ("run.run", "filter.kalman")
       for size in ("", *(f"_{n}" for n in SIZED_STATE_COUNTS))},
    **{f"filter.{unit}{size}": (f"filter.{other}{size}",) for size in ("", *(f"_{n}" for n in SIZED_STATE_COUNTS))
       for unit, other in (("covariance_step", "premultiply"), ("premultiply", "covariance_step"))},
    "laws.law_torque": ("run.run_laws", "smooth_events.step_through_law_events", "modes.compute_mode"),
    **dict.fromkeys(("run.run_laws", "filter.kalman_laws", "smooth_events.step_through_law_events"), ()),
    **{f"{file}.law_{unit}{size}": tuple(f"{file}.law_{u}{size}" for u in ("motion", "columns", "transition"))
       for file, size in (("smooth", ""), *(("smooth_sized", f"_{n}_{nl}") for n in range(1, MOST_STATES + 1)
                                            for nl in range(1, MAX_SIZED_LAWS + 1)))
       for unit in ("motion", "columns", "transition")},
    "modal.extrema": (),
})
# Arguments of the parts that Python calls: tables, one more where there are smooth laws, then numbers.
ARGUMENTS = {"run": (3, 1), "kalman": (3, 2), "extrema": (1, 0)}
DIGEST = hashlib.sha256().digest_size  # length of the digest [bytes]
MAX_COMPILERS = min(os.cpu_count() or 1, 4)  # compilers in parallel; each takes up to 400 MB

_lock = threading.Lock()


def prepare(names: Collection[str] | None = None) -> None:
    """Compile these parts and those that come with them, or all, as far as one is missing or damaged.

    names   of parts, as `address` takes them; None for all
    raises  DriveToolError: a part cannot be compiled or kept
    """
    parts = [part for part in COMPILED_WITH if names is None or part.partition(".")[2] in names]
    missing = [part for part in dict.fromkeys(p for part in parts for p in (part, *COMPILED_WITH[part]))
               if intact_code(part.partition(".")[2]) is None]
    if not missing:
        return
    folder().mkdir(PRIVATE, parents=True, exist_ok=True)  # a cache cleaner may have removed it meanwhile
    for _ in counted(f"{FIRST_USE}: {len(missing)} parts of the kernel are compiled", _compile(missing),
                     len(missing)):
        pass


def _compile(parts: Sequence[str]) -> Iterator[str]:
    """Compile parts in processes of their own; each part as it is ready."""
    reading, writing = os.pipe()
    last = "no reason given"
    with ExitStack() as running, open(reading, encoding="utf-8", errors="replace") as said:
        # Python imports, and Numba reads settings, from the current folder first: this one has neither.
        compilers = [running.enter_context(subprocess.Popen(
            [sys.executable, "-m", f"{__package__}.build", str(os.getpid()), str(folder()), *own],
            stdout=writing, stderr=writing, env=_environment(), cwd=folder()))
            for own in (parts[k::MAX_COMPILERS] for k in range(min(MAX_COMPILERS, len(parts))))]
        os.close(writing)  # theirs end with them
        for line in map(str.strip, said):
            if line in parts:
                yield line
            else:
                last = line or last
    if any(compiler.returncode for compiler in compilers):
        raise DriveToolError(f"the kernel, compiled in {folder()}", last,
                             "Install drivetool's requirements again; is there room on the disk?")


@contextmanager
def only_compiler(place: Path, name: str) -> Iterator[bool]:
    """Whether a part is still missing in a folder, while no other process compiles it.

    Of several processes that start together one compiles a part, and the others wait for that part alone. Where
    files cannot be locked each compiles for itself, which is harmless.
    """
    with ExitStack() as stack:
        with suppress(ImportError, OSError):
            import fcntl

            fcntl.flock(stack.enter_context((place / f"{name}.lock").open("a")), fcntl.LOCK_EX)
        yield intact_code(name, place) is None


def _environment() -> dict[str, str]:
    """This process's environment with its import path, and without settings that change the code of a part.

    Some of Numba's settings change code, and Numba orders names by sets, which depend on Python's hash seed.
    """
    plain = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    return {**plain, "PYTHONHASHSEED": "0", "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))}


@cache
def _engine() -> ExecutionEngine:
    from llvmlite import binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(jit=True)
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)


_addresses: dict[str, int] = {}


def address(name: str) -> int:
    """Address of a part of the kernel in memory; compiled with its group if it has not been yet."""
    if name not in _addresses:
        with _lock:
            if name not in _addresses:
                _addresses[name] = _load(name)
    return _addresses[name]


def _load(name: str) -> int:
    code = intact_code(name)
    if code is None:
        prepare([name])
        code = intact_code(name)
    if code is None:
        raise DriveToolError(f"the machine code of {name} in {folder()}", "a damaged file as soon as it is written",
                             "Is the disk sound? Set NUMBA_CACHE_DIR to a folder on another.")
    from llvmlite import binding as llvm  # most commands neither compile nor simulate

    engine = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine.get_function_address(symbol(name))


def object_file(name: str, place: Path | None = None) -> Path:
    """File with the machine code of a part: the object file, then a digest; place: None, the folder in use."""
    return (place or folder()) / f"{name}.o"


def store(place: Path, name: str, code: bytes) -> None:
    """Store the machine code of a part in a folder, completely or not at all."""
    file = object_file(name, place)
    if file.is_dir() and not file.is_symlink():  # not this tool's: it is moved aside
        os.replace(file, tempfile.mkdtemp(prefix=f"{file.name}-", dir=place))
    write_whole(file, code + _digest(place, name, code))


def intact_code(name: str, place: Path | None = None) -> bytes | None:
    """The machine code of a part in a folder, None if it is missing, damaged, or of another part."""
    content = read_regular(object_file(name, place))
    if content is None:
        return None
    code, digest = content[:-DIGEST], content[-DIGEST:]
    return code if digest == _digest(place or folder(), name, code) else None


def _digest(place: Path, name: str, code: bytes) -> bytes:
    """Digest of the code, its name and folder: a file of another part or version does not pass either."""
    return hashlib.sha256(f"{place.name}/{name}\n".encode() + code).digest()


def symbol(name: str) -> str:
    """Name of a part in its object file."""
    return f"drivetool_{name}"


@cache
def function(name: str):
    """A part that Python calls with addresses of tables, then numbers; other threads run meanwhile."""
    kind, _, variant = name.partition("_")
    tables, numbers = ARGUMENTS[kind]
    kinds = [ctypes.c_void_p] * (tables + (variant == "laws")) + [ctypes.c_double] * numbers
    return ctypes.CFUNCTYPE(ctypes.c_int64, *kinds)(address(name))
