"""What a run goes by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from drivetool.site.plan.recipe import Step
from drivetool.site.pool import Executor


@dataclass(frozen=True)
class Setting:
    """What a run goes by.

    folder     of the site file, absolute; out: of the results, absolute
    limits     of a task by how it ends: time [s], memory [MB]
    numerics   versions that the numbers depend on
    executor   None: nothing is run, only checked
    say        takes a line for a person
    explain    takes a line on why something is run; None: nobody asks
    """

    folder: Path
    out: Path
    steps: tuple[Step, ...]
    limits: Mapping[str, float]
    numerics: Mapping[str, str]
    executor: Executor | None
    say: Callable[[str], None]
    explain: Callable[[str], None] | None = None
    retry: bool = False
