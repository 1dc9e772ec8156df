"""The finding codes.

What each stands for, its severity, and what to do about it.
"""

from __future__ import annotations

from typing import Annotated

import typer

from drivetool.cli.options import common as cli
from drivetool.cli.output import show_entries

EXAMPLE = "drivetool findings trend-alarm"

Code = Annotated[str | None, typer.Argument(metavar="[CODE]", help="One code, in full.")]


def command(code: Code = None, json: cli.Json = False, debug: cli.Debug = False) -> int:
    """Its options; the exit code."""
    from drivetool.files.tables import finding_entries, print_finding, print_findings_list

    return show_entries("findings", finding_entries(code), code is None, json, print_findings_list, print_finding)
