"""Missing laws: error and coverage of `greybox` where its model is right and where it lacks a law.

    DRIVETOOL_STUDY_PER_LAW=20 DRIVETOOL_STUDY_PER_RIGHT=40 \
        python -m pytest -m study -s tests/study/study_missing_laws.py
    python -m tests.study.study_missing_laws         # the tables of what has been run so far

DRIVETOOL_STUDY_PER_LAW     records of each law and size; DRIVETOOL_STUDY_PER_RIGHT: of each right situation
DRIVETOOL_STUDY_ESTIMATORS  criteria of the command line, and regression; the first is what others are divided by
DRIVETOOL_STUDY_SIZES       S,M,L
DRIVETOOL_STUDY_SHIFT       other seeds; DRIVETOOL_STUDY_WORKERS: processes
DRIVETOOL_STUDY_RESULTS     rows to go on with; else those of the code that fits as it is now
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from tests.places import ROOT
from tests.study.missing_laws.estimators import REGRESSION
from tests.study.missing_laws.laws import SIZES
from tests.study.missing_laws.runner import FIRST_SEED, jobs, rows, run
from tests.study.missing_laws.tables import summary

PER_LAW, PER_RIGHT = 20, 40
ESTIMATORS = ("innovations", "simulation", REGRESSION)


def results() -> Path:
    """Where the rows of the code that fits, of this study's records and of these seeds are."""
    if "DRIVETOOL_STUDY_RESULTS" in os.environ:
        return Path(os.environ["DRIVETOOL_STUDY_RESULTS"])
    code = hashlib.sha256()
    for room in ("drivetool/logs", "drivetool/drive", "drivetool/identify", "tests/study/missing_laws"):
        for path in sorted((ROOT / room).rglob("*.py")):
            if path.name not in ("scores.py", "tables.py"):
                code.update(path.read_bytes())
    return ROOT / "build" / f"study_missing_laws-{code.hexdigest()[:10]}.jsonl"


def words(name: str, default: tuple[str, ...]) -> tuple[str, ...]:
    """A list of an environment variable, separated by commas."""
    text = os.environ.get(f"DRIVETOOL_STUDY_{name}")
    return tuple(text.split(",")) if text else default


def number(name: str, default: int) -> int:
    """A number of an environment variable."""
    return int(os.environ.get(f"DRIVETOOL_STUDY_{name}", str(default)))


@pytest.mark.study
def test_missing_laws():
    """Every fit answers; the tables are printed."""
    wanted = jobs(number("PER_LAW", PER_LAW), number("PER_RIGHT", PER_RIGHT), words("ESTIMATORS", ESTIMATORS),
                  words("SIZES", tuple(SIZES)))
    found = run(wanted, results(), number("WORKERS", 2))
    print(f"\nseeds from {FIRST_SEED}\n\n" + summary(found, words("ESTIMATORS", ESTIMATORS)[0]))
    by_tool = [row for row in found if row["estimator"] != REGRESSION]
    failed = [row["key"] for row in by_tool if "failed" in row]
    assert len(failed) <= 0.01 * len(by_tool), failed


if __name__ == "__main__":
    print(summary(rows(results()), words("ESTIMATORS", ESTIMATORS)[0]))
