"""The records of the study, and their rows.

    {"key": "situation/size/number/seed/estimator", "law", "size", "number", "seed", "estimator", "excitation",
     "closed", "sensors", "gap", "truth": {...}, and what estimators.py says}
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tests.study.missing_laws.laws import SIZES
from tests.study.shared import rows
from tests.study.shared.options import number
from tests.study.shared.rows import Job, Layout, plain
from tests.study.two_masses.estimators import fit, warm_up
from tests.study.two_masses.laws import LAWS
from tests.study.two_masses.record import BEHIND_GAP, RIGHT, draw

# Seeds that no other test uses; DRIVETOOL_STUDY_SHIFT draws others.
FIRST_SEED = 160_000 + number("SHIFT", 0)
LAYOUT = Layout((*LAWS, *BEHIND_GAP), tuple(SIZES), RIGHT, FIRST_SEED)


def run(wanted: Iterable[Job], path: Path, workers: int = 2) -> list[dict]:
    """Run what is not there yet; all the wanted rows."""
    return rows.run(wanted, path, run_job, warm_up, workers)


def run_job(job: Job) -> list[dict]:
    """The rows of one record."""
    record = draw(job.situation, job.size, job.number, job.seed)
    sensors = " + ".join(role for role in record.channels if role != "motor_torque")
    about = {"excitation": record.excitation, "closed": record.closed, "sensors": sensors, "gap": record.gap,
             "truth": plain(record.truth)}
    return job.rows(about, lambda estimator: fit(record, job.seed, estimator))
