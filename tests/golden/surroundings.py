"""What results depend on besides inputs, sources and libraries."""

from __future__ import annotations

import json
import platform
from pathlib import Path

# A terminal without colours, a fixed clock and language, and one thread for the sums of BLAS.
FIXED = {"COLUMNS": "80", "LINES": "50", "TERM": "dumb", "NO_COLOR": "1", "TZ": "UTC", "LANG": "C.UTF-8",
         "LC_ALL": "C.UTF-8", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0",
         "MPLBACKEND": "agg"}
WRAPPER = '#!/bin/sh\nexec "{python}" -P -m drivetool "$@"\n'
CPUINFO = Path("/proc/cpuinfo")


def processor() -> str:
    """The kind of processor, for which Numba compiles and BLAS chooses its sums."""
    try:
        from llvmlite.binding import get_host_cpu_name
    except ImportError:
        return f"{platform.machine()} {_model()}"
    return f"{platform.machine()} {get_host_cpu_name()}"


def _model() -> str:
    """What the system calls it."""
    try:
        lines = CPUINFO.read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def described() -> bytes:
    """All of it, for a hash."""
    return json.dumps([FIXED, WRAPPER, processor()], sort_keys=True).encode()
