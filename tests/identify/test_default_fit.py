"""The default fit of one body as an estimate: what else is in its intervals."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.identify.estimate.estimate import Covariance
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from tests.identify.test_law_selection import drawn

HELD_NAME = "motor.viscous"


def lines(task, known, criterion):
    found = greybox(task.experiments, task.drive, Options(hold=(HELD_NAME,), criterion=criterion, known=known))
    return {p.name: p for p in found.parameters}, found


@pytest.mark.slow
@pytest.mark.parametrize("situation, size", [("white", ""), ("cogging", "L")])
def test_the_uncertainty_of_a_held_value_is_in_the_interval(situation, size):
    task = drawn(situation, size, 2, 52)
    known = Covariance((HELD_NAME,), np.array([[(0.3 * task.drive.values[HELD_NAME]) ** 2]]))
    (plain, _), (more, estimate) = (lines(task, k, "auto") for k in (None, known))
    (was, _), (now, _) = (lines(task, k, "innovations") for k in (None, known))
    assert bool(estimate.laws) == bool(size)
    for name in ("motor.coulomb", "motor.idle_torque"):
        added = more[name].std ** 2 - plain[name].std ** 2
        expected = now[name].std ** 2 - was[name].std ** 2
        assert expected > was[name].std ** 2 or size
        # Beside a law the same uncertainty enters through another fit.
        assert added == pytest.approx(expected, rel=0.6 if size else 0.05)
        assert more[name].std == pytest.approx(np.hypot(more[name].std_noise, more[name].std_structure))
        j = estimate.covariance.names.index(name)
        assert more[name].std == pytest.approx(np.sqrt(estimate.covariance.matrix[j, j]))


def test_a_measured_torque_alone_is_no_lack_of_the_model():
    # Then there is no innovations fit, and so its likelihood does not count either.
    task = drawn("quiet", "", 2, 52)
    measured = [replace(e, torque_is="measurement") for e in task.experiments]
    found = greybox(measured, task.drive, Options())
    assert "measurement" in found.explanation and not found.laws
    assert "model-error" not in {f.code for f in found.findings}
