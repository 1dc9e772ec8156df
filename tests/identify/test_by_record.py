"""Parameters that differ between recordings of one machine: given or fitted, and their start states."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivetool.drive import one_body, state_space, two_mass
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.problem.problem import Point
from drivetool.identify.setup.by_record import as_recorded, shared_free_names
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import UNNAMED_RECORDINGS, first_point, problem_of, roles_of, traces_of
from drivetool.identify.setup.start import KnownStart
from drivetool.identify.setup.task import Task, has_gap
from drivetool.logs import recording_number
from tests.identify.loop import MACHINES, loop_record
from tests.recover import experiment, reversing_record
from tests.simulator.machine import Machine

AXIS = MACHINES[0]
NAMES = ("a", "b", "c")


@cache
def record(name, seed, seconds=6.0, **differing):
    values = {"inertia": 0.02, "viscous": 0.01, "coulomb": 0.3, "idle_torque": 0.05, **differing}
    machine = Machine(**{k: (v,) for k, v in values.items()}, rated_torque=4.0)
    noise = values["inertia"]  # of the sensor: the same in every recording, whatever speed the machine comes to
    return renamed_record(reversing_record(machine, seed, seconds, speed_noise=noise)[0], name)


def renamed_record(made, name):
    return replace(made, name=name, sha256=name * 64)


def drive_of(values, names=NAMES, base=None):
    drive = replace(base or one_body(), records={n: n * 64 for n in names})
    return drive.with_values({"motor.inertia": 0.03, **values})


def lines_of(estimate):
    return {p.name: p for p in estimate.parameters}


def test_a_record_has_its_own_value_and_the_others_share_one():
    drive = drive_of({"motor.coulomb": 0.3, "motor.coulomb@b": 0.5, "motor.added_inertia@c": 0.01})
    free = ("motor.inertia", "motor.coulomb", "motor.coulomb@b")
    seen = {n: as_recorded(drive, free, recording_number(n * 64)) for n in (*NAMES, "z")}
    assert [d.value("motor.coulomb") for d, _ in seen.values()] == [0.3, 0.5, 0.3, 0.3]
    assert [d.inertias() for d, _ in seen.values()] == [[0.03], [0.03], [0.04], [0.03]]
    assert seen["a"][1] == free and seen["b"][1].index("motor.coulomb") == 2


def test_a_name_that_ends_like_another_is_another():
    drive = drive_of({"motor.coulomb@run@b": 0.9, "motor.coulomb": 0.3}, names=("b", "run@b"))
    assert as_recorded(drive, (), recording_number("b" * 64))[0].value("motor.coulomb") == 0.3


def test_a_gap_of_one_recording_opens_no_linear_drive():
    values = {"load.inertia": 0.05, "shaft.stiffness": 200.0, "shaft.damping": 0.1}
    plain = drive_of(values, base=two_mass())
    gap = plain.with_values({"shaft.half_gap@b": 0.05, "motor.coulomb@b": 0.1})
    np.testing.assert_array_equal(state_space(gap)[0], state_space(plain)[0])
    assert has_gap(Task(gap, (), roles_of([record("a", 1, 0.5)], gap), ()))


@pytest.mark.parametrize("base, more", [
    (one_body(), {"motor.coulomb@b": 0.5, "motor.added_inertia@c": 0.01, "friction.factor@c": 1.3}),
    (two_mass().with_values({"load.inertia": 0.05, "shaft.stiffness": 200.0, "shaft.damping": 0.1}),
     {"shaft.stiffness@b": 150.0, "load.coulomb@c": 0.2, "load.viscous@b": 0.03})])
def test_sensitivities_are_differences(base, more):
    """Of every column, in every recording, by moving the value a little."""
    records = [record(n, seed, 0.5) for seed, n in enumerate(NAMES, 1)]
    drive = drive_of({"motor.viscous": 0.02, "motor.coulomb": 0.1, **more}, base=base)
    free = ("motor.inertia", "motor.coulomb", *more)
    free = (*free, *{n.partition("@")[0] for n in more} - set(free) - {"friction.factor", "motor.added_inertia"})
    roles = roles_of(records, drive)
    problem = problem_of(drive, free, roles, traces_of(records, roles))
    point = first_point(drive, problem, roles)
    assert tuple(trace.name for trace in problem.traces) == NAMES
    for i, (trace, plant) in enumerate(zip(problem.traces, problem.plants(point.values, True), strict=True)):
        slopes = plant.jacobian(trace, point.starts[i])[1][:, 0, :len(free)]
        for j, name in enumerate(free):
            step = 1e-5 * max(abs(point.values[j]), 1e-3)
            ends = []
            for sign in (1.0, -1.0):
                values = point.values.copy()
                values[j] += sign * step
                moved = problem.plants(values, False)[i]
                ends.append(moved.outputs(trace, point.starts[i])[:, 0])
            found = (ends[0] - ends[1]) / (2.0 * step)
            room = 2e-3 * max(np.abs(found).max(), 1e-6)
            np.testing.assert_allclose(slopes[:, j], found, atol=room, err_msg=name)
            foreign = name.partition("@")[2] not in ("", trace.name)
            hidden = f"{name}@{trace.name}" in free or f"{name}@{trace.name}" in drive.values
            assert (np.abs(slopes[:, j]).max() == 0.0) == (foreign or hidden), name


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["auto", "simulation", "inverse"])
def test_what_differs_is_found_and_what_is_shared_is_not_bent(criterion):
    records = [record("a", 1), record("b", 2, inertia=0.026), record("c", 3, coulomb=0.42)]
    drive = drive_of({"motor.added_inertia@b": 0.006, "motor.coulomb": 0.2, "motor.coulomb@c": 0.2})
    found = lines_of(greybox(records, drive, Options(criterion=criterion, free=("motor.coulomb@c",))))
    true = {"motor.inertia": 0.02, "motor.coulomb": 0.3, "motor.coulomb@c": 0.42, "motor.viscous": 0.01}
    for name, value in true.items():
        assert abs(found[name].value - value) < max(4.0 * found[name].std, 0.002 * value), name
        assert found[name].std < 0.02 * value
    assert found["motor.added_inertia@b"].status == "held" and found["motor.added_inertia@b"].value == 0.006
    bent = lines_of(greybox(records, drive_of({}), Options(criterion=criterion)))
    assert abs(bent["motor.coulomb"].value - 0.3) > 0.01


@pytest.mark.slow
def test_a_mass_that_is_added_is_weighed():
    """The payload of the second recording, with the inertia of the first."""
    records = [record("a", 1), record("b", 2, inertia=0.026)]
    drive = drive_of({"motor.added_inertia@b": 0.0})
    line = lines_of(greybox(records, drive, Options(free=("motor.added_inertia@b",))))["motor.added_inertia@b"]
    assert abs(line.value - 0.006) < 4.0 * line.std and line.std < 1e-4


def test_one_factor_on_all_friction():
    records = [record("a", 1), record("b", 2, viscous=0.013, coulomb=0.39)]
    line = lines_of(greybox(records, drive_of({"friction.factor@b": 1.0}), Options(free=("friction.factor@b",))))
    assert abs(line["friction.factor@b"].value - 1.3) < 4.0 * line["friction.factor@b"].std
    assert line["friction.factor@b"].std < 0.02


def test_a_value_that_every_recording_has_for_itself_is_no_unknown_of_all():
    records = [record("a", 1), record("b", 2, coulomb=0.42)]
    drive = drive_of({"motor.coulomb@a": 0.1, "motor.coulomb@b": 0.1})
    assert shared_free_names(("motor.coulomb", "motor.inertia"), drive, records) == ("motor.inertia",)
    assert shared_free_names(("motor.coulomb",), drive, [*records, record("c", 3)]) == ("motor.coulomb",)
    found = lines_of(greybox(records, drive, Options(free=("motor.coulomb@a", "motor.coulomb@b"))))
    assert found["motor.coulomb@a"].value == pytest.approx(0.3, abs=4.0 * found["motor.coulomb@a"].std)
    assert found["motor.coulomb@b"].value == pytest.approx(0.42, abs=4.0 * found["motor.coulomb@b"].std)


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["auto", "inverse"])
def test_a_recording_that_does_not_identify_what_is_freed_in_it(criterion):
    """One way at one speed: dry friction and idle torque are one there."""
    rng = np.random.default_rng(3)
    speed = 5.0 + 1e-3 * rng.standard_normal(4000)
    steady = renamed_record(experiment(np.full(4000, 0.4), speed), "b")
    drive = drive_of({"motor.inertia@b": 0.03})
    estimate = greybox([record("a", 1), steady], drive, Options(criterion=criterion, free=("motor.inertia@b",)))
    line = lines_of(estimate)["motor.inertia@b"]
    said = [f.text for f in estimate.findings if f.code == "not-identifiable"]
    assert line.status == "not-identifiable" and line.std is None
    assert len(said) == 1 and "motor.inertia@b" in said[0]


@pytest.mark.slow
def test_every_recording_begins_in_its_own_state():
    """One from rest, one in motion: to take both for at rest bends the fit."""
    whole = record("a", 1)
    later = replace(whole.between(2.0, 6.0), name="b", sha256="b" * 64)
    assert abs(later.signals["motor_speed"][0]) > 1.0
    drive = drive_of({})
    each = {recording_number("b" * 64): KnownStart()}
    one = greybox([whole, later], drive, Options(start=KnownStart(rest=True, records=each)))
    wrong = greybox([whole, later], drive, Options(start=KnownStart(rest=True)))
    line = lines_of(one)["motor.inertia"]
    assert abs(line.value - 0.02) < 4.0 * line.std
    assert "held-value-rejected" in {f.code for f in wrong.findings} - {f.code for f in one.findings}
    assert one.details["known_start"] == {"motor.speed": 0.0, "b": {}}
    known = {recording_number("b" * 64): KnownStart(states={"motor.speed": float(later.signals["motor_speed"][0])})}
    given = greybox([whole, later], drive, Options(start=KnownStart(records=known)))
    assert "held-value-rejected" not in {f.code for f in given.findings}


def test_a_trace_takes_the_state_of_its_recording():
    records = [record("a", 1, 0.5), record("b", 2, 0.5)]
    drive = drive_of({})
    roles = roles_of(records, drive)
    traces = traces_of(records, roles, 0.0,
                       {UNNAMED_RECORDINGS: {"motor.speed": 0.0}, records[1].number: {"motor.speed": 2.0}})
    problem = problem_of(drive, ("motor.inertia",), roles, traces)
    starts = first_point(drive, problem, roles).starts
    assert [s[0] for s in starts] == [0.0, 2.0] and isinstance(Point(np.zeros(1), starts), Point)


@pytest.mark.slow
def test_an_axis_with_instruments_and_another_load():
    """The inverse fit with the reference, a known inertia on the second recording."""
    heavy = replace(AXIS, values=(1.5 * AXIS.values[0], *AXIS.values[1:]))
    records = [renamed_record(loop_record(AXIS, 1, 0.01), "a"), renamed_record(loop_record(heavy, 2, 0.01), "b")]
    drive = drive_of({"motor.added_inertia@b": 0.5 * AXIS.values[0]}, base=AXIS.start)
    found = lines_of(greybox(records, drive, Options(criterion="inverse")))
    for name, true in AXIS.truth.items():
        assert abs(found[name].value - true) < 4.0 * found[name].std, name
    assert found["motor.inertia"].std < 0.01 * AXIS.values[0]
