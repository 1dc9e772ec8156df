"""The mean over recordings: known variances come out, and its interval holds for few recordings."""

import numpy as np
import pytest

from drivetool.site.trends.random_effects import random_effects

S_R, S_DAY, DRAWS = 0.5, 1.0, 400


def drawn(rng, days, per_day):
    day = np.repeat(np.arange(days), per_day)
    stated = rng.uniform(0.2, 0.6, size=len(day))
    between = S_DAY * rng.normal(size=days) if days > 1 else np.zeros(1)
    return 5.0 + between[day] + np.hypot(S_R, stated) * rng.normal(size=len(day)), stated**2, day


@pytest.mark.slow
@pytest.mark.parametrize("days, per_day", [(3, 1), (4, 3), (10, 2), (1, 6)])
def test_the_interval_covers_and_the_scatter_comes_out(days, per_day):
    """At least 92 % by the 99 % interval of 400 draws, at most what 95 % allow."""
    rng = np.random.default_rng(1)
    found = [random_effects(*drawn(rng, days, per_day)) for _ in range(DRAWS)]
    assert 0.915 <= np.mean([m.ci95[0] <= 5.0 <= m.ci95[1] for m in found]) <= 0.98
    if per_day > 1:
        assert np.sqrt(np.mean([m.std_within_day**2 for m in found])) == pytest.approx(S_R, rel=0.1)
    else:
        assert found[0].std_within_day is None
    if days > 1:
        expected = np.hypot(S_DAY, 0.0 if per_day > 1 else S_R)
        assert np.sqrt(np.mean([m.std_between_days**2 for m in found])) == pytest.approx(expected, rel=0.12)
    else:
        assert found[0].std_between_days is None


def test_without_days_there_is_one_scatter():
    rng = np.random.default_rng(2)
    values, variances, _ = drawn(rng, 1, 8)
    mean = random_effects(values, variances)
    assert mean.days is None and mean.std_between_days is None and mean.recordings == 8
    assert mean.ci95[0] < values.mean() < mean.ci95[1]


def test_one_recording_has_no_interval_and_equal_ones_have_none_to_speak_of():
    assert random_effects(np.array([2.0]), np.array([0.1])).ci95 is None
    mean = random_effects(np.full(5, 2.0), np.zeros(5), np.arange(5))
    assert mean.value == pytest.approx(2.0) and mean.ci95 == pytest.approx((2.0, 2.0))
    assert mean.std_between_days == 0.0 and mean.std_within_day is None


def test_a_recording_that_states_a_large_std_counts_less():
    values = np.array([1.0, 1.1, 0.9, 1.0, 9.0])
    mean = random_effects(values, np.array([0.01, 0.01, 0.01, 0.01, 100.0]))
    assert mean.value < 1.5
