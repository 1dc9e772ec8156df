"""Rows of a results file: a line of JSON per record and estimator, written as soon as it is there."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Job:
    """A record, and the estimators that it still lacks.

    seed  of the record: situations and sizes have machines of their own
    """

    situation: str
    size: str
    number: int
    seed: int
    estimators: tuple[str, ...]

    def key(self, estimator: str) -> str:
        """Of the row of an estimator."""
        return f"{self.situation}/{self.size}/{self.number}/{self.seed}/{estimator}"

    def rows(self, about: Mapping, fit: Callable[[str], dict]) -> list[dict]:
        """The rows of the record: what is said about it, and what each estimator says."""
        mine = {"law": self.situation, "size": self.size, "number": self.number, "seed": self.seed}
        return [{"key": self.key(e)} | mine | about | {"estimator": e} | fit(e) for e in self.estimators]


@dataclass(frozen=True)
class Layout:
    """The kinds of record of a study.

    laws   missing from the model, each in every one of the sizes; right: situations in which nothing is missing
    """

    laws: tuple[str, ...]
    sizes: tuple[str, ...]
    right: tuple[str, ...]
    first_seed: int

    def jobs(self, per_law: int, per_right: int, estimators: Sequence[str],
             sizes: Sequence[str] | None = None) -> list[Job]:
        """All records, one of every kind before the second of any."""
        kinds = [*((law, size) for size in self.sizes for law in self.laws), *((right, "") for right in self.right)]
        places = {kind: i for i, kind in enumerate(kinds)}

        def job(situation: str, size: str, number: int) -> Job:
            seed = self.first_seed + number * len(kinds) + places[situation, size]
            return Job(situation, size, number, seed, tuple(estimators))

        found = []
        for number in range(max(per_law, per_right)):
            if number < per_law:
                # Each law begins at another excitation, so that few records cover all.
                found += [job(law, size, number + i) for size in (self.sizes if sizes is None else sizes)
                          for i, law in enumerate(self.laws)]
            if number < per_right:
                found += [job(right, "", number + i) for i, right in enumerate(self.right)]
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


def resumed(path: Path) -> set[str]:
    """The keys that are there already, of a file that can be appended to."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and (text := path.read_text()) and not text.endswith("\n"):
        path.write_text(text + "\n")
    return {row["key"] for row in rows(path)}


def run(wanted: Iterable[Job], path: Path, one: Callable[[Job], list[dict]],
        warm_up: Callable[[tuple[str, ...]], None], workers: int = 2) -> list[dict]:
    """Run what is not there yet; all the wanted rows.

    one      the rows of a job
    warm_up  receives the estimators, so that no row counts the loading of compiled code
    """
    there, wanted = resumed(path), list(wanted)
    left = [replace(job, estimators=lacking) for job in wanted
            if (lacking := tuple(e for e in job.estimators if job.key(e) not in there))]
    names = tuple(dict.fromkeys(e for job in left for e in job.estimators))
    with path.open("a") as file:
        for found in _answers(left, names, one, warm_up, workers):
            file.writelines(json.dumps(row) + "\n" for row in found)
            file.flush()
    keys = {job.key(e) for job in wanted for e in job.estimators}
    return [row for row in rows(path) if row["key"] in keys]


def plain(value) -> dict:
    """A dataclass of numbers and arrays in numbers and lists, to nine digits."""
    def short(x):
        return [short(part) for part in x] if isinstance(x, list | tuple | np.ndarray) else float(f"{x:.9g}")

    return {name: short(x) for name, x in asdict(value).items()}


def _answers(left: Sequence[Job], names: tuple[str, ...], one, warm_up, workers: int) -> Iterable[list[dict]]:
    """Rows record by record; a single worker is this process."""
    if not left:
        return
    if workers == 1:
        warm_up(names)
        yield from map(one, left)
        return
    with ProcessPoolExecutor(workers, get_context("spawn"), warm_up, (names,)) as pool:
        yield from pool.map(one, left)
