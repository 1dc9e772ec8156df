"""drivetool steady."""

from drivetool.cli.step import estimator_command

HELP = "The friction line from constant speeds."
EXAMPLE = "drivetool steady steady.parquet --out steady.yaml --plot pictures"


def _load():
    from drivetool.identify.steady import steady

    return steady


command = estimator_command("steady", _load)
