"""Rows of a results file: a line per record and estimator, written as soon as it is there.

    {"key": "law/size/number/estimator", "law", "size", "number", "seed", "estimator", "excitation", "closed",
     "role", "truth": {...}, and what estimators.py says}
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from tests.study.missing_laws.estimators import fit, warm_up
from tests.study.missing_laws.laws import LAWS, SIZES
from tests.study.missing_laws.record import RIGHT, Record, draw

# Seeds that no other test uses; DRIVETOOL_STUDY_SHIFT draws others.
FIRST_SEED = 120_000 + int(os.environ.get("DRIVETOOL_STUDY_SHIFT", "0"))


@dataclass(frozen=True)
class Job:
    """A record, and the estimators that it still lacks."""

    situation: str
    size: str
    number: int
    estimators: tuple[str, ...]

    @property
    def seed(self) -> int:
        """Of the record: situations and sizes have machines of their own."""
        kinds = [*((law, size) for size in SIZES for law in LAWS), *((right, "") for right in RIGHT)]
        return FIRST_SEED + self.number * len(kinds) + kinds.index((self.situation, self.size))

    def key(self, estimator: str) -> str:
        """Of the row of an estimator."""
        return f"{self.situation}/{self.size}/{self.number}/{self.seed}/{estimator}"


def jobs(per_law: int, per_right: int, estimators: Sequence[str], sizes: Sequence[str] = tuple(SIZES)) -> list[Job]:
    """All records, one of every kind before the second of any."""
    found = []
    for number in range(max(per_law, per_right)):
        if number < per_law:
            # Each law begins at another excitation, so that few records cover all.
            found += [Job(law, size, number + i, tuple(estimators)) for size in sizes for i, law in enumerate(LAWS)]
        if number < per_right:
            found += [Job(right, "", number + i, tuple(estimators)) for i, right in enumerate(RIGHT)]
    return found


def rows(path: Path) -> list[dict]:
    """What has been run; a line that was cut off in the middle is run again."""
    found = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        found[row["key"]] = row
    return list(found.values())


def run(wanted: Iterable[Job], path: Path, workers: int = 2) -> list[dict]:
    """Run what is not there yet; all the wanted rows."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and (text := path.read_text()) and not text.endswith("\n"):
        path.write_text(text + "\n")
    there = {row["key"] for row in rows(path)}
    wanted = list(wanted)
    left = [Job(job.situation, job.size, job.number, lacking) for job in wanted
            if (lacking := tuple(e for e in job.estimators if job.key(e) not in there))]
    names = tuple(dict.fromkeys(e for job in left for e in job.estimators))
    with path.open("a") as file:
        for found in _answers(left, names, workers):
            file.writelines(json.dumps(row) + "\n" for row in found)
            file.flush()
    keys = {job.key(e) for job in wanted for e in job.estimators}
    return [row for row in rows(path) if row["key"] in keys]


def one(job: Job) -> list[dict]:
    """The rows of one record."""
    record = draw(job.situation, job.size, job.number, job.seed)
    about = {"law": job.situation, "size": job.size, "number": job.number, "seed": job.seed,
             "excitation": record.excitation, "closed": record.closed, "role": record.role,
             "samples": len(record.torque), "truth": plain(record)}
    return [{"key": job.key(e)} | about | {"estimator": e} | fit(record, job.seed, e) for e in job.estimators]


def plain(record: Record) -> dict:
    """The truth in numbers and lists, to nine digits."""
    def short(value):
        return [short(x) for x in value] if isinstance(value, list | tuple | np.ndarray) else float(f"{value:.9g}")

    return {name: short(value) for name, value in asdict(record.truth).items()}


def _answers(left: Sequence[Job], names: tuple[str, ...], workers: int) -> Iterable[list[dict]]:
    """Rows record by record; a single worker is this process."""
    if not left:
        return
    if workers == 1:
        warm_up(names)
        yield from map(one, left)
        return
    with ProcessPoolExecutor(workers, get_context("spawn"), warm_up, (names,)) as pool:
        yield from pool.map(one, left)
