"""How the kernel is compiled, and where the result is kept.

Numba's cache looks only at the file a function is written in, so a change in a function it calls
would go unseen. The cache folder therefore carries a hash of all the kernel's sources.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numba


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


numba.config.CACHE_DIR = _cache_folder()

# The kernel allocates nothing, so it does without reference counts (_nrt): counting every array at
# every call cost ten times the arithmetic. What runs every sample is inlined (HOT).
COMPILE = {"cache": True, "nogil": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy", "_nrt": False}
HOT = {**COMPILE, "forceinline": True}
LAW = numba.njit(**COMPILE)  # how an effect compiles its smooth law
