"""A third mass: split off, gone back to where it was, and none where only the start swings out."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.model import Model, all_samples, fit, fit_from_start
from drivetool.check.fit.structure import (
    transferred_point,
    with_end_mass,
    with_intermediate_mass,
    with_large_end_mass,
    without_end_mass,
    without_third_mass,
)
from drivetool.check.search.candidate_fit import CandidateFit, screened_for_significance
from drivetool.drive import Assembly, Layout, resonances
from drivetool.identify.setup import Task, problem_of, roles_of
from tests.recover import STEP, drive_like, experiment, linear_record, resonance
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

FREE = ("motor.inertia", "load.inertia", "motor.viscous", "load.viscous", "load.idle_torque", "shaft.stiffness",
        "shaft.damping")


def model_of(record, machine):
    drive = drive_like(machine, list(FREE))
    return fit_from_start(Task(drive, FREE, roles_of([record], drive), (record,)))


@pytest.fixture(scope="module")
def base():
    machine = machine_by_seed(20)
    return model_of(linear_record(machine, 20, duration=4.0), machine)


def test_a_third_mass_goes_back_to_where_it_was_split_off(base):
    longer = with_end_mass(base, 0.3, 3.0, 0.05)
    drive = longer.drive.with_values({"tip.coulomb": 0.3, "load.coulomb": 0.2, "tip.drag": 0.01,
                                      "motor.drag": 0.02})
    longer = Task(drive, (*longer.free, "tip.drag"), longer.roles, longer.experiments)
    back = without_end_mass(longer, base.task.drive)
    before = base.fitted.drive
    assert back.drive.bodies == before.bodies and set(back.free) == {*FREE, "load.drag"}
    added = {"load.coulomb": 0.5, "load.drag": 0.01, "motor.drag": 0.02}
    for name, value in (dict(before.values) | added).items():
        assert back.drive.value(name) == pytest.approx(value, rel=1e-12), name


@pytest.mark.parametrize(("times", "ratio"), [(1.8, 1.0), (4.0, 5.0)])
def test_a_large_third_mass_leaves_what_the_record_identifies(base, times, ratio):
    """Resonance, anti-resonance and all inertia; behind a gear too. Closed form against eigenvalues."""
    before = base.task.drive.with_values({**base.fitted.drive.values, "shaft.ratio": ratio})
    point = replace(base.point, values=np.array([before.value(n) for n in base.task.free]))
    geared = replace(base, task=replace(base.task, drive=before), point=point)
    after = with_large_end_mass(geared, 0.3, times, 0.05).drive
    inertia, lowest = [], []
    for drive in (before, after):
        still = drive.with_values({f"{s}.damping": 0.0 for s in drive.shafts} | {
            f"{b}.viscous": 0.0 for b in drive.bodies})
        lowest.append([min(m.frequency_hz for m in resonances(still) if m.kind == kind)
                       for kind in ("resonance", "anti-resonance")])
        inertia.append(sum(drive.value(f"{b}.inertia") / t**2 for b, t in zip(
            drive.bodies, drive.gear_ratios(), strict=True)))
    np.testing.assert_allclose(lowest[1], lowest[0], rtol=1e-6)
    assert inertia[1] == pytest.approx(inertia[0], rel=1e-12)
    load, tip = (after.value(f"{b}.inertia") for b in ("load", "tip"))
    assert tip / (load + tip) == pytest.approx(0.3, rel=1e-12)


@pytest.mark.parametrize("place", [0.2, 0.7])
def test_a_mass_in_the_shaft_leaves_the_resonance_where_it_is_and_goes_back(base, place):
    longer, before = with_intermediate_mass(base, 0.3, place), base.fitted.drive
    assert longer.drive.bodies == ("motor", "middle", "load") and set(longer.free) > set(FREE)
    hertz = [min(m.frequency_hz for m in resonances(d.with_values({f"{s}.damping": 0.0 for s in d.shafts}))
                 if m.kind == "resonance") for d in (longer.drive, before)]
    assert hertz[0] == pytest.approx(hertz[1], rel=1e-6)
    one, other = (longer.drive.value(f"{s}.stiffness") for s in longer.drive.shafts)
    assert other / (one + other) == pytest.approx(place, rel=1e-12)
    back = without_third_mass(longer, before)
    assert back.drive.bodies == before.bodies and set(back.free) == {*FREE}
    assert back.drive.value("load.inertia") == pytest.approx(before.value("load.inertia"), rel=1e-12)
    assert back.drive.value("shaft.stiffness") == pytest.approx(one * other / (one + other), rel=1e-12)
    problem = problem_of(longer.drive, longer.free, longer.roles, base.problem.traces)
    names, start = problem.states, transferred_point(base, longer, problem).starts[0]
    twists = [start[names.index(f"{s}.twist")] for s in longer.drive.shafts]
    assert sum(twists) == pytest.approx(base.point.starts[0][base.problem.states.index("shaft.twist")])
    assert twists[0] == pytest.approx(place * sum(twists))


def test_the_sensors_of_the_load_stay_where_they_were_whatever_the_load_is_called(base):
    task = with_end_mass(base, 0.3, 3.0, 0.05)
    for last in ("load", "wheels"):
        drive = replace(task.drive, bodies=("motor", last, "tip"), values={
            n.replace("load.", f"{last}."): v for n, v in task.drive.values.items()})
        assembly = Assembly(drive, Layout((), ("motor_torque",), ("load_speed",), STEP, gradient=False))
        assert assembly.body_of("load_speed") == 1 and drive.load == last


def test_a_swing_from_the_start_is_no_third_mass():
    """A disturbance that dies away is what a mass without inertia leaves that was wound up at the start."""
    machine, size = machine_by_seed(20), 6000
    t, rated = STEP * np.arange(size), machine_by_seed(20).rated_torque
    torque = multisine(np.linspace(0.05, 1.5, 12) * resonance(machine), 0.1 * rated, size * STEP, STEP, 20)[:size]
    swing = 0.05 * rated * np.exp(-t / 2.0) * np.sin(2.0 * np.pi * 0.4 * t)
    run = simulate_linear(machine, torque, STEP, None, swing + white_noise(size, 0.003 * rated, 1))
    speed = run.speeds[:, 0]
    base = model_of(experiment(torque, speed + white_noise(size, 2e-3 * np.abs(speed).max(), 2)), machine)
    masks = all_samples(base.problem)
    task = with_end_mass(base, 0.003, 0.4 / resonance(machine), 0.2)
    problem = problem_of(task.drive, task.free, task.roles, base.problem.traces)
    model = fit(Model("third-mass", task, problem, transferred_point(base, task, problem), base.noise), masks)
    assert model.value < base.value - 100.0
    assert screened_for_significance(CandidateFit(CAUSES["third-mass"], model, {}), base).absent == "no-gain"
