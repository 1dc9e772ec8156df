"""drivetool show."""

from __future__ import annotations

from typing import Annotated

import typer

from drivetool.cli.options import common as cli
from drivetool.cli.output import DONE, guarded, print_findings, print_table

HELP = "The table of a file that another step wrote."
EXAMPLE = "drivetool show greybox.yaml"


def command(
    file: Annotated[str, typer.Argument(
        metavar="FILE", help="Of parameters (by hand, too), a validation, gains, spectra, a comparison, trends or "
        "an inspection; - is standard input.")],
    debug: cli.Debug = False,
) -> None:
    """See HELP."""
    guarded("show", lambda: run(file), debug)


def run(path: str) -> int:
    """Read, print; the exit code."""
    from drivetool.files.yaml import load_result

    content = load_result(path)
    print_table(content)
    print_findings(content, stderr=False)
    return DONE
