"""The regression of torque over motion: exact without noise, with values held, with a law; shares of its error."""

import numpy as np
import pytest

from drivetool.identify.laws.influence import FEW_BLOCKS_FACTOR, sandwich_covariance
from drivetool.identify.laws.laws import law_library
from drivetool.identify.laws.regression import is_regressable, regress
from drivetool.identify.motion.linear import INFLUENCE_BLOCKS, Rows, change_of, influence_of, inverse_of
from drivetool.identify.motion.motion import motions_of
from tests.identify.swing import STEP, TRUTH, record, swing, task_of, torque_for
from tests.recover import experiment

S = swing()
ROLES = pytest.mark.parametrize("role", ["motor_speed", "motor_angle"])


def regressed(*records, laws=(), **task):
    role = next(r for r in records[0].signals if r != "motor_torque")
    return regress(task_of(*records, **task), motions_of(records, role), laws)


def values(found):
    return dict(zip(found.names, found.values, strict=True))


@ROLES
def test_without_noise_it_is_exact(role):
    found = values(regressed(record(S, role), inertia=1.0, viscous=0.0, coulomb=0.0, idle_torque=0.0))
    assert found == pytest.approx(TRUTH, rel=1e-3)


def test_records_count_together():
    other = swing(3000, parts=((1.0, 2.0, 0.0),))
    assert values(regressed(record(S), record(other))) == pytest.approx(TRUTH, rel=1e-3)


def test_missing_values_are_left_out():
    made = record(S)
    speed = made.signals["motor_speed"].copy()
    speed[700:702] = speed[1500:1600] = np.nan
    made.signals["motor_torque"][1510:1590] = 1e3  # the motion there is unknown
    made = type(made)(**{**vars(made), "signals": {**made.signals, "motor_speed": speed}})
    assert values(regressed(made)) == pytest.approx(TRUTH, rel=2e-3)


def test_what_is_held_stays_and_the_rest_is_exact():
    free = ("motor.inertia", "motor.idle_torque")
    assert values(regressed(record(S), free=free)) == pytest.approx({n: TRUTH[n] for n in free}, rel=1e-3)
    off = values(regressed(record(S), free=free, coulomb=0.2))
    assert abs(off["motor.inertia"] / TRUTH["motor.inertia"] - 1.0) < 0.05  # half the friction goes elsewhere
    assert off != pytest.approx({n: TRUTH[n] for n in free}, rel=1e-3)


@ROLES
def test_a_law_takes_up_its_torque(role):
    with_cogging = record(S, role, more=0.2 * np.cos(7.0 * S.middle + 0.4))
    seen = motions_of([with_cogging], role)
    law = next(x for x in law_library(seen, True) if x.name == "torque ripple of order 7")
    found = values(regressed(with_cogging, laws=(law,)))
    own = {n: found.pop(n) for n in TRUTH}
    assert own == pytest.approx(TRUTH, rel=5e-3)
    assert np.hypot(*found.values()) == pytest.approx(0.2 / np.sqrt(2.0), rel=0.02)
    plain = values(regressed(with_cogging))
    assert abs(plain["motor.coulomb"] / TRUTH["motor.coulomb"] - 1.0) > 0.02


def test_shares_of_the_error_are_those_of_plain_sums():
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((500, 5)) * [1e4, 1.0, 1e-3, 1.0, 1.0]
    torque = rows @ [1e-4, 2.0, 3e2, 1.0, 0.5] + rng.standard_normal(500)
    parts = [Rows(torque[part], rows[part], rows[part]) for part in (slice(200), slice(200, 500))]
    found = inverse_of(parts)
    best, *_ = np.linalg.lstsq(rows, torque, rcond=None)
    assert change_of(parts, found) == pytest.approx(best)
    shares = influence_of([Rows(p.residual - p.slopes @ best, p.slopes, p.slopes) for p in parts], found)
    inverse, left = np.linalg.inv(rows.T @ rows), torque - rows @ best
    expected = np.zeros((INFLUENCE_BLOCKS, 5))
    for i in range(500):
        expected[i * INFLUENCE_BLOCKS // 500] += inverse @ rows[i] * left[i]
    np.testing.assert_allclose(shares, expected, atol=1e-8 * np.abs(expected).max(axis=0).min())
    # Their sum is zero.
    covariance = FEW_BLOCKS_FACTOR**2 * INFLUENCE_BLOCKS / (INFLUENCE_BLOCKS - 1) * sum(np.outer(e, e)
                                                                                        for e in expected)
    np.testing.assert_allclose(sandwich_covariance(shares), covariance, rtol=1e-6,
                               atol=1e-9 * covariance.min() ** 2)


def test_the_sandwich_holds_under_correlated_torque_noise():
    errors, squares, free = [], [], ("motor.inertia", "motor.viscous")
    for seed in range(30):
        rng = np.random.default_rng(seed)
        slow = np.convolve(0.3 * rng.standard_normal(4100), np.ones(60) / np.sqrt(60.0), "valid")[:4000]
        found = regressed(record(S, more=slow), free=free)
        errors.append(found.values - [TRUTH[n] for n in free])
        squares.append(np.diag(sandwich_covariance(found.influence)))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(squares, axis=0)) * FEW_BLOCKS_FACTOR
    assert np.all((ratio > 0.6) & (ratio < 1.6))


def test_only_a_body_under_nothing_but_inertia_and_friction_is_regressed():
    assert is_regressable(task_of(record(S)))
    assert not is_regressable(task_of(record(S), carried_mass=1.0, radius=0.1))


def test_samples_at_standstill_do_not_count():
    # Dry friction takes any torque where the body stands: here less and less of what it would take to move it.
    before = swing(3000, parts=((2.0, 0.5, 0.5 * np.pi), (0.4, 1.5, 0.5 * np.pi)))  # ends at speed zero
    speed = np.append(before.speed, np.zeros(1000))
    torque = np.append(torque_for(before), np.linspace(0.3, 0.0, 1000))
    assert values(regressed(experiment(torque, speed, step=STEP))) == pytest.approx(TRUTH, rel=5e-3)
