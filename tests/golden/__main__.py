"""`python -m tests.golden [BASE [PATTERN...]]`: all cases, or those whose names match; and now and then

    run COMMIT [PATTERN...]     run the cases that match, with one side only
    again COMMIT [PATTERN...]   run them once more and compare both results
    list [PATTERN...]           the cases, their commands, and the options that none covers
"""

from __future__ import annotations

import sys

from tests.golden import environment, places

TASKS = ("run", "again", "list")


def main(arguments: list[str]) -> int:
    """The exit code: 1 for a difference."""
    if arguments[:1] and arguments[0] in TASKS:
        task, *rest = arguments
    else:
        # Refused at once, before anything is installed.
        task, rest = "compare", [places.commit_of(arguments[0]) if arguments else places.base(), *arguments[1:]]
        places.head_of_clean_tree()
    environment.enter([task, *rest] if task in TASKS else rest)
    # What follows needs the libraries of the environment.
    from tests.golden import tasks

    environment.check_versions(environment.pinned(), environment.installed())
    return tasks.main(task, rest)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
