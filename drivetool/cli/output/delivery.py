"""The result to the requested outputs: file, standard output, table, pictures, messages."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from drivetool.cli.output.exit_codes import DONE, exit_code, say, write_stdout
from drivetool.errors import DriveToolError
from drivetool.files.disk import write_whole

if TYPE_CHECKING:
    from rich.console import Console

    from drivetool.cli.options import Job
    from drivetool.files.shapes import (
        FindingSection,
        GainsFile,
        InspectionFile,
        ParameterFile,
        TrendsFile,
        ValidationFile,
    )
    from drivetool.identify.estimate import PlotData
    from drivetool.logs import Experiment

    Written = ParameterFile | ValidationFile | GainsFile | InspectionFile | TrendsFile

# Columns of a table in a pipe or a file, which have no width of their own: twice a terminal, so no number is cut.
PIPE_TABLE_WIDTH = 160


def deliver(job: Job, file: Written, plots: Sequence[PlotData], per_unit: bool = False,
            names: Sequence[str] = ()) -> int:
    """Write, print and draw; the exit code.

    file      what the step writes
    plots     plot data of the pictures
    per_unit  whether the table of gains is per unit
    names     names of the plots; none: of the recordings
    """
    from drivetool.files.results import dump

    terminal = sys.stdout.isatty()
    if job.out not in (None, "-"):
        write_whole(job.out, dump(file))
    if job.json:
        write_stdout(dump(file, "json"))
    elif job.out == "-" or (job.out is None and not terminal):
        write_stdout(dump(file))
    elif terminal:
        print_table(file, per_unit)
    sys.stdout.flush()
    holdout = getattr(file, "options", {}).get("holdout", ())
    names = names or [entry.file for entry in getattr(file, "data", ())] + [entry["file"] for entry in holdout]
    pictures = draw(job, plots, names)
    passed = getattr(file, "passed", True)
    if not job.quiet:
        _say_outcome(job, file, pictures)
    return exit_code((finding.severity for finding in file.findings), passed, job.strict)


def table_console() -> Console:
    """Standard output, at least as wide as tables are laid out for; a pipe or a file has no width to keep to."""
    from rich.console import Console

    console = Console(highlight=False)
    unlimited = not console.is_terminal and "COLUMNS" not in os.environ
    console.width = PIPE_TABLE_WIDTH if unlimited else max(80, console.width)
    return console


def print_table(file: Written, per_unit: bool = False) -> None:
    """The table of a file on standard output."""
    from drivetool.files.tables import print_file

    print_file(file, table_console(), per_unit)


def show_findings(findings: Sequence[FindingSection], stderr: bool = True) -> None:
    """The findings of a file, worst first."""
    from rich.console import Console

    from drivetool.files.tables import print_findings

    print_findings(findings, Console(stderr=stderr, highlight=False))


def draw(job: Job, plots: Sequence[PlotData], records: Sequence[str]) -> list[str]:
    """Pictures into --plot DIR; their names."""
    if not job.plot:
        return []
    from drivetool.files.figures import draw_all

    return draw_all(plots, job.plot, job.step, records)


@contextmanager
def recordings_drawn_on_failure(job: Job, experiments: Sequence[Experiment]) -> Iterator[None]:
    """The recordings, for the person who looks for the reason of a failed fit."""
    try:
        yield
    except DriveToolError:
        if job.plot:
            from drivetool.files.figures import recording_plot

            draw(job, [recording_plot(each) for each in experiments], [each.name for each in experiments])
        raise


def _say_outcome(job: Job, file: Written, pictures: Sequence[str]) -> None:
    """Findings, the outcome and the written files."""
    show_findings(file.findings)
    outcome = getattr(file, "outcome", "") or getattr(file, "verdict", "")
    if outcome:
        say(job.step, outcome)
    if job.out not in (None, "-"):
        say(job.step, f"wrote {job.out}")
    if pictures:
        say(job.step, f"drew {', '.join(pictures)} in {job.plot}")


def show_entries(title: str, entries: Sequence[Mapping[str, Any]], every: bool, json: bool,
                 print_all: Callable, print_one: Callable) -> int:
    """Print entries of a catalogue: on a terminal as tables, else as YAML or JSON; the exit code.

    title  key of the list; every: whether all are requested, else the first one is printed
    """
    from drivetool.files.yaml import to_json, to_yaml

    if json or not sys.stdout.isatty():
        content = {title: entries} if every else entries[0]
        write_stdout(to_json(content) if json else to_yaml(content))
    elif every:
        print_all(entries, table_console())
    else:
        print_one(entries[0], table_console())
    return DONE
