"""Laws that the motion predicts: found where the drive lacks them, and not where it lacks nothing."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.laws.law_selection import FOLDS, _sums, select_laws, with_laws
from drivetool.identify.laws.laws import MEASUREMENT_NOISE, law_library, measurement_noise_law
from drivetool.identify.motion.motion import motions_of
from drivetool.identify.noise.log_noise import expected_recording_noise
from drivetool.identify.noise.noise import filtered
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.recover import experiment
from tests.study.missing_laws.record import arrange, draw, simulate

NAMES = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")


def task_of(machine, step, torque, role, measured):
    made = experiment(torque, measured, step=step)
    made = replace(made, signals={"motor_torque": torque, role: measured})
    drive = one_body().with_values(dict(zip(NAMES, machine.numbers().tolist(), strict=True)))
    return Task(drive, NAMES, roles_of([made], drive), (made,))


def drawn(*args):
    r = draw(*args, 4.0)
    return task_of(r.machine, r.step, r.torque, r.role, r.measured)


def every(task):
    seen = motions_of(task.experiments, task.roles.outputs[0])
    return [*measurement_noise_law(expected_recording_noise(task.experiments, "motor_torque")),
            *law_library(seen, True)]


def searched(task):
    fit = by_innovations(task, [{}])
    laws, factors = select_laws(task, fit.solution.point, fit.fit.noise, every(task))
    return [law.name for law in laws], factors


@pytest.mark.parametrize("number, seed", [(0, 50), (2, 52)])
def test_cogging_is_found_first_with_its_order_and_size(number, seed):
    setup, law, _ = arrange("cogging", 0.05, number, seed, 4.0)
    law = replace(law, constants={**law.constants, "periods": 7.0})
    run = simulate(setup, law)
    role = "motor_angle" if setup.is_angle else "motor_speed"
    names, factors = searched(task_of(setup.machine, setup.step, run.torque, role, run.measured))
    assert names[0] == "torque ripple of order 7"
    assert np.hypot(*factors[:2]) == pytest.approx(law.strength / np.sqrt(2.0), rel=0.1)


@pytest.mark.parametrize("number, seed", [(0, 50), (1, 51), (2, 52), (0, 60), (5, 61), (7, 62)])
def test_nothing_is_found_where_the_model_is_right(number, seed):
    assert searched(drawn("white", "", number, seed))[0] == []


def test_noise_that_feedback_puts_on_the_torque_drives_the_machine():
    # A drive in closed loop behind a coarse sensor: its own noise comes back with the torque.
    assert MEASUREMENT_NOISE not in searched(drawn("white", "", 3, 63))[0]


def test_noise_of_the_log_is_found_as_what_does_not_drive_the_machine():
    task = drawn("log-noise", "L", 2, 52)
    names, factors = searched(task)
    assert names[0] == MEASUREMENT_NOISE
    true = 0.15 * draw("log-noise", "L", 2, 52, 4.0).truth.rated
    assert factors[0] == pytest.approx(true, rel=0.3)


def test_factors_make_up_for_the_law_by_its_sign():
    # A drive without its friction over the square of the speed: with the factors the one-step errors are gone.
    task = drawn("quiet", "", 2, 52)
    law = next(x for x in every(task) if x.name == "friction that grows with the square of the speed")
    e = task.experiments[0]
    torque, true = e.signals["motor_torque"], 0.1 * np.std(e.signals["motor_torque"])
    braked = torque + true * np.nan_to_num(law.columns[0][:, 0])
    task = replace(task, experiments=(replace(e, signals={**e.signals, "motor_torque": braked}),))
    fit = by_innovations(task, [{}])
    _, factors = select_laws(task, fit.solution.point, fit.fit.noise, [law])
    assert factors == pytest.approx([true], rel=0.2)


def test_a_law_is_an_input_with_a_factor():
    task = drawn("quiet", "", 2, 52)
    two = every(task)[-2:]
    found = with_laws(with_laws(task, two[:1], factors=(3.0, 4.0)), two[1:])
    names = tuple(f"motor.law{i}" for i in (1, 2, 3, 4))
    assert found.free == (*NAMES, *names) and found.roles.inputs == ("motor_torque", *names)
    assert [found.drive.values[n] for n in names] == [3.0, 4.0, 0.0, 0.0]
    assert all(np.isfinite(found.experiments[0].signals[n]).all() for n in names)
    assert with_laws(task, ()) is task


@pytest.mark.parametrize("memory", [None, 0.9])
def test_sums_by_block_are_those_of_dense_algebra(memory):
    r = draw("white", "", 2, 52, 4.0)
    n = 600
    halves = [task_of(r.machine, r.step, r.torque[part], r.role, r.measured[part])
              for part in (slice(0, n), slice(n, n + 371))]
    task = replace(halves[0], experiments=(halves[0].experiments[0], halves[1].experiments[0]))
    laws = [law for law in every(task) if "times" in law.name][:6]
    fit = by_innovations(task, [{}])
    point, noise = fit.solution.point, replace(fit.fit.noise, memory=memory)
    full = with_laws(task.at_point(point), laws)
    problem = full.problem().with_memory(memory)
    more = 0 if memory is None else 1
    starts = [np.append(s, np.zeros(more)) for s in point.starts]
    gains = [f.gains for f in filtered(task.problem(), point, noise)]
    blocks, width, k = [], len(full.free) + 1, 0
    expected = np.zeros((FOLDS, width, width))
    plants = problem.plants(np.array([full.drive.values[n] for n in full.free]), True)
    for trace, plant, start, gain in zip(problem.traces, plants, starts, gains, strict=True):
        _, rows = plant.jacobian(trace, start, gain)
        rows = rows[:, 0]
        states = rows[:, plant.system.nq + np.arange(plant.nx)]
        rest = np.column_stack([rows[:, :width - 1], rows[:, -1]])
        size = np.linalg.norm(states, axis=0)
        size[size == 0.0] = 1.0
        left = rest - states / size @ np.linalg.lstsq(states / size, rest, rcond=1e-9)[0]
        for i, row in enumerate(left):
            expected[(k + i) * FOLDS // (n + 371)] += np.outer(row, row)
        k += len(rows)
        blocks.append(len(rows))
    assert blocks == [n, 371]
    found = _sums(task, point, noise, laws)
    size = np.sqrt(np.einsum("fii->i", expected))
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=1e-6)
