"""The console entry: `drivetool STEP LOG...`."""

from __future__ import annotations

import os
import sys

from drivetool.cli.command_line import app


def run() -> None:
    """Entry point of the console script."""
    # The matrices here are small; BLAS threads only fight each other, and make sums unrepeatable.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")  # a channel's name may not fit the terminal's encoding
    app(prog_name="drivetool")


if __name__ == "__main__":
    run()
