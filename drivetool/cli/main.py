"""The console entry: `drivetool STEP LOG...`."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from drivetool import __version__
from drivetool.cli import (
    backlash,
    blackbox,
    compare,
    convert,
    diagnose,
    effects,
    findings,
    greybox,
    init,
    inspect,
    record_option,
    show,
    simulate,
    spectra,
    steady,
    trend,
    tune,
    validate,
)
from drivetool.cli.batch import command as batch

# In the order in which they are used.
COMMANDS = {"inspect": inspect, "convert": convert, "steady": steady, "spectra": spectra, "blackbox": blackbox,
            "greybox": greybox, "backlash": backlash, "validate": validate, "compare": compare,
            "diagnose": diagnose, "simulate": simulate, "tune": tune, "init": init, "batch": batch,
            "trend": trend, "effects": effects, "findings": findings, "show": show}

app = typer.Typer(
    name="drivetool", no_args_is_help=True, rich_markup_mode=None,
    pretty_exceptions_enable=False, context_settings={"help_option_names": ["-h", "--help"]})
for _name, _module in COMMANDS.items():
    # After \b lines stay as they are, so that the example can be copied.
    app.command(_name, cls=record_option.Command, help=_module.HELP,
                epilog=f"\b\nExample:\n  {_module.EXAMPLE}")(_module.command)


def _version(asked: bool) -> None:
    """Print the version and leave."""
    if asked:
        print(f"drivetool {__version__}")
        raise typer.Exit


@app.callback()
def _drivetool(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                          help="Print the version.")] = False,
) -> None:
    """From recordings of electric drives to parameters with honest uncertainties.

    A chain of steps, each reading the file of the one before:
    steady, blackbox, greybox, backlash, validate, diagnose, tune.

    Exit codes: 0 done; 1 failed; 2 usage; 3 done, but with a failure finding or a missed bar.
    """


def run() -> None:
    """Entry point of the console script."""
    # The matrices here are small; BLAS threads only fight each other, and make sums unrepeatable.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")  # a channel's name may not fit the terminal's encoding
    app(prog_name="drivetool")


if __name__ == "__main__":
    run()
