"""The half gap from a record that opens it."""

from drivetool.cli.options import common as cli
from drivetool.cli.parts import estimator_command

EXAMPLE = "drivetool backlash gap.parquet --params greybox.yaml --out backlash.yaml"


def _load():
    from drivetool.identify.backlash import backlash

    return backlash


command = estimator_command("backlash", _load, {
    "start": (cli.Start, None), "record": (cli.Record, None)})
