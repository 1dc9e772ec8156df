"""Records that differ: p-values count the pairs, friction is freed, day and machine are indistinguishable."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import reverses
from drivetool.identify.several.comparison import CompareOptions, compare
from drivetool.identify.several.differences import DIFFERENCE_SIGNIFICANCE, between_machines, differences, holm
from tests.identify.test_by_record import record
from tests.recover import experiment
from tests.simulator.experiments import alternating
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise

STEP, SECONDS = 2e-3, 12.0
SERVO = Machine((1.95e-4,), (7e-5,), (0.012,), (0.0,))


def servo(seed, machine=SERVO, name="a"):
    """A record of torque steps that turn a small servo both ways."""
    n = round(SECONDS / STEP)
    torque = alternating(0.0, (0.02, 0.045), (0.3, 0.6), 20, 0.3, STEP, seed)[:n]
    run = simulate_fast(machine, torque, STEP, torque_noise=white_noise(n, 4e-4, seed + 1),
                        sensor_noise=white_noise(n, 0.05, seed + 2))
    return replace(experiment(run.command, run.measured, name, STEP), sha256=name * 64)


def compared(*records):
    start = one_body().with_values({"motor.inertia": 3e-4})
    return compare(records, start, CompareOptions(("physical-innovations",)))


def test_holm_is_the_published_example():
    assert holm(np.array([0.01, 0.04, 0.03, 0.005])) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_records_of_one_machine_hardly_ever_differ():
    rng, alarms = np.random.default_rng(4), 0
    for _ in range(400):
        figures = {r: {f"p{j}": (rng.normal(), 1.0, "") for j in range(4)} for r in "abc"}
        alarms += any(d.differs for d in differences("oe", figures))
    assert alarms <= 0.09 * 400  # 5 % and four standard deviations


def test_what_has_no_std_is_not_compared():
    found = differences("oe", {"a": {"x": (1.0, None, ""), "y": (1.0, 0.1, "")}, "b": {"x": (9.0, 0.1, "")}})
    assert found == ()


def test_friction_is_freed_and_the_inertia_is_right():
    found = compared(servo(1), servo(11, name="b"))
    inertia = next(s for s in found.spread if s.name == "motor.inertia")
    assert inertia.values == pytest.approx([1.95e-4] * 2, rel=0.02)
    assert {d.name for d in found.differences} >= {"motor.inertia", "motor.viscous", "motor.coulomb"}
    assert not any(d.differs for d in found.differences)
    assert "parameters-differ" not in [f.code for f in found.findings]


def test_another_friction_is_reported_and_nothing_else():
    found = compared(servo(1), servo(11, replace(SERVO, coulomb=(0.015,)), "b"))
    assert {d.name for d in found.differences if d.differs} == {"motor.coulomb"}
    change = next(d for d in found.differences if d.differs)
    assert change.change == pytest.approx(0.003, abs=3.0 * change.std) and change.p < DIFFERENCE_SIGNIFICANCE
    finding = next(f for f in found.findings if f.code == "parameters-differ")
    assert "between days" in finding.text


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["auto", "inverse"])
def test_a_reversal_across_records_counts(criterion):
    """Each record turns one way only; together they distinguish Coulomb friction from an idle torque."""
    machine = replace(SERVO, idle_torque=(0.004,))
    n = round(SECONDS / STEP)
    records = []
    for seed, way in ((1, 1.0), (21, -1.0)):
        torque = way * (0.03 + 0.008 * np.sign(np.sin(np.arange(n) * 0.011 + seed)))
        run = simulate_fast(machine, torque, STEP, torque_noise=white_noise(n, 2e-4, seed + 1),
                            sensor_noise=white_noise(n, 0.02, seed + 2))
        records.append(replace(experiment(run.command, run.measured, str(seed), STEP), sha256=str(seed)[0] * 64))
    start = one_body().with_values({"motor.inertia": 3e-4})
    assert not any(reverses([e]) for e in records) and reverses(records)
    lines = {p.name: p for p in greybox(records, start, Options(criterion=criterion)).parameters}
    for name, true in (("motor.coulomb", 0.012), ("motor.idle_torque", 0.004)):
        assert lines[name].status == "fitted" and abs(lines[name].value - true) < 4.0 * lines[name].std < 0.2 * true
    alone = {p.name for p in greybox(records[:1], start, Options(criterion=criterion)).parameters}
    assert "motor.coulomb" not in alone


def group(rng, prefix, count, mean, scatter, std):
    """Recordings of a machine: name -> figures."""
    return {f"{prefix}{i}": {f"p{j}": (mean[j] + rng.normal(0.0, np.hypot(scatter, std)), std, "")
                             for j in range(len(mean))} for i in range(count)}


@pytest.mark.slow
@pytest.mark.parametrize("count, std", [(10, 0.1), (10, 1.5), (3, 0.5), (2, 0.5)])
def test_equal_machines_are_rarely_reported_as_different(count, std):
    """Whatever part of what varies is noise, and however few recordings there are."""
    rng, alarms, sets = np.random.default_rng([count, int(10 * std)]), 0, 500
    for _ in range(sets):
        figures = group(rng, "a", count, np.zeros(4), 1.5, std) | group(rng, "b", count, np.zeros(4), 1.5, std)
        found = between_machines("oe", figures, {m: [r for r in figures if r[0] == m] for m in "ab"})
        assert len(found) == 4
        alarms += any(d.differs for d in found)
    assert alarms <= 0.08 * sets  # 5 % and three standard deviations


def test_machines_that_differ_are_reported():
    rng, right, sets = np.random.default_rng(6), 0, 200
    for _ in range(sets):
        figures = group(rng, "a", 10, np.zeros(4), 1.5, 0.2)
        figures |= group(rng, "b", 10, np.array([0, 3.0, 0, 0]), 1.5, 0.2)
        found = between_machines("oe", figures, {m: [r for r in figures if r[0] == m] for m in "ab"})
        right += {d.name for d in found if d.differs} == {"p1"}
    assert right >= 0.84 * sets  # 0.92 by the noncentral t, and four standard deviations


def test_records_differ_where_machines_do_not():
    """Two days of one machine: the noise within the recordings does not explain it, the days do."""
    rng = np.random.default_rng(8)
    figures = group(rng, "a", 5, np.zeros(2), 1.5, 0.05) | group(rng, "b", 5, np.zeros(2), 1.5, 0.05)
    machines = {m: [r for r in figures if r[0] == m] for m in "ab"}
    assert any(d.differs for d in differences("oe", figures))
    assert not any(d.differs for d in between_machines("oe", figures, machines))


def test_a_figure_of_one_recording_is_not_compared():
    rng = np.random.default_rng(9)
    figures = group(rng, "a", 3, np.zeros(2), 1.0, 0.1) | group(rng, "b", 3, np.zeros(2), 1.0, 0.1)
    for name in ("b0", "b1"):
        figures[name]["p0"] = (0.0, None, "")
    found = between_machines("oe", figures, {m: [r for r in figures if r[0] == m] for m in "ab"})
    assert {d.name for d in found} == {"p1"}


@pytest.mark.slow
def test_what_differs_is_said_of_machines():
    worn = replace(SERVO, coulomb=(0.016,))
    days = [servo(s, name=f"a{s}") for s in (1, 11, 21)] + [servo(s, worn, f"b{s}") for s in (31, 41, 51)]
    start = one_body().with_values({"motor.inertia": 3e-4})
    found = compare(days, start, CompareOptions(("physical-innovations",),
                                                machines={"A": (0, 1, 2), "B": (3, 4, 5)}))
    assert {d.name for d in found.differences if d.differs} == {"motor.coulomb"}
    assert {(d.first, d.second) for d in found.differences} == {("A", "B")}
    finding, = [f for f in found.findings if f.code == "parameters-differ"]
    assert "machine" in finding.text


@pytest.mark.slow
def test_friction_that_another_record_shows_is_free_in_all():
    """A record that hardly turns back: without dry friction its inertia would be twice as large, and sure of it."""
    found = compared(*(record("x", seed, 3.0, coulomb=0.42) for seed in (45, 55, 65)))
    inertia = next(s for s in found.spread if s.name == "motor.inertia")
    assert inertia.values == pytest.approx([0.02] * 3, rel=0.01)
