"""The result to where it was asked for: file, standard output, table, pictures, talk."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from drivetool.cli.output.exit_codes import exit_code, put, say
from drivetool.files.disk import write_whole

if TYPE_CHECKING:
    from rich.console import Console

    from drivetool.cli.options import Job
    from drivetool.files.shapes import GainsFile, InspectionFile, ParameterFile, TrendsFile, ValidationFile
    from drivetool.identify.estimate import Exhibit
    from drivetool.logs import Experiment

    Written = ParameterFile | ValidationFile | GainsFile | InspectionFile | TrendsFile

WIDE = 160  # columns of a table that nobody sees on a terminal


def deliver(job: Job, file: Written, exhibits: Sequence[Exhibit], per_unit: bool = False,
            names: Sequence[str] = ()) -> int:
    """Write, print and draw; the exit code.

    file      what the step writes
    exhibits  what the pictures show
    per_unit  whether the table of gains is per unit
    names     of what the pictures show; none: of the recordings
    """
    from drivetool.files.results import dump

    terminal = sys.stdout.isatty()
    if job.out not in (None, "-"):
        write_whole(job.out, dump(file))
    if job.json:
        put(dump(file, "json"))
    elif job.out == "-" or (job.out is None and not terminal):
        put(dump(file))
    elif terminal:
        print_table(file, per_unit)
    sys.stdout.flush()
    judged = getattr(file, "options", {}).get("holdout", ())
    names = names or [entry.file for entry in getattr(file, "data", ())] + [entry["file"] for entry in judged]
    pictures = draw(job, exhibits, names)
    passed = getattr(file, "passed", True)
    if not job.quiet:
        _talk(job, file, pictures)
    return exit_code((finding.severity for finding in file.findings), passed, job.strict)


def print_table(file: Written, per_unit: bool = False) -> None:
    """The table of a file on standard output."""
    from rich.console import Console

    from drivetool.files.tables import result_tables as tables

    console = Console(highlight=False)
    # Narrower, and numbers would be cut; a pipe or a file has no width to keep to.
    free = not console.is_terminal and "COLUMNS" not in os.environ
    console.width = WIDE if free else max(80, console.width)
    if hasattr(file, "channels"):
        from drivetool.files.tables import print_inspection

        print_inspection(file, console)
    elif hasattr(file, "designs"):
        from drivetool.files.tables import print_gains

        print_gains(file, console, per_unit)
    elif hasattr(file, "verdict"):
        tables.print_validation(file, console)
    elif file.step == "trend":
        from drivetool.files.tables import print_trends

        print_trends(file, console)
    elif file.step in ("spectra", "compare"):
        from drivetool.files.tables import analysis_tables

        analysis_tables.print_analysis(file, console)
    else:
        _print_parameters(file, console)


def _print_parameters(file: Written, console: Console) -> None:
    """An estimate, and the diagnosis that came to it."""
    from drivetool.files.tables import result_tables as tables

    if file.diagnosis is not None:
        from drivetool.files.tables import print_diagnosis

        print_diagnosis(file.diagnosis, console)
    tables.print_estimate(file, console)


def print_findings(file: Written, stderr: bool = True) -> None:
    """The findings of a file, worst first."""
    from rich.console import Console

    from drivetool.files.tables import result_tables as tables

    tables.print_findings(file.findings, Console(stderr=stderr, highlight=False))


def draw(job: Job, exhibits: Sequence[Exhibit], records: Sequence[str]) -> list[str]:
    """Pictures into --plot DIR; their names."""
    if not job.plot:
        return []
    from drivetool.files.figures import draw_all

    return draw_all(exhibits, job.plot, job.step, records)


def draw_recordings(job: Job, experiments: Sequence[Experiment]) -> None:
    """What was recorded, for the person who wonders why the fit failed."""
    if job.plot:
        from drivetool.files.figures import exhibit_of

        draw(job, [exhibit_of(each) for each in experiments], [each.name for each in experiments])


def _talk(job: Job, file: Written, pictures: Sequence[str]) -> None:
    """Findings, how it ended and what was written."""
    print_findings(file)
    outcome = getattr(file, "outcome", "") or getattr(file, "verdict", "")
    if outcome:
        say(job.step, outcome)
    if job.out not in (None, "-"):
        say(job.step, f"wrote {job.out}")
    if pictures:
        say(job.step, f"drew {', '.join(pictures)} in {job.plot}")


def show_entries(title: str, entries: Sequence[Mapping[str, Any]], every: bool, json: bool,
                 print_all: Callable, print_one: Callable) -> None:
    """Print entries of a catalogue: on a terminal as tables, else as YAML or JSON.

    title  key of the list; every: whether all were asked for, else the first one is printed
    """
    from drivetool.files.yaml import to_json, to_yaml

    if json or not sys.stdout.isatty():
        content = {title: entries} if every else entries[0]
        put(to_json(content) if json else to_yaml(content))
        return
    from rich.console import Console

    console = Console(highlight=False)
    console.width = max(80, console.width)
    if every:
        print_all(entries, console)
    else:
        print_one(entries[0], console)
