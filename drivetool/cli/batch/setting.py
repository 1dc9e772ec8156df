"""What a run goes by, and who does its tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from drivetool.cli.batch.recipe import Step

Numbered = Sequence[tuple[int, dict[str, Any]]]  # tasks, each with a number to know it by
UNREAD = "unread"  # how a step ends whose recording is not there, or no longer what it was found to be
More = Callable[[], Numbered]


class Executor(Protocol):
    """Whoever does tasks: the pool of this machine, or a cluster."""

    def serve(self, more: More) -> Iterator[tuple[int, dict[str, Any]]]:
        """Do tasks until there are no more; (number, what came of it) of each as it ends.

        more  asked at the beginning and after each end: the tasks that can be done by then and were not yet given
        """


def once(tasks: Sequence[dict[str, Any]]) -> More:
    """Tasks that can all be done from the beginning, numbered from zero."""
    left = list(enumerate(tasks))

    def more() -> Numbered:
        given = left.copy()
        left.clear()
        return given

    return more


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
