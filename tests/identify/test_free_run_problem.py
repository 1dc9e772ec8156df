"""Free runs whose errors are differenced over a lag, and runs with a constant torque of their own."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.errors import NotEnoughData
from drivetool.identify.estimate.interval_and_status import inverted
from drivetool.identify.problem.least_squares import solve
from drivetool.identify.problem.problem import Point
from drivetool.identify.setup.setup import roles_of, traces_of
from drivetool.identify.setup.task import Task
from tests.recover import experiment

STEP, N, LAG = 1e-2, 300, 7
INERTIA, VISCOUS = 0.5, 0.8


def coast(torque, first, n=N):
    """(n,) speed in closed form under a constant torque."""
    end = torque / VISCOUS
    return end + (first - end) * np.exp(-VISCOUS / INERTIA * STEP * np.arange(n))


def problem_of(*speeds, free=("motor.inertia",), torque=2.0, segment=0.0, inertia=INERTIA):
    records = tuple(experiment(np.full(len(v), torque), v, step=STEP) for v in speeds)
    drive = one_body().with_values({"motor.inertia": inertia, "motor.viscous": VISCOUS})
    return Task(drive, free, roles_of(records, drive), records).problem(segment)


def gappy():
    speed = coast(2.0, 1.0) + 0.1 * np.sin(np.arange(N))
    speed[40:52] = speed[110] = np.nan
    return speed


def test_errors_over_a_lag_are_those_of_plain_arrays():
    measured = gappy()
    problem = replace(problem_of(measured, inertia=0.6), lag=LAG)
    point = Point(np.array([0.6]), (np.array([1.2]),))
    end = 2.0 / VISCOUS
    error = end + (1.2 - end) * np.exp(-VISCOUS / 0.6 * STEP * np.arange(N)) - measured
    expected = [error[i + LAG] - error[i] for i in range(N - LAG)
                if np.isfinite(error[i + LAG]) and np.isfinite(error[i])]
    assert len(expected) < N - LAG - 12
    assert problem.cost(point) == pytest.approx(np.sum(np.square(expected)), rel=1e-9)
    assert problem.normal(point).cost == pytest.approx(np.sum(np.square(expected)), rel=1e-9)


def test_their_slope_is_that_of_the_cost():
    problem = replace(problem_of(gappy(), inertia=0.6), lag=LAG)
    normal = problem.normal(Point(np.array([0.6]), (np.array([1.2]),)))

    def half(value, start):
        return 0.5 * problem.cost(Point(np.array([value]), (np.array([start]),)))

    d = 1e-5
    assert normal.slope[0] == pytest.approx((half(0.6 + d, 1.2) - half(0.6 - d, 1.2)) / (2 * d), rel=1e-5)
    assert normal.own_slope[0][0] == pytest.approx((half(0.6, 1.2 + d) - half(0.6, 1.2 - d)) / (2 * d), rel=1e-5)


def test_an_offset_of_the_sensor_is_no_error_over_a_lag():
    problem = problem_of(coast(2.0, 1.0) + 5.0)
    point = Point(np.array([INERTIA]), (np.array([1.0]),))
    assert problem.cost(point) == pytest.approx(25.0 * N)
    assert replace(problem, lag=LAG).cost(point) == pytest.approx(0.0, abs=1e-12)


def test_each_run_finds_its_own_constant_torque():
    problem = problem_of(coast(2.5, 1.0), coast(1.2, -3.0)).with_constant_torque()  # 2.0 were logged
    assert problem.unknowns == 1 + 2 * 2
    starts = (np.array([0.5, 0.0]), np.array([-1.0, 0.0]))
    found = solve(problem, Point(np.array([0.45]), starts)).point
    assert found.values == pytest.approx([INERTIA], rel=1e-6)
    assert found.starts[0] == pytest.approx([1.0, 0.5], rel=1e-6)
    assert found.starts[1] == pytest.approx([-3.0, -0.8], rel=1e-6)


def test_without_a_torque_of_its_own_the_inertia_takes_it_up():
    problem = problem_of(coast(2.5, 1.0), coast(1.2, -3.0))
    found = solve(problem, Point(np.array([0.45]), (np.array([0.5]), np.array([-1.0])))).point
    assert abs(found.values[0] / INERTIA - 1.0) > 0.05


def test_no_direction_at_all_has_no_inverse_and_no_error():
    inverse, lost = inverted(np.zeros((0, 0)), 1e-10)
    assert inverse.shape == (0, 0) and lost.shape == (0,)


def test_pieces_are_bounded_by_the_samples_and_not_by_the_duration():
    """Stamps in a wrong unit: a second is cut into as many pieces as there are samples, and none is long enough."""
    record = experiment(np.zeros(1000), np.zeros(1000), step=1e9)
    with pytest.raises(NotEnoughData, match="10 samples"):
        traces_of([record], roles_of([record], one_body()), 1.0)
