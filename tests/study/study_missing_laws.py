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

from pathlib import Path

import pytest

from tests.study.missing_laws.estimators import REGRESSION
from tests.study.missing_laws.laws import SIZES
from tests.study.missing_laws.runner import FIRST_SEED, LAYOUT, run
from tests.study.missing_laws.tables import summary
from tests.study.shared import options
from tests.study.shared.options import number, words
from tests.study.shared.rows import rows

PER_LAW, PER_RIGHT = 20, 40
ESTIMATORS = ("innovations", "simulation", REGRESSION)
CODE = ("drivetool/logs", "drivetool/drive", "drivetool/identify", "tests/study/missing_laws", "tests/study/shared")


def results() -> Path:
    """Where the rows of the code that fits, of this study's records and of these seeds are."""
    return options.results("study_missing_laws", CODE)


@pytest.mark.study
def test_missing_laws():
    """Every fit answers; the tables are printed."""
    wanted = LAYOUT.jobs(number("PER_LAW", PER_LAW), number("PER_RIGHT", PER_RIGHT),
                         words("ESTIMATORS", ESTIMATORS), words("SIZES", tuple(SIZES)))
    found = run(wanted, results(), number("WORKERS", 2))
    print(f"\nseeds from {FIRST_SEED}\n\n" + summary(found, words("ESTIMATORS", ESTIMATORS)[0]))
    by_tool = [row for row in found if row["estimator"] != REGRESSION]
    failed = [row["key"] for row in by_tool if "failed" in row]
    assert len(failed) <= 0.01 * len(by_tool), failed


if __name__ == "__main__":
    print(summary(rows(results()), words("ESTIMATORS", ESTIMATORS)[0]))
