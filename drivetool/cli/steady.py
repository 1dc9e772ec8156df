"""drivetool steady."""

from drivetool.cli import options as cli
from drivetool.cli.step import estimator_command

HELP = "The friction line from constant speeds, or mass and friction from constant torques."
EXAMPLE = "drivetool steady steady.parquet --out steady.yaml --plot pictures"


def _load():
    from drivetool.identify.steady import steady

    return steady


command = estimator_command("steady", _load, {"method": (cli.Method, cli.MethodName.speeds)})
