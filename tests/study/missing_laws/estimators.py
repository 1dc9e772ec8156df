"""What each estimator says of a record: the command line by its criteria, and plain least squares."""

from __future__ import annotations

import json
import signal
import tempfile
import time
from collections.abc import Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.study.missing_laws.record import Record, draw
from tests.study.missing_laws.regression import least_squares

REGRESSION = "regression"
NAMES = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")
UNITS = {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s", "motor_angle": "rad"}
SECONDS = 300  # of wall clock for one fit, beyond which it has failed


def write(record: Record, path: Path) -> None:
    """The record as Parquet, units in the metadata of the fields."""
    columns = {"time": record.step * np.arange(len(record.torque)), "motor_torque": record.torque,
               record.role: record.measured}
    schema = pa.schema([pa.field(name, pa.float64(), metadata={"unit": UNITS[name]}) for name in columns])
    pq.write_table(pa.table(list(columns.values()), schema=schema), path)


def start_values(record: Record, seed: int) -> dict[str, float]:
    """Name -> a value 15 to 50 % off the machine's own, above or below it."""
    rng = np.random.default_rng([seed, 40503])
    off = rng.choice([-1.0, 1.0], 4) * rng.uniform(0.15, 0.5, 4)
    return {name: float(value) for name, value in
            zip(NAMES, record.machine.numbers() * (1.0 + off), strict=True)}


def fit(record: Record, seed: int, criterion: str) -> dict:
    """`drivetool greybox` in this process; values, stds and intervals in the order of NAMES.

    criterion  of the command line, or REGRESSION
    returns    value, std, ci95 (None where the tool states none), correlation (4 x 4), seconds of
               processor time; where it failed only failed and seconds
    """
    if criterion == REGRESSION:
        begun = time.process_time()
        try:
            found = _plain(record)
        except ValueError as problem:
            found = {"failed": str(problem)}
        return found | {"seconds": time.process_time() - begun}
    with tempfile.TemporaryDirectory() as room:
        log = Path(room) / "record.parquet"
        write(record, log)
        words = ["greybox", str(log), "--drive", "one-body", "--criterion", criterion, "--json", "--quiet"]
        for name, value in start_values(record, seed).items():
            words += ["--set", f"{name}={value!r}"]
        code, out, err, seconds = _command(words)
    if code not in (0, 3):
        return {"failed": err.strip()[-200:] or f"exit code {code}", "seconds": seconds}
    return read(json.loads(out)) | {"seconds": seconds}


def read(answer: Mapping) -> dict:
    """What a parameter file says of the four parameters."""
    lines = [answer["parameters"].get(name) or {} for name in NAMES]
    matrix, stated = np.full((4, 4), np.nan), (answer.get("covariance") or {}).get("names", [])
    order = [NAMES.index(name) for name in stated if name in NAMES]
    whole = np.array((answer.get("covariance") or {}).get("matrix", []), float)
    if order:
        kept = [i for i, name in enumerate(stated) if name in NAMES]
        part = whole[np.ix_(kept, kept)]
        matrix[np.ix_(order, order)] = part / np.sqrt(np.outer(np.diag(part), np.diag(part)))
    return {"value": [line.get("value") for line in lines], "std": [line.get("std") for line in lines],
            "ci95": [line.get("ci95") for line in lines], "status": [line.get("status") for line in lines],
            "correlation": [[None if np.isnan(x) else x for x in row] for row in matrix.tolist()],
            "findings": [finding["code"] for finding in answer.get("findings", ())
                         if finding.get("severity") != "note"]}


def warm_up(criteria: tuple[str, ...]) -> None:
    """One fit of each, so that no row counts the loading of compiled code."""
    record = draw("quiet", "", 7, 1)
    for criterion in criteria:
        fit(record, 1, criterion)


def _plain(record: Record) -> dict:
    found = least_squares(record.step, record.torque, record.measured, record.role == "motor_angle")
    std = np.sqrt(np.diag(found.covariance))
    half = found.factor * std
    return {"value": found.value.tolist(), "std": std.tolist(),
            "ci95": np.column_stack([found.value - half, found.value + half]).tolist(),
            "status": ["fitted"] * 4, "findings": [],
            "correlation": (found.covariance / np.outer(std, std)).tolist()}


def _command(words: list[str]) -> tuple[int, str, str, float]:
    """(exit code, standard output, standard error, seconds of processor time) of a command in this process."""
    from drivetool.cli.main import app

    out, err, begun = StringIO(), StringIO(), time.process_time()
    try:
        with _limited(SECONDS), redirect_stdout(out), redirect_stderr(err):
            code = app(words, standalone_mode=True, prog_name="drivetool") or 0
    except SystemExit as end:
        code = end.code or 0
    except TimeoutError:
        code = 124
        err.write(f"not done after {SECONDS} s")
    return code, out.getvalue(), err.getvalue(), time.process_time() - begun


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
