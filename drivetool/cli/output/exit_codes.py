"""The one place where outcomes become exit codes, and errors become sentences."""

from __future__ import annotations

import errno
import logging
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import typer

from drivetool.cli.output.bar import progress_bar
from drivetool.errors import BadOption, DriveToolError, Notice
from drivetool.finding_codes import Severity

# 2 is click's for wrong usage, 130 is 128 + SIGINT as shells report it; 3 separates a missed bar from an error.
DONE, FAILED, USAGE, MISSED, INTERRUPTED = 0, 1, 2, 3, 130


def exit_code(severities: Iterable[Severity], passed: bool = True, strict: bool = False) -> int:
    """What a finished command returns.

    severities  of its findings
    passed      whether every limit that was set is met
    strict      whether warnings count as failures
    """
    bad = {"failure", "warning"} if strict else {"failure"}
    return MISSED if not passed or bad & set(severities) else DONE


def guarded(command: str, work: Callable[[], int], debug: bool = False, quiet: bool = False) -> None:
    """Run a command's work and leave with its exit code.

    command  name of the subcommand, for messages
    work     returns the exit code of a finished command
    debug    whether to show a traceback, and what libraries warn of; quiet: no progress bar
    """
    with _silent_libraries(command, debug):
        try:
            with progress_bar(quiet):
                code = work()
            sys.stdout.flush()
        except DriveToolError as error:
            code = _say_failure(command, f"error: {error}", debug)
            code = USAGE if isinstance(error, BadOption) else code
        except KeyboardInterrupt:
            say(command, "interrupted")
            code = INTERRUPTED
        except BrokenPipeError:
            # The reader of our output has gone; Python would complain once more at its end.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = FAILED
        except Exception as error:  # no traceback reaches a user, whatever went wrong
            text = " ".join(f"{type(error).__name__}: {error}".split())
            text = f"unexpected {text} (run again with --debug for the traceback)"
            if type(error).__name__ == "LinAlgError":
                text = ("error: wanted records that a drive can be fitted to; found equations without a finite "
                        f"solution ({error}). Check the records with inspect, and exclude damaged channels.")
            if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EIO):
                text = f"error: wanted to print the result; found {error.strerror}. Make room, or print elsewhere."
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = _say_failure(command, text, debug)
    raise typer.Exit(code)


@contextmanager
def _silent_libraries(command: str, debug: bool) -> Iterator[None]:
    """Warnings of libraries are shown with --debug alone: what a user should know is a finding or a notice."""
    def show(message: Warning | str, category: type[Warning], *_, **__) -> None:
        if issubclass(category, Notice):
            say(command, f"warning: {message}")

    if debug:
        yield
        return
    last, logging.lastResort = logging.lastResort, logging.NullHandler()
    try:
        with warnings.catch_warnings():
            warnings.showwarning = show
            yield
    finally:
        logging.lastResort = last


def say(command: str, text: str) -> None:
    """One line on standard error."""
    print(f"drivetool {command}: {text}", file=sys.stderr)


def write_stdout(text: str) -> None:
    """A file on standard output: the same bytes as on disk, whatever encoding a terminal would like."""
    sys.stdout.flush()
    if (buffer := getattr(sys.stdout, "buffer", None)) is None:  # a notebook's, or text kept in memory
        sys.stdout.write(text)
        return
    buffer.write(text.encode("utf-8", "backslashreplace"))  # bytes of a file name that are no text
    buffer.flush()


def _say_failure(command: str, text: str, debug: bool) -> int:
    """Print the error, with the traceback if requested."""
    if debug:
        traceback.print_exc()
    say(command, text)
    return FAILED
