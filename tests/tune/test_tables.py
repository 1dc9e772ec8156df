"""The tuner against the published tables of Tallfors 2005: every row, every column."""

from __future__ import annotations

import math

import pytest

from drivetool.tune.optimisation.criteria import criterion, criterion_value
from drivetool.tune.optimisation.load_step_factors import factors
from drivetool.tune.optimisation.search import TuneLimits, optimum, tuning_problem
from drivetool.tune.speed_loop.loop import Settings, Wiring, build
from drivetool.tune.speed_loop.sensitivity import max_sensitivity, plant
from tests.tallfors import MOTORS, SPEED, TABLE_3_2, TABLES_4, TORQUE, tandem, two_mass_plant

PRINTED_DEAD_TIME = "zero"  # the dead time as printed in the thesis
PERCENT_SECONDS = 100.0 * TORQUE / SPEED  # rad per Nm in % s at rated torque
BASE_GAIN = TORQUE / SPEED


@pytest.mark.parametrize("row", TABLE_3_2, ids=lambda row: f"{row.plant}-{row.criterion}")
def test_row_of_table_3_2_at_its_own_settings(row):
    loop = build(two_mass_plant(row.plant), Wiring(dead_time=PRINTED_DEAD_TIME))
    settings = Settings(row.gain, row.integral_time)
    load = factors(loop, settings).load
    assert load.impact_drop == pytest.approx(row.impact_drop, rel=0.01)
    assert load.overshoot == pytest.approx(row.overshoot, abs=0.3)
    assert math.ceil(load.settling_time / 0.002) * 0.002 == pytest.approx(row.settling, abs=1e-9)
    assert criterion_value(loop, criterion(row.criterion), settings) == pytest.approx(row.value, rel=0.005)
    assert max_sensitivity(plant(loop.drive, loop.wiring), settings)[0] <= 2.0


@pytest.mark.parametrize(
    "row", [TABLE_3_2[0], *(pytest.param(row, marks=pytest.mark.slow) for row in TABLE_3_2[1:])],
    ids=lambda row: f"{row.plant}-{row.criterion}")
def test_optimum_of_table_3_2_is_reached(row):
    loop = build(two_mass_plant(row.plant), Wiring(dead_time=PRINTED_DEAD_TIME))
    work = tuning_problem(loop, criterion(row.criterion), TuneLimits(2.0))
    found = optimum(work)
    published = criterion_value(loop, criterion(row.criterion), Settings(row.gain, row.integral_time))
    assert found.value <= 1.005 * min(published, row.value)
    assert max_sensitivity(work.plant, found.settings)[0] <= 2.0 + 1e-6


def test_time_weighted_optimum_of_figure_3_8():
    """Without a limit; the printed minimum, its integral time, and that it is not robust."""
    loop = build(two_mass_plant("heavy"), Wiring(dead_time=PRINTED_DEAD_TIME))
    work = tuning_problem(loop, criterion("IT8SE"), TuneLimits(50.0))
    found = optimum(work)
    assert found.value == pytest.approx(1.1e-17, abs=0.05e-17)
    assert found.settings.integral_time == pytest.approx(0.075, abs=0.001)
    assert max_sensitivity(work.plant, found.settings)[0] > 2.0


@pytest.mark.parametrize("column", TABLES_4, ids=lambda c: f"{c.plant}-{c.configuration}")
def test_column_of_the_tandem_tables_at_its_own_gains(column):
    loop = build(tandem(column.plant), Wiring(column.configuration, MOTORS, dead_time=PRINTED_DEAD_TIME))
    settings = Settings(column.gain * BASE_GAIN, column.integral_time, column.second)
    found = factors(loop, settings)
    assert found.load.iae * PERCENT_SECONDS == pytest.approx(column.iae, rel=0.02)
    assert found.load.impact_drop * PERCENT_SECONDS == pytest.approx(column.impact_drop, rel=0.02)
    assert found.load.overshoot == pytest.approx(column.overshoot, abs=1.0)
    assert any(found.load.settling_time == pytest.approx(s, rel=0.03) for s in column.settling)
    for motor, printed in zip(MOTORS, column.torque_overshoot, strict=True):
        assert found.torque_overshoot[motor] == pytest.approx(printed, abs=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("column", TABLES_4, ids=lambda c: f"{c.plant}-{c.configuration}")
def test_optimum_of_the_tandem_tables_is_reached(column):
    loop = build(tandem(column.plant), Wiring(column.configuration, MOTORS, dead_time=PRINTED_DEAD_TIME))
    work = tuning_problem(loop, criterion("IAE"), TuneLimits(2.0))
    found = optimum(work)
    assert found.value * PERCENT_SECONDS <= 1.01 * column.iae
    assert max_sensitivity(work.plant, found.settings)[0] <= 2.0 + 1e-6
