"""Start values from a gap-free record.

A third-order model, converted to inertias, stiffness and damping; or a polynomial structure of any order.
"""

from drivetool.cli.options import common as cli
from drivetool.cli.parts import estimator_command

EXAMPLE = "drivetool blackbox steps.parquet --params steady.yaml --out blackbox.yaml"


def _load():
    from drivetool.identify.blackbox import blackbox

    return blackbox


command = estimator_command("blackbox", _load, {
    "structure": (cli.Structure, None), "order": (cli.Order, None), "noise_order": (cli.NoiseOrder, None),
    "criterion": (cli.BlackboxCriterion, cli.BlackboxCriterionName.innovations),
    "weighting": (cli.Weighting, cli.WeightingName.variance), "band": (cli.Band, None)})
