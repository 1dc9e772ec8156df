"""Every command under its name, and the whole command line as others in this process may use it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from drivetool import __version__
from drivetool.cli.commands import (
    backlash,
    batch,
    blackbox,
    compare,
    convert,
    diagnose,
    effects,
    findings,
    greybox,
    init,
    inspect,
    show,
    simulate,
    spectra,
    steady,
    trend,
    tune,
    validate,
)
from drivetool.cli.options import join_record_words
from drivetool.cli.output import guarded
from drivetool.site import CommandLine

# In the order in which they are used.
COMMANDS = {"inspect": inspect, "convert": convert, "steady": steady, "spectra": spectra, "blackbox": blackbox,
            "greybox": greybox, "backlash": backlash, "validate": validate, "compare": compare,
            "diagnose": diagnose, "simulate": simulate, "tune": tune, "init": init, "batch": batch,
            "trend": trend, "effects": effects, "findings": findings, "show": show}


class Command(TyperCommand):
    """Returns its exit code, and may have an option of two words that is repeated, neither of which typer knows.

    --debug and --quiet are options of the boundary alone; commands that never talk have no --quiet.
    """

    def parse_args(self, ctx, args: list[str]) -> list[str]:
        """The words behind the option are joined first."""
        return super().parse_args(ctx, join_record_words(args))

    def invoke(self, ctx) -> None:
        """Errors become sentences, and outcomes exit codes."""
        work = super().invoke
        guarded(ctx.info_name, lambda: work(ctx), ctx.params["debug"], ctx.params.get("quiet", False))


def run_words(words: list[str]) -> None:
    """Do a command line as the console would, and leave by SystemExit; worker processes find it by its name."""
    app(words, prog_name="drivetool")


def parsed(command: str, words: Sequence[str]) -> dict[str, Any] | str:
    """The options of a command line as the command would get them, or why it takes no such words."""
    parser: Any = typer.main.get_command(app)
    try:
        return dict(parser.commands[command].make_context(command, list(words), help_option_names=[]).params)
    except Exception as error:  # of click, or of the click inside newer versions of typer
        if not hasattr(error, "format_message"):
            raise
        return error.format_message()


app = typer.Typer(
    name="drivetool", no_args_is_help=True, rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "obj": CommandLine(run_words, parsed)})
for _name, _module in COMMANDS.items():
    # After \b lines stay as they are, so that the example can be copied.
    app.command(_name, cls=Command, help=" ".join((_module.__doc__ or "").split()),
                epilog=f"\b\nExample:\n  {_module.EXAMPLE}")(_module.command)


def _version(requested: bool) -> None:
    """Print the version and leave."""
    if requested:
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
