"""The library of laws: which there are for which motion, their size, and what they leave of the inertia."""

import numpy as np
import pytest

from drivetool.identify.laws.laws import MEASUREMENT_NOISE, law_library, measurement_noise_law
from drivetool.identify.motion.motion import motions_of
from tests.identify.swing import PARTS, record, swing

BACK = "direction-dependent friction"
CRANK = "inertia varying twice per turn"


def laws_of(s, turns=True, noise=None, role="motor_angle"):
    seen = motions_of([record(s, role)], role)
    return {law.name: law
            for law in (*law_library(seen, turns), *(() if noise is None else measurement_noise_law(noise)))}


def test_every_law_has_size_one():
    noise = 30.0 * np.random.default_rng(1).standard_normal(4000)
    found = laws_of(swing(), noise=(noise,))
    assert len(found) > 45 and MEASUREMENT_NOISE in found
    for law in found.values():
        assert np.nanmean(np.concatenate(law.columns) ** 2, axis=0) == pytest.approx(np.ones(law.size)), law.name


def test_size_one_is_that_of_all_records_together():
    a, b = swing(), swing(2000, parts=tuple((0.3 * x, f, p) for x, f, p in PARTS))
    seen = motions_of([record(a), record(b)], "motor_speed")
    law = next(x for x in law_library(seen, False) if x.name == BACK)
    assert np.mean(np.concatenate(law.columns) ** 2) == pytest.approx(1.0)
    ratio = np.sqrt(np.mean(law.columns[1] ** 2) / np.mean(law.columns[0] ** 2))
    assert ratio == pytest.approx(np.sqrt(np.mean(b.speed**2) / np.mean(a.speed**2)), rel=1e-2)


def test_friction_by_direction_is_a_candidate_only_where_the_motion_reverses():
    back, one_way = laws_of(swing()), laws_of(swing(offset=30.0))
    lost = {name for name in back.keys() - one_way.keys() if not name.startswith("Stribeck")}
    assert lost == {BACK, "time-varying friction"}


def test_noise_at_standstill_is_no_motion_back():
    s = swing(4000, parts=((2.0, 0.5, 0.5 * np.pi),))
    speed = np.where(s.speed > 0.0, s.speed, 0.0)
    noisy = record(s, "motor_speed", noise=speed - s.speed + 1e-3 * np.random.default_rng(1).standard_normal(4000))
    seen = motions_of([noisy], "motor_speed")
    assert min(np.mean(seen.each[0].side > 0.0), np.mean(seen.each[0].side < 0.0)) > 0.1
    assert BACK not in {law.name for law in law_library(seen, True)}
    assert BACK in laws_of(s)


def test_a_carriage_has_no_laws_of_an_angle():
    found = laws_of(swing(), turns=False)
    assert found and not any("turn" in name.split() or name == CRANK for name in found)
    assert found.keys() < laws_of(swing()).keys()


def crank_sizes(s):
    """Root mean squares of both columns before they have size one."""
    cos, sin = np.cos(2.0 * s.middle), np.sin(2.0 * s.middle)
    a, v = s.acceleration, s.mean_speed
    return np.sqrt([np.mean((a * cos - v**2 * sin) ** 2), np.mean((a * sin + v**2 * cos) ** 2)])


def test_over_full_turns_an_inertia_that_changes_with_the_angle_keeps_its_mean():
    s = swing(offset=30.0)
    mean = laws_of(s)[CRANK].inertia * crank_sizes(s)
    assert np.abs(mean).max() < 0.01


def test_over_a_narrow_swing_it_has_what_it_is_there():
    s = swing(parts=((0.8, 1.0, 0.0),))
    mean = laws_of(s)[CRANK].inertia * crank_sizes(s)
    assert mean == pytest.approx([np.sinc(1.6 / np.pi), 0.0], abs=0.05)  # mean of cos 2q over |q| < 0.8


@pytest.mark.parametrize("amplitude, offered", [(0.6, False), (0.8, True)])
def test_what_hardly_turns_has_no_inertia_over_the_angle(amplitude, offered):
    # Half of its power would be the drive's own inertia at |q| < 0.7: sin(1.39) / 1.39 is the root of a half.
    assert (CRANK in laws_of(swing(parts=((amplitude, 1.0, 0.0),)))) == offered


def test_what_hardly_turns_repeats_only_what_is_short():
    orders = {int(name.split()[-1]) for name in laws_of(swing(parts=((0.1, 1.0, 0.0),))) if "ripple" in name}
    assert min(orders) == 14 and max(orders) == 40  # 14 times 0.1 rad is the first above 1.39


def test_laws_are_functions_of_the_motion():
    s = swing()
    found, width = laws_of(s), 0.1 * np.quantile(np.abs(s.mean_speed), 0.99)
    expected = {BACK: [np.abs(s.mean_speed)],
                "friction that grows with the square of the speed": [s.mean_speed * np.abs(s.mean_speed)],
                "Stribeck friction with a Stribeck speed of 0.1 times the maximum speed": [
                    s.side * np.exp(-(s.mean_speed / width) ** 2)],
                "torque changing linearly with time": [np.linspace(-1.0, 1.0, 4000)],
                "torque ripple of order 7": [np.cos(7.0 * s.middle), np.sin(7.0 * s.middle)]}
    for name, columns in expected.items():
        for column, law in zip(columns, found[name].columns[0].T, strict=True):
            assert np.corrcoef(column[20:-20], law[20:-20])[0, 1] > 0.998, name
