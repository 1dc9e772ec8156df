"""Friction from constant speeds, mass too from constant torques, ratios of both from a coast-down."""

from drivetool.cli.options import common as cli
from drivetool.cli.parts import estimator_command

EXAMPLE = "drivetool steady steady.parquet --out steady.yaml --plot pictures"


def _load():
    from drivetool.identify.steady import steady

    return steady


command = estimator_command("steady", _load, {
    "method": (cli.Method, cli.MethodName.speeds), "flux_decay": (cli.FluxDecay, None),
    "stages": (cli.Stages, None), "record": (cli.Record, None)})
