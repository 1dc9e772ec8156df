"""Both sides of one drive: parameters referred through a gear, and the test of all of them, by closed forms."""

import numpy as np
import pytest
from scipy.stats import binom, chi2

from drivetool.drive import Drive, resonances, two_mass
from drivetool.identify.estimate.estimate import Covariance
from drivetool.identify.several import both_sides
from drivetool.identify.several.both_motors import swap
from drivetool.identify.several.both_sides import Figure, Side, counterpart
from tests.frequency_response import frequency_response

CHAIN = Drive("custom", ("motor", "gear", "arm"), ("shaft", "shaft2"))
VALUES = {"motor.inertia": 0.02, "gear.inertia": 0.5, "arm.inertia": 3.0, "motor.viscous": 0.01,
          "gear.viscous": 0.3, "arm.viscous": 2.0, "shaft.stiffness": 900.0, "shaft.damping": 0.7,
          "shaft.ratio": 5.0, "shaft2.stiffness": 4000.0, "shaft2.damping": 1.5, "shaft2.ratio": 0.8,
          "shaft2.half_gap": 0.02}


def from_the_arm(values):
    """The chain from its other end: bodies reversed, ratios inverted, each factor undone."""
    other = Drive("custom", ("motor", "middle", "far"), ("second", "first"))
    other = other.with_values({"first.ratio": 1.0 / values["shaft.ratio"],
                               "second.ratio": 1.0 / values["shaft2.ratio"]})
    found = {}
    for name, value in values.items():
        its, factor = counterpart(name, CHAIN, other)
        found[its] = value / factor
    return other.with_values(found)


def test_a_chain_with_gears_moves_alike_from_both_ends():
    """The arm's torque to the arm's speed, once as the load's and once as the motor's."""
    one, other = CHAIN.with_values(VALUES), from_the_arm(VALUES)
    assert other.values["second.stiffness"] == pytest.approx(4000.0 * 0.8**-2)
    assert other.values["second.half_gap"] == pytest.approx(0.02 * 0.8)
    hz = np.geomspace(0.3, 300.0, 40)
    mine = frequency_response(one, hz, ("load_torque",), ("arm_speed",))
    assert frequency_response(other, hz)[:, 0, 0] == pytest.approx(-mine[:, 0, 0], rel=1e-9)
    found = [[(m.frequency_hz, m.damping_ratio) for m in resonances(drive) if m.kind == "resonance"]
             for drive in (one, other)]
    assert np.array(found[0]) == pytest.approx(np.array(found[1]))


def test_sums_and_total_inertia_are_referred_to_the_first_motor():
    one, other = CHAIN.with_values(VALUES), from_the_arm(VALUES)
    sums = {"total.viscous": "viscous", "total.idle_torque": "idle_torque"}
    one, other = (d.with_values({f"{b}.idle_torque": t for b, t in zip(d.bodies, idle, strict=True)})
                  for d, idle in ((one, (0.3, 1.0, 4.0)), (other, (4.0, 1.0, 0.3))))
    for total, suffix in sums.items():
        name, factor = counterpart(total, one, other)
        assert name == total and other.referred_to_motor(suffix) * factor == pytest.approx(
            one.referred_to_motor(suffix))
    figures = [{"total_inertia_at_motor": Figure(d.referred_inertia, "kg m^2", 0.1)} for d in (one, other)]
    found = swap(Side("a", one, derived=figures[0]), Side("b", other, derived=figures[1]))
    (line,) = found.derived
    assert line.values[1] == pytest.approx(line.values[0]) and line.factor == pytest.approx(1.0 / 16.0)


def side(name, values, stds=None, correlation=0.0, **more):
    drive = two_mass().with_values(values)
    if not stds:
        return Side(name, drive, **more)
    sizes = np.array(list(stds.values()))
    matrix = np.outer(sizes, sizes) * (correlation + (1.0 - correlation) * np.eye(len(sizes)))
    return Side(name, drive, covariance=Covariance(tuple(stds), matrix), **more)


def lines_of(found):
    return {line.first or line.second: line for line in found.lines}


def test_a_difference_is_over_the_root_of_the_summed_variances():
    found = swap(side("a", {"motor.inertia": 4.0}, {"motor.inertia": 0.3}),
                 side("b", {"load.inertia": 5.0}, {"load.inertia": 0.4}))
    line = lines_of(found)["motor.inertia"]
    assert (line.second, line.difference) == ("load.inertia", 1.0)
    assert (line.std, line.ratio) == (pytest.approx(0.5), pytest.approx(2.0))
    assert found.agree and found.chi_square == pytest.approx(4.0) and found.p == pytest.approx(chi2.sf(4.0, 1))


def test_correlated_parameters_are_tested_together():
    """Two that rise together where each file has them rise in opposite ways: each by itself looks harmless."""
    stds = {"motor.inertia": 0.1, "load.inertia": 0.1}
    one = side("a", {"motor.inertia": 4.0, "load.inertia": 2.0}, stds, -0.99)
    two = side("b", {"motor.inertia": 2.2, "load.inertia": 4.2}, stds, -0.99)
    found = swap(one, two)
    # Along (1, 1) the variance of the sum of both files is 2 (1 - 0.99) 0.1^2, and the difference sqrt(2) 0.2.
    assert found.chi_square == pytest.approx(2.0 * 0.2**2 / (2.0 * 0.01 * 0.1**2))
    assert not any(line.differs for line in found.lines) and found.agree is False
    assert "no single parameter differs by more than 3 joint standard deviations" in found.outcome
    assert [f.code for f in found.findings] == ["parameters-differ"]


def test_what_is_beyond_three_is_named_the_worst_first_and_three_at_most():
    names = ("motor.inertia", "load.inertia", "motor.viscous", "load.viscous")
    values = dict(zip(names, (4.0, 2.0, 1.0, 3.0), strict=True))
    stds = dict.fromkeys(names, 0.01)
    moved = {"load.inertia": 4.1, "motor.inertia": 1.8, "load.viscous": 1.3, "motor.viscous": 3.05}
    found = swap(side("a", values, stds), side("b", moved, stds))
    assert found.outcome.startswith("The estimates from the two motors differ in motor.viscous (+30 %, +21 std), "
                                    "load.inertia (-10 %, "
                                    "-14 std), motor.inertia (+2.5 %, +7.1 std) and 1 more: chi-square ")
    assert len(found.findings[0].evidence) == 3 + 4


def test_a_line_without_ratio_has_a_reason():
    one = side("a", {"motor.inertia": 4.0, "load.inertia": 2.0, "motor.coulomb": 1.0, "shaft.damping": 0.5,
                     "converter.bandwidth": 900.0, "total.viscous": 0.3, "load.ripple_sine": 0.1},
               {"motor.inertia": 0.1, "load.inertia": 0.2}, reasons={"motor.coulomb": "held at its start value"})
    two = side("b", {"load.inertia": 4.0, "motor.inertia": 2.1, "load.coulomb": 1.2, "shaft.damping": 0.5,
                     "converter.bandwidth": 500.0, "motor.viscous": 0.1, "load.viscous": 0.2,
                     "motor.ripple_sine": 0.2},
               {"load.inertia": 0.1, "motor.inertia": 0.2})
    found = lines_of(swap(one, two))
    assert found["motor.inertia"].reason == both_sides.COPIED_VALUE and found["motor.inertia"].ratio is None
    assert found["shaft.damping"].reason == both_sides.EQUAL
    coulomb = found["motor.coulomb"]
    assert coulomb.difference == pytest.approx(0.2) and coulomb.std is None
    assert coulomb.reason == "no interval in a: held at its start value; no interval in b"
    assert found["total.viscous"].reason == "only in a" and found["load.viscous"].reason == "only in b"
    assert found["converter.bandwidth"].reason == both_sides.OTHER_MOTOR
    assert found["load.ripple_sine"].reason == both_sides.PHASE and found["load.ripple_sine"].difference is None
    assert found["load.inertia"].ratio == pytest.approx(0.1 / np.hypot(0.2, 0.2))


def test_sums_are_compared_where_both_files_have_them():
    values = {"motor.inertia": 4.0, "load.inertia": 2.0, "total.viscous": 0.3}
    found = lines_of(swap(side("a", values, {"total.viscous": 0.03}),
                          side("b", values | {"total.viscous": 0.35}, {"total.viscous": 0.04})))
    assert found["total.viscous"].ratio == pytest.approx(1.0)


def test_one_drive_seen_from_both_ends_is_refused_as_often_as_the_level_says():
    """Estimates drawn about a geared drive by their covariances: the share with p below 0.05."""
    names = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")
    true, ratio = np.array([0.02, 3.0, 900.0, 0.7]), 5.0
    other = np.array([3.0, 0.02, 900.0 / 25.0, 0.7 / 25.0])
    mixed = np.array([[1.0, 0.3, -0.5, 0.0], [0.3, 1.0, 0.8, 0.2], [-0.5, 0.8, 1.9, 0.1], [0.0, 0.2, 0.1, 1.0]])
    rng, runs, low = np.random.default_rng(5), 400, 0

    def drawn(name, values, n):
        covariance = 1e-4 * mixed @ mixed.T * np.outer(values, values)
        drive = two_mass().with_values({"shaft.ratio": n} | dict(
            zip(names, rng.multivariate_normal(values, covariance), strict=True)))
        return Side(name, drive, covariance=Covariance(names, covariance))

    for _ in range(runs):
        found = swap(drawn("a", true, ratio), drawn("b", other, 1.0 / ratio))
        low += found.p < 0.05
    assert binom.ppf(0.005, runs, 0.05) <= low <= binom.ppf(0.995, runs, 0.05)
