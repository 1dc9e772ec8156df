"""The records of coupled axes and varying inertias: their simulators against energy, and a fit of one."""

import numpy as np
import pytest

from tests.study.coupled_axes import arm, varying
from tests.study.study_coupled_axes import fitted, misses


def test_an_arm_without_friction_keeps_its_energy():
    p = np.array([1.5, 0.4, 0.5, 0.0, 0.0, 0.0, 0.0])  # shoulder, elbow, coupling
    loose = np.array([[0.0, 0.0], [0.0, 3.0]])  # a torque proportional to the elbow's speed drives it
    speeds = np.tile([0.0, 2.0], (500, 1))
    torques, states = arm._run(np.zeros((500, 2)), speeds, loose, p)
    _, _, v1, v2 = states.T
    c = np.cos(states[:, 1])
    energy = 0.5 * (1.9 + 1.0 * c) * v1**2 + (0.4 + 0.5 * c) * v1 * v2 + 0.2 * v2**2
    # The torque is held over a sample, so the work is its product with the angle passed.
    work = np.cumsum(torques[:-1, 1] * np.diff(states[:, 1]))
    assert energy[1:] == pytest.approx(work, rel=1e-6, abs=1e-9)
    assert energy[-1] > 0.1


def test_a_body_of_varying_inertia_keeps_its_energy():
    p = np.array([2.0, 0.0, 0.0, 0.0, 2.0, 0.3, 1.0])  # inertia, friction, idle, order, phase, its speed
    n = 1500
    torque, angle, speed = varying._run(np.zeros(n), np.full(n, 10.0), np.array([0.0, 4.0]), p, 0.2, np.zeros(n))
    energy = 0.5 * 2.0 * (1.0 + 0.2 * np.cos(2.0 * angle + 0.3)) * speed**2
    assert energy[1:] == pytest.approx(np.cumsum(torque[:-1] * np.diff(angle)), rel=1e-6)
    assert np.ptp(angle) > np.pi


@pytest.mark.slow
@pytest.mark.parametrize("number, seed", [(6, 8506), (2, 8502)])
def test_a_varying_inertia_is_identified_by_its_mean(number, seed):
    record = varying.draw(number, seed)
    found = fitted(varying.STEP, record)
    assert found["ci95"][0] is not None and not misses(found, record.inertia)
    assert "model-error" in found["findings"]
    assert abs(found["value"][0] / record.inertia - 1.0) < 0.01  # the inertia is its mean, of 20 % that it varies


def test_what_is_far_off_or_narrow_without_a_word_is_a_miss():
    def missed(value, low, high, *findings):
        return misses({"value": [value], "ci95": [[low, high]], "findings": findings}, 1.0)

    assert missed(1.1, 1.09, 1.11, "model-error") and not missed(1.1, 1.05, 1.15)
    assert missed(1.0, 0.99, 1.01) and not missed(1.0, 0.99, 1.01, "model-error")
    assert not misses({"value": [2.0], "ci95": [None], "findings": []}, 1.0)
