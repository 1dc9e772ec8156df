"""What a batch is asked, and the command line that it runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from drivetool.site.pool import Runner


@dataclass(frozen=True)
class CommandLine:
    """The command line as a batch uses it, which hands itself in.

    run    does words as the console would
    parse  (command, words) -> its options by name as the command would get them, or why it takes no such words
    """

    run: Runner
    parse: Callable[[str, Sequence[str]], dict[str, Any] | str]


@dataclass(frozen=True)
class Asked:
    """The words of the command line; say: takes a line for a person, put: text for standard output."""

    given: Sequence[str]
    recipe: str | None
    map: str | None
    out: str | None
    workers: int | None
    scheduler: str | None
    time_limit: float
    memory_limit: float | None
    explain: bool
    verify: bool
    retry: bool
    junit: str | None
    markdown: str | None
    say: Callable[[str], None]
    put: Callable[[str], None]
