"""A drive that turns one way: idle torque and Coulomb friction are stated as their sum, and not singly."""

import pytest

from drivetool.drive import one_body
from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from tests.coverage_of import interval
from tests.identify.one_direction import one_direction

CONSTANT = ("motor.idle_torque", "motor.coulomb")


def fitted(seed, **options):
    made = one_direction(seed)
    drive = one_body().with_values({"motor.inertia": 1.4 * made.machine.inertia[0]})
    return made, greybox([made.record], drive, Options(**options))


def holds(line, value):
    return line.ci95 is not None and line.ci95[0] <= value <= line.ci95[1]


def counts(seeds):
    held = {"sum": 0, "inertia": 0, "viscous": 0}
    for seed in seeds:
        made, found = fitted(seed)
        assert all(found.line(n).ci95 is None for n in CONSTANT if any(p.name == n for p in found.parameters))
        assert "idle-torque-not-separable" in {f.code for f in found.findings}
        (total,) = found.ratios
        held["sum"] += holds(total, made.total)
        held["inertia"] += holds(found.line("motor.inertia"), made.machine.inertia[0])
        held["viscous"] += holds(found.line("motor.viscous"), made.machine.viscous[0])
    return held


def test_the_sum_has_an_interval_and_neither_part():
    """A closed loop backward with an idle torque, an open one forward without."""
    assert counts([9, 10]) == {"sum": 2, "inertia": 2, "viscous": 2}


def test_a_stated_part_leaves_the_other_identifiable():
    _, found = fitted(7, hold=("motor.idle_torque",))
    assert not found.ratios and found.line("motor.coulomb").std is not None


@pytest.mark.slow
def test_the_intervals_of_twelve_hold():
    check(range(20, 32))


@pytest.mark.study
def test_the_intervals_of_a_hundred_hold():
    check(range(100, 200))


def check(seeds):
    held = counts(seeds)
    print(held)
    assert all(interval(k, len(seeds), 0.99 + 0.01 * 2 / 3).high >= 0.92 for k in held.values()), held


def test_a_start_inertia_is_found_and_not_doubted():
    made = one_direction(7)
    found = greybox([made.record], one_body(), Options())
    assert holds(found.line("motor.inertia"), made.machine.inertia[0])
    assert "suspect-unit" not in {f.code for f in found.findings}


@pytest.mark.parametrize("seed", [9, 10])
def test_the_torque_that_the_motion_requires_tells_the_sum_alone_too(seed):
    """One record turns backward, with an idle torque."""
    made, found = fitted(seed, criterion="inverse")
    assert all(p.ci95 is None for p in found.parameters if p.name in CONSTANT)
    (total,) = found.ratios
    assert abs(total.value - made.total) < 3.0 * total.std < 0.1 * made.total
