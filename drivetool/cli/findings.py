"""drivetool findings."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from drivetool.cli import options as cli
from drivetool.cli.outcomes import DONE, guarded, put

HELP = "The finding codes. What each stands for, its severity, and what to do about it."
EXAMPLE = "drivetool findings trend-alarm"

Code = Annotated[str | None, typer.Argument(metavar="[CODE]", help="One code, in full.")]


def command(code: Code = None, json: cli.Json = False, debug: cli.Debug = False) -> None:
    """See HELP."""
    guarded("findings", lambda: run(code, json), debug)


def run(code: str | None, json: bool = False) -> int:
    """Print; the exit code."""
    from drivetool.files.finding_table import finding_entries, print_finding, print_findings_list
    from drivetool.files.text import to_json, to_yaml

    entries = finding_entries(code)
    if json or not sys.stdout.isatty():
        content = {"findings": entries} if code is None else entries[0]
        put(to_json(content) if json else to_yaml(content))
        return DONE
    from rich.console import Console

    console = Console(highlight=False)
    console.width = max(80, console.width)
    if code is None:
        print_findings_list(entries, console)
    else:
        print_finding(entries[0], console)
    return DONE
