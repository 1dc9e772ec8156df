"""The study of names on one-body machines: LuGre, cranks, saturation, loose and elastic couplings among the laws.

    DRIVETOOL_STUDY_PER_LAW=2 python -m pytest -m study -s tests/study/study_names_one_body.py
    python -m tests.study.study_names_one_body       # the tables of what has been run so far

Machines and laws are those of tests/study/missing_laws. Everything else is as in study_names.py.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.study.missing_laws import kernel
from tests.study.missing_laws.estimators import start_values
from tests.study.missing_laws.laws import LAWS, SIZES as SHARES, Law
from tests.study.missing_laws.record import RIGHT, Setup, arrange, draw, moving, prepare, simulate
from tests.study.shared import options, rows
from tests.study.shared.command import write
from tests.study.shared.options import number, words
from tests.study.shared.rows import Job, Layout
from tests.study.study_names import (
    OTHER,
    PER_LAW,
    PER_RIGHT,
    SIZES,
    answered,
    grade_of_law,
    idle,
    start_file,
    table,
)

# The names of the catalogue that are accepted for a law, and no others, stated before the first record was run.
# LuGre friction slides on a Stribeck curve. What a gap or a shaft hides behind it is no law of one body.
ACCEPTED_NAMES: Mapping[str, set[str]] = {
    "asymmetry": {"asymmetric-friction", "coulomb-motor"}, "stribeck": {"stribeck-motor"},
    "lugre": {"stribeck-motor", "coulomb-motor"}, "cogging": {"torque-ripple", "imbalance"},
    "gravity": {"torque-ripple", "imbalance"}, "crank": set(), "backlash": set(), "elastic-shaft": set(),
    "log-noise": set(), "eccentricity": set(), "saturation": set(), "warm-up": {"friction-drift"},
    "load-steps": {"load-step"}}
FIRST_SEED = 890_000 + number("SHIFT", 0)
LAYOUT = Layout(LAWS, SIZES, RIGHT, FIRST_SEED)
CODE = ("drivetool/logs", "drivetool/drive", "drivetool/identify", "drivetool/check", "tests/study/missing_laws")


def fresh_record(setup: Setup, law: Law, situation: str, count: int, seed: int) -> Setup:
    """Another run of the same machine and law: excitation, start state and noise differ, but not what is logged."""
    rng = np.random.default_rng([seed, 433494437])
    seconds = (len(setup.noise) + 0.5) * setup.step
    fresh = next(f for _ in range(1000) if (f := prepare(
        situation, law, setup.machine, count, seconds, rng)).step == setup.step)  # of one logger
    fresh = replace(setup, excitation=fresh.excitation, start=fresh.start,
                    disturbance=rng.permutation(setup.disturbance), noise=rng.permutation(setup.noise),
                    log_noise=rng.permutation(setup.log_noise))
    return moving(fresh, lambda trial: simulate(trial, law).states[:, kernel.V])


def channels_of(setup: Setup, law: Law) -> dict[str, np.ndarray]:
    """What a logger writes of a run."""
    run = simulate(setup, law)
    return {"motor_torque": run.torque, "motor_angle" if setup.is_angle else "motor_speed": run.measured}


def run_job(job: Job) -> list[dict]:
    """The row of one record."""
    record = draw(job.situation, job.size, job.number, job.seed)
    setup, law, share = arrange(job.situation, SHARES.get(job.size, 0.0), job.number, job.seed)
    judged = job.number % 2 == 1
    runs = {"record": setup} | {name: fresh_record(setup, law, job.situation, job.number + kind, job.seed + k)
                                for name, kind, k in (("held", OTHER, 3), ("fresh", OTHER * judged, 5))}
    with tempfile.TemporaryDirectory() as room:
        folder = Path(room)
        for name, each in runs.items():
            write(each.step, channels_of(each, law), folder / f"{name}.parquet")
        found = answered(folder, start_file(start_values(record, job.seed), folder, "one-body"), [], judged)
    grade = grade_of_law(job.situation, found.pop("answer"), ACCEPTED_NAMES, RIGHT)
    about = {"excitation": record.excitation, "sensors": [record.role], "judged": judged, "share": share,
             "grade": grade, **found}
    return job.rows(about, lambda _: {})


def results() -> Path:
    """Where the rows of the tool as it is now are."""
    return options.results("study_names_one_body", CODE)


@pytest.mark.study
def test_names_on_one_body_machines():
    """Every record is answered; the table is printed."""
    wanted = LAYOUT.jobs(number("PER_LAW", PER_LAW), number("PER_RIGHT", PER_RIGHT), ("diagnose",),
                         words("SIZES", SIZES))
    found = rows.run(wanted, results(), run_job, idle, number("WORKERS", 2))
    print(f"\nseeds from {FIRST_SEED}\n\n" + table(found, RIGHT))
    failed = [row["key"] for row in found if row["grade"] == "failed"]
    assert len(failed) <= 0.01 * len(found), failed


if __name__ == "__main__":
    print(table(rows.rows(results()), RIGHT))
