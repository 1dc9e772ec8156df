"""Uncertainty of the others by a parameter on its bound."""

from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.identify.estimate.interval_and_status import parameters_of
from drivetool.identify.problem.least_squares import Solution
from drivetool.identify.problem.problem import Normal, Point

NAMES = ("motor.viscous", "load.viscous")
SUM, EACH = 1e4, 1.0  # information on the sum of two frictions, and on each by itself


@pytest.mark.parametrize("push", [5.0, 50.0])
def test_of_a_known_sum_the_one_part_is_as_uncertain_as_the_other(push):
    """The other part may be as large as its one-sided interval says; the first is then smaller by as much."""
    matrix = SUM * np.ones((2, 2)) + EACH * np.eye(2)
    normal = Normal(matrix, (), (), np.array([0.0, push]), (), 1000.0)
    problem = SimpleNamespace(names=NAMES, low=np.zeros(2), high=np.full(2, 10.0), count=1000, unknowns=0)
    drive = two_mass().with_values({"motor.viscous": 1.0, "load.viscous": 0.0})
    solution = Solution(Point(np.array([1.0, 0.0]), ()), normal, 1, True)
    lines, _, _ = parameters_of(problem, solution, drive, drive)
    motor, load = (next(p for p in lines if p.name == name) for name in NAMES)
    assert load.status == "at-bound" and load.std is None and motor.status == "fitted"
    alone = 1.0 / np.sqrt(SUM + EACH)
    reach = (load.ci95[1] - load.ci95[0]) / 1.959964 * SUM / (SUM + EACH)
    assert motor.std == pytest.approx(np.hypot(alone, reach), rel=1e-6) and reach > 0.1 * alone
