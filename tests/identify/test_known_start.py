"""Known start states: not estimated by a fit, and contradicted where a record does not begin so."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body, two_mass
from drivetool.drive.chain import three_mass
from drivetool.errors import BadOption
from drivetool.identify.backlash.estimator import backlash
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.noise.noise import Noise
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import (
    UNNAMED_RECORDINGS,
    Roles,
    first_point,
    measured_states,
    roles_of,
    traces_of,
)
from drivetool.identify.setup.start import KnownStart, known_states
from drivetool.identify.setup.task import Task
from drivetool.identify.starts.process_noise_continuation import choose_gap_sides, frozen_observers
from drivetool.logs import Experiment
from tests.recover import STEP, drive_like, experiment, joint_error, truth
from tests.simulator.experiments import alternating, multisine
from tests.simulator.machine import Machine, State, at_rest, running
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate, simulate_linear

MACHINE = Machine((0.4, 1.2), (0.05, 0.1), stiffness=(800.0,), damping=(0.6,), rated_torque=20.0)
FREE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "total.viscous")
REST = KnownStart(rest=True)
SPEED = Roles(("motor_torque",), ("motor_speed",))


def record(start: State, size: int = 800, seed: int = 3) -> Experiment:
    """A short excited record with noise of torque and sensor."""
    torque = multisine(np.arange(1.0, 14.0, 1.5), 5.0, size * STEP, STEP, seed)[:size] + 2.0
    run = simulate_linear(MACHINE, torque, STEP, start, white_noise(size, 0.5, 7 * seed))
    return experiment(torque, run.speeds[:, 0] + white_noise(size, 0.01, 7 * seed + 1))


def fitted(data: Experiment, start: KnownStart, criterion: str = "innovations"):
    options = Options(start=start, criterion=criterion, segment=0.0, hold=("total.idle_torque",))
    return greybox([data], drive_like(MACHINE, [*FREE[:4], "total.viscous"], 0.1), options)


def codes(estimate) -> set[str]:
    return {f.code for f in estimate.findings}


@pytest.fixture(scope="module")
def resting():
    """(a record from rest, fitted with its start known, and with it free)."""
    data = record(at_rest(MACHINE))
    return fitted(data, REST), fitted(data, KnownStart())


@pytest.mark.slow
def test_a_known_start_narrows_the_intervals_and_they_hold_the_truth(resting):
    known, free = ({p.name: p for p in e.parameters} for e in resting)
    ratios = {n: known[n].std / free[n].std for n in FREE[:4]}
    assert max(ratios.values()) < 1.02, ratios  # the noise is estimated anew
    assert ratios["load.inertia"] < 0.95
    square, limit = joint_error(resting[0], truth(MACHINE))
    assert square < limit


def test_the_file_says_which_states_were_known(resting):
    known, free = resting
    assert known.details["known_start"] == {"motor.speed": 0.0, "load.speed": 0.0, "shaft.twist": 0.0}
    assert "known_start" not in free.details and "held-value-rejected" not in codes(known)


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["innovations", "simulation"])
def test_a_record_that_does_not_begin_so_contradicts_it(criterion):
    moving = record(running(MACHINE, 2.0))
    wrong = next(f for f in fitted(moving, REST, criterion).findings if f.code == "held-value-rejected")
    assert wrong.severity == "warning"
    assert 1.8 < float(wrong.text.split("motor.speed is ")[1].split()[0]) < 2.2
    assert wrong.evidence["motor.speed over std"] > 8.0
    right = KnownStart(states={"motor.speed": 2.0, "load.speed": 2.0})
    assert "held-value-rejected" not in codes(fitted(moving, right, criterion))


def test_standstill_by_friction_hides_no_contradiction():
    """A stuck body has no derivative over its speed, whatever the record contains."""
    t = np.arange(600) * STEP
    torque = 4.0 + 3.0 * np.sin(20.0 * t)
    start = one_body().with_values({"motor.inertia": 0.5, "motor.viscous": 0.5, "motor.coulomb": 1.0})
    speed = 1.5 + np.cumsum(torque - 2.0) * STEP / 0.5 + white_noise(600, 0.01, 2)
    options = Options(start=REST, criterion="simulation", segment=0.0)
    found = [f for f in greybox([experiment(torque, speed)], start, options).findings
             if f.code == "held-value-rejected"]
    assert len(found) == 1 and "motor.speed is 1.4" in found[0].text


@pytest.mark.slow
def test_of_a_gap_the_side_on_which_a_record_begins_may_be_known():
    machine = replace(MACHINE, half_gap=(0.02,), idle_torque=(0.0, 2.0))
    torque = alternating(2.0, (5.0, 8.0), (0.1, 0.2), 4, 0.1, STEP, 3)
    twist = 0.02 + 2.0 / 800.0
    start_state, noise = State((0.0, 0.0), (twist,), 0.0, 2.0), white_noise(len(torque), 0.02, 25)
    run = simulate(machine, torque, STEP, start_state, None, noise)
    data = experiment(torque, run.speeds[:, 0] + white_noise(len(torque), 0.002, 26))
    drive = two_mass().with_values(truth(machine) | {"shaft.half_gap": 0.0})
    start = KnownStart(True, {"shaft.twist": twist})
    estimate = backlash([data], drive, Options(start=start))
    gap = next(p for p in estimate.parameters if p.name == "shaft.half_gap")
    assert gap.ci95[0] <= 0.02 <= gap.ci95[1] and "held-value-rejected" not in codes(estimate)
    known = known_states(start, drive, (), SPEED)
    task = Task(drive.with_values({"shaft.half_gap": 0.02}), (), SPEED, (data,), known)
    problem = task.problem()
    point = first_point(task.drive, problem, SPEED)
    gains = frozen_observers(problem, task.linear_problem(), point, Noise(5.0, None, np.ones(1)))
    assert choose_gap_sides(problem, point, gains).starts[0][2] == twist


@pytest.mark.parametrize("values, free, inputs, known", [
    ({}, (), ("motor_torque",), True),
    ({"motor.coulomb": 1.0, "load.viscous": 1.0}, ("motor.coulomb",), ("motor_torque",), True),
    ({"load.coulomb": 1.0}, (), ("motor_torque",), False),
    ({}, ("load.coulomb",), ("motor_torque",), False),
    ({"total.idle_torque": 1.0}, (), ("motor_torque",), False),
    ({}, ("shaft.half_gap",), ("motor_torque",), False),
    ({}, (), ("motor_torque", "load_torque"), False)])
def test_a_twist_at_rest_is_known_where_nothing_beyond_it_holds_or_pulls(values, free, inputs, known):
    drive = two_mass().with_values({"motor.inertia": 1.0, "load.inertia": 1.0, "shaft.stiffness": 1.0, **values})
    roles = Roles(inputs, ("motor_speed",))
    found = known_states(REST, drive, free, roles)
    assert found[UNNAMED_RECORDINGS] == {"motor.speed": 0.0,
                                         "load.speed": 0.0} | ({"shaft.twist": 0.0} if known else {})
    stated = known_states(KnownStart(True, {"shaft.twist": 0.3, "load.speed": 1.0}), drive, free, roles)
    assert stated == {UNNAMED_RECORDINGS: {"motor.speed": 0.0, "load.speed": 1.0, "shaft.twist": 0.3}}


def test_behind_the_first_shaft_a_twist_at_rest_is_checked_shaft_by_shaft():
    drive = three_mass().with_values({**{f"{b}.inertia": 1.0 for b in ("motor", "gear", "arm")},
                                      "shaft.stiffness": 1.0, "shaft2.stiffness": 1.0, "gear.coulomb": 1.0})
    assert set(known_states(REST, drive, (), SPEED)[UNNAMED_RECORDINGS]) == {
        "motor.speed", "gear.speed", "arm.speed", "shaft2.twist"}


def test_it_holds_where_a_recording_begins_and_nowhere_else():
    drive = drive_like(MACHINE, list(FREE))
    data = replace(record(at_rest(MACHINE)), segments=((0, 300), (320, 800)))
    known = known_states(REST, drive, FREE, SPEED)
    task = Task(drive, FREE, SPEED, (data, replace(data, name="other")), known)
    for segment, pieces in ((0.0, 4), (0.1, 16)):
        problem = task.problem(segment)
        assert len(problem.traces) == pieces
        assert [i for i, t in enumerate(problem.traces) if t.start] == [0, pieces // 2]
        assert problem.unknowns == len(FREE) + 3 * pieces - 6
    short = replace(data, segments=((0, 5), (20, 800)))
    assert not traces_of([short], SPEED, 0.0, known)[0].start


def test_known_states_stay_and_have_no_slope():
    drive = drive_like(MACHINE, list(FREE))
    start = {UNNAMED_RECORDINGS: {"motor.speed": 0.25, "shaft.twist": 0.001}}
    task = Task(drive, FREE, SPEED, (record(at_rest(MACHINE)),), start)
    problem = task.problem()
    point = first_point(drive, problem, SPEED)
    assert point.starts[0].tolist() == [0.25, 0.25, 0.001]  # the load goes with the motor
    normal = problem.normal(point)
    assert normal.own_slope[0][[0, 2]].tolist() == [0.0, 0.0] and normal.own_slope[0][1] != 0.0
    assert np.flatnonzero(normal.own[0].any(axis=0)).tolist() == [1]


def test_an_angle_may_be_known_where_it_matters():
    drive = one_body().with_values({"motor.inertia": 1.0})
    start = KnownStart(states={"motor.angle": 0.5})
    angle = Roles(("motor_torque",), ("motor_angle",))
    assert known_states(start, drive, (), angle) == {UNNAMED_RECORDINGS: {"angle": 0.5}}
    # It is measured, with noise.
    assert known_states(REST, drive, (), angle) == {UNNAMED_RECORDINGS: {"motor.speed": 0.0}}
    with pytest.raises(BadOption, match="does not depend on the angle"):
        known_states(start, drive, (), SPEED)


@pytest.mark.parametrize("states, message", [
    ({"motor.sped": 1.0}, "Did you mean 'motor.speed'"),
    ({"wheel": 0.0}, r"Known are: rest, motor\.speed, motor\.angle"),
    ({"motor.speed": np.nan}, "finite start value of motor.speed"), ({"motor.speed": np.inf}, "finite")])
def test_a_state_that_cannot_be(states, message):
    with pytest.raises(BadOption, match=message):
        known_states(KnownStart(states=states), one_body().with_values({"motor.inertia": 1.0}), (), SPEED)


def test_the_frequency_domain_knows_no_start():
    drive = drive_like(MACHINE, list(FREE))
    with pytest.raises(BadOption, match="--criterion innovations"):
        greybox([record(at_rest(MACHINE))], drive, Options(start=REST, criterion="frequency"))


@pytest.mark.parametrize("role", ["motor_speed", "motor_angle"])
def test_the_speed_of_the_first_sample_is_read_off_an_acceleration(role):
    t = np.arange(200) * STEP
    signals = {"motor_torque": np.ones(200), "motor_speed": 0.3 + 5.0 * t,
               "motor_angle": 2.0 + 0.3 * t + 2.5 * t**2}
    data = Experiment("r", "r", STEP, 0.0, {n: signals[n] for n in ("motor_torque", role)}, ((0, 200),))
    drive = one_body().with_values({"motor.inertia": 0.2})
    roles = roles_of([data], drive)
    state, = measured_states(drive, roles, traces_of([data], roles))
    assert state[0] == pytest.approx(0.3, rel=1e-6)
