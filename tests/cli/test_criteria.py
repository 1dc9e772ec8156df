"""The names after --criterion are those that the options of an estimator take."""

from typing import get_args

from drivetool.cli.options.common import BlackboxCriterionName, CriterionName, FitCriterionName
from drivetool.identify.setup import Options
from drivetool.identify.setup.options import Criterion


def test_the_command_line_takes_every_criterion_and_no_other():
    assert {str(n) for n in FitCriterionName} == set(get_args(Criterion))
    assert {str(n) for n in CriterionName} == set(get_args(Criterion)) - {"frequency"}  # of one body and no gap
    assert {str(n) for n in BlackboxCriterionName} == set(get_args(Criterion)) - {"auto", "inverse"}
    assert Options().criterion in get_args(Criterion)
