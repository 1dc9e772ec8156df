"""The options of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from drivetool.site.plan.recipe import RecipeStep
from drivetool.site.pool import Executor


@dataclass(frozen=True)
class RunOptions:
    """The options of a run.

    folder     of the site file, absolute; out: of the results, absolute
    limits     of a task, by what ends it: time [s], memory [MB]
    numerics   library versions on which the numbers depend
    executor   None: nothing is run, only checked
    say        prints a line for a person
    explain    prints why a task is run; None: not requested
    """

    folder: Path
    out: Path
    steps: tuple[RecipeStep, ...]
    limits: Mapping[str, float]
    numerics: Mapping[str, str]
    executor: Executor | None
    say: Callable[[str], None]
    explain: Callable[[str], None] | None = None
    retry: bool = False
