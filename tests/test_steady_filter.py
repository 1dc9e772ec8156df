"""The steady filter of the scans answers to a torque step as the Kalman filter of the fits does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.scan import _step_shape, load_steps, steady_filter
from drivetool.identify.noise import filtered
from tests.recover import one_sensor

AT = 2500


@pytest.mark.parametrize("memory, slow", [(None, None), (0.98, None), (0.999, None), (0.95, 0.2)])
def test_a_step_leaves_in_the_innovations_what_the_scan_looks_for(memory, slow):
    base, _ = one_sensor(4)
    base = replace(base, noise=replace(base.noise, memory=memory, slow=slow))
    trace = base.problem.traces[0]
    inputs = trace.inputs.copy()
    inputs[AT:, 0] += 1.0
    with_step = replace(base.problem, traces=(replace(trace, inputs=inputs),))
    without, other = (filtered(p, base.point, base.noise)[0] for p in (base.problem, with_step))
    left = ((without.innovations - other.innovations) / np.sqrt(without.variance))[AT:, 0]
    shape = _step_shape(base, len(left))
    np.testing.assert_allclose(shape, left, rtol=0.0, atol=2e-3 * np.abs(left).max())


def test_an_angle_that_is_not_measured_is_left_out():
    # A weight on the load needs the angle as a state, which no steady filter of a speed can have.
    base, _ = one_sensor(4)
    task = base.task.at({"load.imbalance_sine": 1e-9})
    turning = replace(base, task=task, problem=task.problem())
    for mine, plain in zip(steady_filter(turning), steady_filter(base), strict=True):
        np.testing.assert_allclose(mine, plain, rtol=1e-6, atol=1e-12)


def test_a_load_step_is_looked_for_beside_an_imbalance():
    base, _ = one_sensor(4)
    task = base.task.at({"load.imbalance_sine": 1e-9})
    problem = task.problem()
    trace = problem.traces[0]
    inputs = trace.inputs.copy()
    inputs[AT:, 0] += np.ptp(inputs[:, 0])
    turning = replace(base, task=task, problem=replace(problem, traces=(replace(trace, inputs=inputs),)),
                      point=replace(base.point, starts=tuple(np.append(s, 0.0) for s in base.point.starts)))
    instant = load_steps(turning)[0][0]
    assert instant == pytest.approx(trace.origin + AT * trace.step, abs=0.02)
