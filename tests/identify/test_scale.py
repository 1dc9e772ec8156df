"""A record in other units of torque and speed has the same fit in these units: no threshold is absolute."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body, two_mass
from drivetool.identify.frequency.frequency_fit import problem_of as lines_of
from drivetool.identify.frequency.frf import Response
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from tests.identify.swing import TRUTH, record, swing, task_of

PER_SPEED = {"motor.inertia", "motor.viscous"}


def unit(name, torque, speed):
    return torque / speed if name in PER_SPEED else torque


def fitted(torque, speed):
    """Value and standard deviation of every parameter in the units of the record as it was, and the findings."""
    rng, made = np.random.default_rng(3), record(swing(2000))
    noisy = made.signals["motor_torque"] + 0.02 * rng.standard_normal(2000)
    moved = made.signals["motor_speed"] + 2e-3 * rng.standard_normal(2000)
    made = replace(made, signals={"motor_torque": torque * noisy, "motor_speed": speed * moved})
    start = {n: 0.5 * v * unit(n, torque, speed) if n == "motor.inertia" else 0.0 for n, v in TRUTH.items()}
    found = greybox([made], one_body().with_values(start), Options(free=tuple(TRUTH)))
    rows = {p.name: p for p in found.parameters if p.name in TRUTH}
    figures = np.array([(rows[n].value, rows[n].std) / np.array(unit(n, torque, speed)) for n in TRUTH])
    return figures, [f.code for f in found.findings], found.explanation


@pytest.fixture(scope="module")
def as_it_is():
    return fitted(1.0, 1.0)


# Powers of two: no rounding changes.
@pytest.mark.slow
@pytest.mark.parametrize("torque, speed", [(2.0**20, 1.0), (2.0**20, 2.0**-17), (2.0**-17, 2.0**10)])
def test_a_record_in_other_units_has_the_same_fit(as_it_is, torque, speed):
    figures, codes, sentence = fitted(torque, speed)
    assert figures == pytest.approx(as_it_is[0], rel=1e-9)
    assert (codes, sentence) == as_it_is[1:]


def test_a_typical_size_follows_the_record():
    made, torque, speed = record(swing(1000)), 1e6, 1e-3
    large = replace(made, signals={"motor_torque": torque * made.signals["motor_torque"],
                                   "motor_speed": speed * made.signals["motor_speed"]})
    sizes, others = (task_of(each).problem().size for each in (made, large))
    assert others / sizes == pytest.approx([unit(n, torque, speed) for n in TRUTH])


def test_of_an_angle_the_size_is_that_of_its_speed():
    roles = ("motor_speed", "motor_angle")
    by_speed, by_angle = (task_of(record(swing(1000), role)).problem().size for role in roles)
    assert by_angle == pytest.approx(by_speed, rel=0.05)


def test_a_typical_size_follows_a_frequency_response():
    drive = two_mass().with_values({"motor.inertia": 1.0, "load.inertia": 1.0, "shaft.stiffness": 100.0,
                                    "shaft.damping": 0.1})
    free, flat = ("motor.inertia", "shaft.stiffness", "shaft.damping"), np.ones(20)

    def sizes(gain):
        g, error = gain * flat.astype(complex), 1e-3 * gain**2 * flat
        r = Response(np.linspace(1.0, 20.0, 20), g, error, error, flat, 1.0, 8.0, "periods")
        return lines_of(drive, free, "motor_speed", 1e-3, r, "likelihood").size

    assert sizes(1e-6) == pytest.approx(1e6 * sizes(1.0))


@pytest.mark.parametrize("name, figure", [
    ("shaft.stiffness", 3.0 / 2.0), ("shaft.half_gap", 2.0), ("motor.drag", 3.0 / 4.0), ("motor.coulomb", 3.0),
    ("motor.stribeck_speed", 2.0), ("shaft.load_damping", 0.5), ("converter.bandwidth", 1.0),
    ("converter.dead_time", 1.0), ("load.carried_mass", 1.5), ("motor.ripple_order", 0.5)])
def test_a_size_has_the_dimension_of_its_quantity(name, figure):
    quantity = two_mass().quantity(name)
    assert quantity.size(3.0, 2.0) == pytest.approx(figure * quantity.scale)
