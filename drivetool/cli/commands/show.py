"""The table of a file that another step wrote. Two parameter files are put side by side."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import Annotated

import typer

from drivetool.cli.options import common as cli
from drivetool.cli.output import DONE, print_table, show_findings, table_console
from drivetool.errors import BadOption

EXAMPLE = "drivetool show greybox.yaml backlash.yaml"


def command(
    file: Annotated[str, typer.Argument(
        metavar="FILE", help="Of parameters (by hand, too), a validation, gains, spectra, a comparison, trends or "
        "an inspection; - is standard input.")],
    other: Annotated[str | None, typer.Argument(
        metavar="[FILE2]", help="A second parameter file. Each row has both values and their difference.")] = None,
    every: Annotated[bool, typer.Option(
        "--all", help="Also values that no recording identifies.")] = False,
    debug: cli.Debug = False,
) -> int:
    """Its options; the exit code."""
    from drivetool.files.shapes import ParameterFile
    from drivetool.files.tables import print_both, without_unidentified
    from drivetool.files.yaml import load_result

    paths = [file] if other is None else [file, other]
    files = [without_unidentified(content) if isinstance(content, ParameterFile) and not every else content
             for content in map(load_result, paths)]
    if other is None:
        print_table(files[0])
        show_findings(files[0].findings, stderr=False)
        return DONE
    for path, content in zip(paths, files, strict=True):
        if not hasattr(content, "parameters"):
            raise BadOption("two parameter files, to show side by side", f"{content.schema} in {path}",
                            "Show such a file by itself.")
    # Standard input was read already; what came from it is known by its recordings and inputs alone.
    hashes = ["" if path == "-" else sha256(Path(path).read_bytes()).hexdigest() for path in paths]
    print_both(files, paths, hashes, table_console())
    return DONE
