"""How the kernel is compiled, and where the result is kept.

Numba's cache looks only at the file a function is written in, so a change in a function it calls
would go unseen. The cache folder therefore carries a hash of all the kernel's sources.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.compiler import Compiler
from numba.extending import intrinsic

KEPT, DAY = 3, 86400.0  # other versions' folders that stay, and any that was in use within a day [s]


def _cache_folder() -> str:
    here = Path(__file__).parent
    sources = b"".join(file.read_bytes() for file in sorted(here.rglob("*.py")))
    key = "kernel-" + hashlib.sha256(sources).hexdigest()[:16]
    if base := os.environ.get("NUMBA_CACHE_DIR"):
        return str(Path(base) / key)
    if os.access(here, os.W_OK):
        return str(here / "__pycache__" / key)
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return str(Path(home) / "drivetool" / key)


def _prune(folder: Path) -> None:
    """Mark the folder of this version as in use, and remove those of versions long gone beside it.

    Another process may do the same, or still run an older version: that is no error.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        others = [(f.stat().st_mtime, f) for f in folder.parent.glob("kernel-*") if f != folder]
    except OSError:
        return
    for used, other in sorted(others, reverse=True)[KEPT:]:
        if used < time.time() - DAY:
            shutil.rmtree(other, ignore_errors=True)


numba.config.CACHE_DIR = _cache_folder()
_prune(Path(numba.config.CACHE_DIR))

class _Apart(Compiler):
    def __init__(self, typingctx, targetctx, library, args, return_type, flags, locals):
        flags.noalias = True
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)


# The kernel allocates nothing, so it does without reference counts (_nrt): counting every array at
# every call cost ten times the arithmetic. What runs every sample is inlined (HOT).
PLAIN = {"nogil": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy", "_nrt": False}
COMPILE = {**PLAIN, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
HOT = {**COMPILE, "forceinline": True}
# The same where no array that is written overlaps another argument: else the compiler tests for that
# at every call, and takes vectors only for loops so long that the test pays.
APART = {**HOT, "pipeline_class": _Apart}
ONCE = {**COMPILE, "inline": "always"}  # what is called from one place
ENTRY = {**PLAIN, "cache": True, "no_cfunc_wrapper": True}  # what Python calls
LAW = numba.njit(**COMPILE)  # how an effect compiles its smooth law


def unit(*kinds: types.Type) -> Callable:
    """Compile a function without result by itself, and only when its address is asked for.

    What compiled code calls in the usual way Numba compiles once more into every caller, and with
    that again into the caller's callers: a minute for a deep tree of functions. A unit is called
    by its address, which travels in a table: `unit_function(address, arguments ...)`.

    kinds  Numba types of the arguments
    """
    def decorate(function: Callable) -> Callable:
        @intrinsic
        def call(typing, place, *arguments):
            def code(context, builder, signature, values):
                numbers = [context.get_value_type(k) for k in kinds]
                kind = ir.FunctionType(context.get_value_type(types.none), numbers)
                function = builder.inttoptr(values[0], kind.as_pointer())
                builder.call(function, cgutils.unpack_tuple(builder, values[1]))
                return context.get_dummy_value()

            return types.none(types.int64, types.StarArgTuple(kinds)), code

        call.made = lambda: numba.cfunc(types.none(*kinds), **PLAIN, cache=True)(function)
        return call

    return decorate


_addresses: dict[object, numba.core.ccallback.CFunc] = {}


def address(call: Callable) -> int:
    """Where a unit lies in memory, compiled if it has not been yet."""
    if call not in _addresses:
        _addresses[call] = call.made()
    return _addresses[call].address
