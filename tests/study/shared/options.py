"""Options of a study from the environment: DRIVETOOL_STUDY_..., see each study."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

from tests.places import ROOT

# What turns rows into tables: it makes no row, so that a change of it leaves them as they are.
ONLY_READ_ROWS = ("scores.py", "tables.py", "figures.py")


def results(study: str, folders: Iterable[str]) -> Path:
    """Where the rows of the code in these folders are; DRIVETOOL_STUDY_RESULTS names another file."""
    if "DRIVETOOL_STUDY_RESULTS" in os.environ:
        return Path(os.environ["DRIVETOOL_STUDY_RESULTS"])
    code = hashlib.sha256()
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            if path.name not in ONLY_READ_ROWS or path.is_relative_to(ROOT / "drivetool"):
                code.update(path.read_bytes())
    return ROOT / "build" / f"{study}-{code.hexdigest()[:10]}.jsonl"


def words(name: str, default: tuple[str, ...]) -> tuple[str, ...]:
    """A list of an environment variable, separated by commas."""
    text = os.environ.get(f"DRIVETOOL_STUDY_{name}")
    return tuple(text.split(",")) if text else default


def number(name: str, default: int) -> int:
    """A number of an environment variable."""
    return int(os.environ.get(f"DRIVETOOL_STUDY_{name}", str(default)))
