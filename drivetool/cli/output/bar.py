"""The progress bar on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING

from drivetool.progress import FIRST_USE, progress_to

if TYPE_CHECKING:
    from rich.progress import Progress

class Bar:
    """One stage at a time; it goes away when the stage is over, before anything else is printed."""

    stage, progress, task = "", None, None

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show a stage; see `drivetool.progress`."""
        if stage != self.stage or self.progress is None:
            self.close()
            if done >= total:
                return
            self.stage, self.progress = stage, _progress()
            self.task = self.progress.add_task(stage, total=total)
            self.progress.start()
        self.progress.update(self.task, completed=done)
        if done >= total:
            seconds = self.progress.tasks[0].elapsed
            self.close()
            if stage.startswith(FIRST_USE):
                _print_duration(seconds)

    def close(self) -> None:
        """Take the bar away."""
        if self.progress is not None:
            self.progress.stop()
        self.stage, self.progress, self.task = "", None, None


def _progress() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    return Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
                    console=Console(stderr=True), transient=True)


class FirstUse:
    """A few lines about the compilation of the kernel, where a file or pipe takes standard error."""

    began = None

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Print the lines: at the beginning, at each quarter, and at the end; see `drivetool.progress`."""
        if not stage.startswith(FIRST_USE):
            return
        if self.began is None:
            self.began = time.monotonic()
            print(f"drivetool: {stage}.", file=sys.stderr, flush=True)
        if done >= total:
            _print_duration(time.monotonic() - self.began)
            self.began = None
        elif done and 4 * done // total > 4 * (done - 1) // total:
            print(f"drivetool: {done} of {total} parts are ready.", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Nothing is left to take away."""


def _print_duration(seconds: float) -> None:
    print(f"drivetool: compiled in {seconds:.0f} s.", file=sys.stderr, flush=True)


@contextmanager
def progress_bar(quiet: bool = False) -> Iterator[None]:
    """A bar while something long runs, where a person watches standard error; else lines at the first use."""
    if quiet:
        yield
        return
    with closing(Bar() if sys.stderr.isatty() else FirstUse()) as bar, progress_to(bar):
        yield
