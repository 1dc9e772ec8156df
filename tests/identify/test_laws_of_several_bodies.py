"""Laws on a body that no sensor is on: its motion, what of the drive each is, dry friction as a parameter."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.laws.candidates import candidates_of, laws_of, motions_of_bodies
from drivetool.identify.laws.laws import Law, law_library
from drivetool.identify.laws.projected_parameters import projected_within_bounds, projection_of_laws
from drivetool.identify.motion.motion import motions_of, motions_through
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.identify.swing import record, swing
from tests.recover import experiment
from tests.study.two_masses.record import STEP, draw

S = swing()
SEEN = motions_of([record(S)], "motor_speed")
RATIO = 4.0
GEARED = two_mass().with_values({"motor.inertia": 0.02, "load.inertia": 0.3, "shaft.stiffness": 900.0,
                                 "shaft.damping": 0.1, "shaft.ratio": RATIO})


def task_of(situation, size, number, seed, seconds=4.0):
    """A fit of a drawn two-mass machine, from its own values."""
    drawn = draw(situation, size, number, seed, seconds)
    made = experiment(drawn.channels["motor_torque"], drawn.channels["motor_torque"], step=STEP)
    made = replace(made, signals=dict(drawn.channels))
    drive = two_mass().with_values({n: float(v) for n, v in drawn.machine.values.items() if n != "shaft.half_gap"})
    free = tuple(n for n in drive.quantities if n in drive.values)
    return Task(drive, free, roles_of([made], drive), (made,)), drawn


def test_the_motion_by_its_speed_is_that_of_a_sensor():
    made = record(S)
    short = replace(made, segments=((0, 5), (5, 4000)))  # a stretch of five samples has no state
    found = motions_through([short], [S.speed[5:]], SEEN).each[0]
    part = slice(100, 3900)
    for name, expected in (("speed", S.mean_speed), ("acceleration", S.acceleration), ("side", S.side)):
        size = np.abs(expected).max()
        np.testing.assert_allclose(getattr(found, name)[part], expected[part], atol=0.02 * size, err_msg=name)
    turned = found.angle[part] - found.angle[100]
    np.testing.assert_allclose(turned, S.middle[part] - S.middle[100], atol=1e-3)
    assert np.isnan(found.speed[:5]).all() and not found.known[:5].any()


def test_every_law_is_on_its_body():
    task = Task(GEARED, (), roles_of([record(S)], GEARED), (record(S),))
    laws = laws_of(task, {"motor": SEEN, "load": SEEN})
    named = {law.name: law for law in laws}
    assert len(named) == len(laws)
    assert named["torque changing linearly with time, on the load"].body == "load"
    assert named["torque changing linearly with time, on the motor"].body == "motor"
    dry = [law for law in laws if law.parameter]
    assert [(law.name, law.parameter) for law in dry] == [("dry friction, on the load", "load.coulomb")]
    assert next(law.name for law in law_library(SEEN, True)) == "direction-dependent friction"


@pytest.mark.parametrize("free, part, powers", [
    (("load.viscous", "load.coulomb"), "load", (0, 0)),
    (("total.viscous", "motor.coulomb"), "motor", (2, 1))])
def test_friction_of_the_load_is_read_off_where_it_is_fitted(free, part, powers):
    """Behind a gear that turns n times slower, viscous friction counts 1 / n^2 at the motor, dry friction 1 / n."""
    viscous, dry = 0.03, 0.7
    slope, level = np.sqrt(np.mean(S.mean_speed**2)), np.sqrt(np.mean(S.side**2))
    laws = [Law("viscous", (S.mean_speed[:, None] / slope,), "friction", body="load"),
            Law("dry", (S.side[:, None] / level,), "friction", body="load")]
    drive = GEARED if part == "load" else GEARED.with_values({"total.viscous": 0.0})
    task = Task(drive, free, roles_of([record(S)], drive), (record(S),))
    own = projection_of_laws(task, laws, {"motor": SEEN, "load": SEEN}) @ [0.0, 0.0, viscous * slope, dry * level]
    assert own == pytest.approx([viscous / RATIO**powers[0], dry / RATIO**powers[1]], rel=2e-2)


def test_an_inertia_that_varies_is_the_inertia_of_its_body():
    law = Law("crank", (np.ones((4000, 1)),), "inertia", np.array([0.25]), body="load")
    task = Task(GEARED, ("motor.inertia", "load.inertia"), roles_of([record(S)], GEARED), (record(S),))
    found = projection_of_laws(task, [law], {"motor": SEEN, "load": SEEN})
    assert found.tolist() == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.25]]


def test_friction_that_falls_on_the_load_leaves_its_level():
    task = Task(GEARED, ("load.viscous", "load.coulomb"), roles_of([record(S)], GEARED), (record(S),))
    viscous, dry = projected_within_bounds(task, np.array([-0.01, 0.4]), {"motor": SEEN, "load": SEEN})
    speed = np.abs(S.mean_speed)
    moving = speed > 0.01 * SEEN.top
    assert viscous == 0.0 and dry == pytest.approx(np.mean(0.4 - 0.01 * speed[moving]), rel=1e-2)


@pytest.mark.slow
def test_the_motion_of_the_load_is_that_of_its_sensor_or_of_the_fit():
    task, _drawn = task_of("quiet", "", 2, 974)
    fit = by_innovations(task, [{}])
    seen = motions_of(task.experiments, task.roles.outputs[0])
    motions = motions_of_bodies(fit, seen)
    assert list(motions) == ["motor", "load"] and motions["motor"] is seen
    # A load on a shaft moves like its motor, but for the twist.
    both = [motions[body].each[0].speed[200:] for body in ("motor", "load")]
    assert 0.0 < np.sqrt(np.mean((both[0] - both[1]) ** 2)) < 0.5 * np.std(both[0])


@pytest.mark.slow
@pytest.mark.parametrize(("held", "freed"), [((), True), (("load.coulomb",), False)])
def test_dry_friction_of_the_load_is_freed_unless_it_is_held(held, freed):
    task, drawn = task_of("load.dry", "M", 2, 974)
    field = candidates_of(by_innovations(task, [{}]), held)
    assert ("load.coulomb" in field.task.free) == freed
    if freed:
        best = field.candidates["coloured, laws"].outcome.drive.values
        added = drawn.truth.line[1] - drawn.machine.values["motor.coulomb"]
        assert best["load.coulomb"] == pytest.approx(added, rel=0.05)
        assert best["load.inertia"] == pytest.approx(drawn.truth.load_inertia, rel=0.02)
