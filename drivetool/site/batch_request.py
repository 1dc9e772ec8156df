"""The request to a batch, and the command line that it runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from drivetool.site.pool import Runner


@dataclass(frozen=True)
class CommandLine:
    """The command line as a batch uses it, which passes itself in.

    run    runs words as the console would
    parse  (command, words) -> its options by name as the command would get them, or why it rejects them
    """

    run: Runner
    parse: Callable[[str, Sequence[str]], dict[str, Any] | str]


@dataclass(frozen=True)
class BatchRequest:
    """The options of `batch`; say: prints a line for a person, write_stdout: writes text to standard output."""

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
    write_stdout: Callable[[str], None]
