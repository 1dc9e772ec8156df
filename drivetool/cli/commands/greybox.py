"""The physical parameters, polished.

Several explanations of the record are fitted, and free runs choose; several recordings go into one fit.
"""

from drivetool.cli.options import common as cli
from drivetool.cli.parts import estimator_command

EXAMPLE = "drivetool greybox steps.parquet --params blackbox.yaml --out greybox.yaml"


def _load():
    from drivetool.identify.greybox import greybox

    return greybox


command = estimator_command("greybox", _load, {
    "start": (cli.Start, None), "record": (cli.Record, None),
    "criterion": (cli.FitCriterion, cli.FitCriterionName.auto),
    "weighting": (cli.Weighting, cli.WeightingName.variance), "band": (cli.Band, None)})
