"""`drivetool greybox` on one record, in this process, and what it says of some parameters."""

from __future__ import annotations

import json
import signal
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

UNITS = {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s", "motor_angle": "rad", "load_speed": "rad/s",
         "shaft_torque": "Nm"}
SECONDS = 300  # of wall clock for one fit, beyond which it has failed


def write(step: float, channels: Mapping[str, np.ndarray], path: Path) -> None:
    """A record as Parquet, units in the metadata of the fields.

    step      [s]
    channels  role -> (n,) values
    """
    size = len(next(iter(channels.values())))
    columns = {"time": step * np.arange(size), **channels}
    schema = pa.schema([pa.field(name, pa.float64(), metadata={"unit": UNITS[name]}) for name in columns])
    pq.write_table(pa.table(list(columns.values()), schema=schema), path)


def greybox(step: float, channels: Mapping[str, np.ndarray], start: Mapping[str, float], names: Sequence[str],
            words: Sequence[str]) -> dict:
    """The step on a record, from start values.

    names    parameters to be read from its answer
    words    further words of the command
    returns  what `read` finds, and seconds of processor time; where it failed only failed and seconds
    """
    with tempfile.TemporaryDirectory() as room:
        log = Path(room) / "record.parquet"
        write(step, channels, log)
        sets = [word for name, value in start.items() for word in ("--set", f"{name}={value!r}")]
        code, out, err, seconds = _command(["greybox", str(log), *words, "--json", "--quiet", *sets])
    if code not in (0, 3):
        return {"failed": err.strip()[-200:] or f"exit code {code}", "seconds": seconds}
    return read(json.loads(out), names) | {"seconds": seconds}


def read(answer: Mapping, names: Sequence[str]) -> dict:
    """What a parameter file says of some parameters.

    returns  value, std, ci95, status in the order of names (None where the tool states none), correlation
             (n x n), codes of the findings that are no notes
    """
    n, lines = len(names), [answer["parameters"].get(name) or {} for name in names]
    matrix, stated = np.full((n, n), np.nan), (answer.get("covariance") or {}).get("names", [])
    order = [names.index(name) for name in stated if name in names]
    whole = np.array((answer.get("covariance") or {}).get("matrix", []), float)
    if order:
        kept = [i for i, name in enumerate(stated) if name in names]
        part = whole[np.ix_(kept, kept)]
        matrix[np.ix_(order, order)] = part / np.sqrt(np.outer(np.diag(part), np.diag(part)))
    return {"value": [line.get("value") for line in lines], "std": [line.get("std") for line in lines],
            "ci95": [line.get("ci95") for line in lines], "status": [line.get("status") for line in lines],
            "correlation": [[None if np.isnan(x) else x for x in row] for row in matrix.tolist()],
            "findings": [finding["code"] for finding in answer.get("findings", ())
                         if finding.get("severity") != "note"]}


def _command(words: list[str]) -> tuple[int, str, str, float]:
    """(exit code, standard output, standard error, seconds of processor time) of a command in this process."""
    from drivetool.cli.command_line import app

    out, err, began = StringIO(), StringIO(), time.process_time()
    try:
        with _limited(SECONDS), redirect_stdout(out), redirect_stderr(err):
            code = app(words, standalone_mode=True, prog_name="drivetool") or 0
    except SystemExit as end:
        code = end.code or 0
    except TimeoutError:
        code = 124
        err.write(f"not done after {SECONDS} s")
    return code, out.getvalue(), err.getvalue(), time.process_time() - began


@contextmanager
def _limited(seconds: int):
    """TimeoutError when the time is over; compiled code is waited for."""
    def over(_number, _frame):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, over)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
