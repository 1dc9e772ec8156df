"""Missing laws of two-mass drives: error and coverage of `greybox` where its model is right and where it is not.

    DRIVETOOL_STUDY_PER_LAW=10 DRIVETOOL_STUDY_PER_RIGHT=20 \
        python -m pytest -m study -s tests/study/study_missing_laws_two_masses.py
    python -m tests.study.study_missing_laws_two_masses     # the tables of what has been run so far

DRIVETOOL_STUDY_PER_LAW     records of each law and size; DRIVETOOL_STUDY_PER_RIGHT: of each right situation
DRIVETOOL_STUDY_ESTIMATORS  criteria of the command line, each with what it frees besides
                            (innovations+load.coulomb); the first is what others are divided by
DRIVETOOL_STUDY_SIZES       S,M,L
DRIVETOOL_STUDY_SHIFT       other seeds; DRIVETOOL_STUDY_WORKERS: processes
DRIVETOOL_STUDY_RESULTS     rows to go on with; else those of the code that fits as it is now
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.study.missing_laws.laws import SIZES
from tests.study.shared import options
from tests.study.shared.options import number, words
from tests.study.shared.rows import rows
from tests.study.two_masses.runner import FIRST_SEED, LAYOUT, run
from tests.study.two_masses.tables import summary

PER_LAW, PER_RIGHT = 10, 20
ESTIMATORS = ("innovations", "simulation")
CODE = ("drivetool/logs", "drivetool/drive", "drivetool/identify", "tests/study/missing_laws", "tests/study/shared",
        "tests/study/two_masses")


def results() -> Path:
    """Where the rows of the code that fits, of this study's records and of these seeds are."""
    return options.results("study_missing_laws_two_masses", CODE)


@pytest.mark.study
def test_missing_laws_of_two_masses():
    """Every fit answers; the tables are printed."""
    wanted = LAYOUT.jobs(number("PER_LAW", PER_LAW), number("PER_RIGHT", PER_RIGHT),
                         words("ESTIMATORS", ESTIMATORS), words("SIZES", tuple(SIZES)))
    found = run(wanted, results(), number("WORKERS", 2))
    print(f"\nseeds from {FIRST_SEED}\n\n" + summary(found, words("ESTIMATORS", ESTIMATORS)[0]))
    failed = [row["key"] for row in found if "failed" in row]
    assert len(failed) <= 0.01 * len(found), failed


if __name__ == "__main__":
    print(summary(rows(results()), words("ESTIMATORS", ESTIMATORS)[0]))
