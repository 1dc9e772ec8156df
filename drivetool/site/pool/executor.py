"""Who does the tasks of a run: what it is given, and when it is asked for more."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

Numbered = Sequence[tuple[int, dict[str, Any]]]  # tasks, each with a number to know it by
UNREAD = "unread"  # how a step ends whose recording is not there, or no longer what it was found to be
More = Callable[[], Numbered]
# Does the words of a command line in this process, as the console would, and leaves by SystemExit. Worker processes
# find it by its module and name.
Runner = Callable[[list[str]], None]


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
