"""The interface that runs the tasks of a site, and the source of these tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

NumberedTasks = Sequence[tuple[int, dict[str, Any]]]  # tasks, each with its number
UNREAD = "unread"  # how a step ends whose recording is missing or has changed since the start of the run
NextTasks = Callable[[], NumberedTasks]
# Runs the words of a command line in this process, as the console would, and ends with SystemExit. Worker
# processes import it by its module and name.
Runner = Callable[[list[str]], None]


class Executor(Protocol):
    """Runs tasks: the pool of this machine, or a cluster."""

    def serve(self, next_tasks: NextTasks) -> Iterator[tuple[int, dict[str, Any]]]:
        """Run tasks until there are no more; (number, answer) of each as it ends.

        next_tasks  called at the start and after each end: the tasks that can run then, each handed out once
        """


def all_at_once(tasks: Sequence[dict[str, Any]]) -> NextTasks:
    """Tasks that can all run from the start, numbered from zero."""
    remaining = list(enumerate(tasks))

    def next_tasks() -> NumberedTasks:
        handed_out = remaining.copy()
        remaining.clear()
        return handed_out

    return next_tasks
