"""The catalogue of physical effects.

What each does, its parameters, and what a record must contain.
"""

from __future__ import annotations

from typing import Annotated

import typer

from drivetool.cli.options import common as cli
from drivetool.cli.output import show_entries

EXAMPLE = "drivetool effects backlash"

Code = Annotated[str | None, typer.Argument(metavar="[CODE]", help="One effect, in full.")]


def command(code: Code = None, json: cli.Json = False, debug: cli.Debug = False) -> int:
    """Its options; the exit code."""
    from drivetool.files.tables import catalogue, print_catalogue, print_entry

    return show_entries("effects", catalogue(code), code is None, json, print_catalogue, print_entry)
