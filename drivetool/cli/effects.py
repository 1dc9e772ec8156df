"""drivetool effects."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from drivetool.cli import options as cli
from drivetool.cli.outcomes import DONE, guarded, put

HELP = "The catalogue of physical effects. What each does, its parameters, and what a record must contain."
EXAMPLE = "drivetool effects backlash"

Code = Annotated[str | None, typer.Argument(metavar="[CODE]", help="One effect, in full.")]


def command(code: Code = None, json: cli.Json = False, debug: cli.Debug = False) -> None:
    """See HELP."""
    guarded("effects", lambda: run(code, json), debug)


def run(code: str | None, json: bool = False) -> int:
    """Print; the exit code."""
    from drivetool.files.catalogue import catalogue, print_catalogue, print_entry
    from drivetool.files.text import to_json, to_yaml

    entries = catalogue(code)
    if json or not sys.stdout.isatty():
        content = {"effects": entries} if code is None else entries[0]
        put(to_json(content) if json else to_yaml(content))
        return DONE
    from rich.console import Console

    console = Console(highlight=False)
    console.width = max(80, console.width)
    if code is None:
        print_catalogue(entries, console)
    else:
        print_entry(entries[0], console)
    return DONE
