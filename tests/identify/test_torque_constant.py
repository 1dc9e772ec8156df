"""Inputs in A, V or % as torques: by constants that are known, and by one that is fitted."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import Drive, Layout, one_body, two_mass
from drivetool.drive.simulation import Trace, plant_of
from drivetool.errors import BadOption, BadParameters, BadRecording
from drivetool.identify.backlash.estimator import backlash
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.by_record import as_recorded
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import Roles, roles_of
from drivetool.identify.setup.torque_constant import as_torques, as_torques_for_models, check_torque_scale
from tests.frequency_response import frequency_response
from tests.identify.swing import TRUTH, record, swing
from tests.recover import STEP, drive_like, experiment, resonance, truth
from tests.simulator.experiments import multisine, steps
from tests.simulator.machine import machine_by_seed, running
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

CONSTANT, K = "motor.torque_constant", 0.35
MACHINE = machine_by_seed(5)
T = np.arange(400) * STEP
WAVE = 3.0 * np.sin(40.0 * T) + np.sign(np.sin(31.0 * T))


def logged(units, name="a", torque_unit="Nm", **signals):
    """Constant motion, and torques in their units."""
    made = experiment(WAVE, 0.0 * WAVE, name, **signals)
    return replace(made, sha256=name * 64, torque_unit=torque_unit, input_units=units)


def driven(values, base=None, unit="A"):
    return replace(base or one_body(), input_unit=unit, records={"b": "b" * 64}).with_values(
        {"motor.inertia": 0.03, **values})


def test_inputs_are_multiplied_and_the_constant_is_no_value_of_the_drive_any_more():
    made = logged({"motor_torque": "A", "reference_torque": "A"}, shaft_torque=2.0 * WAVE, reference_torque=WAVE)
    (found,), drive = as_torques([made], driven({CONSTANT: K}, two_mass()))
    for role, factor in (("motor_torque", K), ("reference_torque", K), ("shaft_torque", 2.0)):
        np.testing.assert_array_equal(found.signals[role], factor * WAVE)
    assert (found.torque_unit, found.input_units, found.unit("motor_torque")) == ("Nm", {}, "Nm")
    assert drive.constants == {CONSTANT: K} and CONSTANT not in drive.values
    assert not found.signals["motor_torque"].flags.writeable
    units = {"motor_torque": "A", "shaft_torque": "Nm", "motor_speed": "rad/s", "motor_angle": "rad"}
    assert {role: made.unit(role) for role in units} == units


@pytest.mark.parametrize("unit", ["A", "V", "%"])
def test_a_recording_in_one_such_unit_becomes_one_in_the_drives(unit):
    (found,), _ = as_torques([logged({}, torque_unit=unit)], driven({CONSTANT: K}, one_body("N", "m"), unit))
    assert found.torque_unit == "N"
    np.testing.assert_array_equal(found.signals["motor_torque"], K * WAVE)


def test_every_recording_has_its_own_value_and_its_own_unit():
    made = [logged({}, "a", "A"), logged({}, "b", "A"), logged({}, "c", "Nm")]
    found, drive = as_torques(made, driven({CONSTANT: K, f"{CONSTANT}@b": 0.4}))
    for each, factor in zip(found, (K, 0.4, 1.0), strict=True):
        np.testing.assert_array_equal(each.signals["motor_torque"], factor * WAVE)
    assert found[2] is made[2] and drive.constants == {CONSTANT: K, f"{CONSTANT}@b": 0.4}


def test_every_motor_has_its_own_constant():
    values = {CONSTANT: K, "motor2.torque_constant": 2.0}
    drive = Drive("tandem", ("motor", "motor2", "load"), ("shaft", "shaft2"), values)
    (found,), _ = as_torques([logged({}, torque_unit="A", motor2_torque=WAVE)], drive)
    np.testing.assert_array_equal(found.signals["motor2_torque"], 2.0 * WAVE)


def test_a_drive_in_amperes_and_recordings_in_torques_change_nothing():
    for made, drive in ((logged({}, torque_unit="A"), one_body("A")), (logged({}), driven({CONSTANT: K}))):
        (found,), after = as_torques([made], drive)
        assert found is made and after.constants == {n: v for n, v in drive.values.items() if n == CONSTANT}
        assert CONSTANT not in after.values


@pytest.mark.parametrize("made, drive, free, error, words", [
    (logged({}, torque_unit="A"), driven({}), (), BadParameters,
     ["a value of motor.torque_constant in Nm/A for motor_torque of a", "--set motor.torque_constant=VALUE"]),
    (logged({}, torque_unit="A"), driven({}), (CONSTANT,), BadParameters, ["a start value of motor.torque_con"]),
    (logged({}, torque_unit="A", motor2_torque=WAVE), driven({CONSTANT: K}), (), BadParameters,
     ["motor2.torque_constant", "motor2_torque"]),
    (logged({}, torque_unit="A", load_torque=WAVE), driven({CONSTANT: K}), (), BadRecording,
     ["load_torque of a in Nm", "'A'", "scale"]),
    (logged({}, torque_unit="A", shaft_torque=WAVE), driven({CONSTANT: K}), (), BadRecording,
     ["shaft_torque of a"]),
    (logged({}), driven({CONSTANT: K}), (CONSTANT,), BadOption, ["an input in A, V or %", "torques in Nm"]),
])
def test_refused(made, drive, free, error, words):
    with pytest.raises(error) as caught:
        as_torques([made], drive, free)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_without_constants_no_model_takes_torques_in_two_units():
    made = logged({"motor_torque": "A"}, shaft_torque=WAVE)
    with pytest.raises(BadRecording, match=r"motor_torque in A, shaft_torque in Nm"):
        roles_of([made], two_mass())


def speeds(drive, made, number=0):
    """Motor speed over the recording's torque."""
    layout = Layout((), ("motor_torque",), ("motor_speed",), STEP, gradient=False)
    plant = plant_of(as_recorded(drive, (), number)[0], layout)
    trace = Trace(made.signals["motor_torque"][:, None], np.zeros((len(T), 1)), STEP)
    return plant.outputs(trace, np.zeros(plant.nx))


def test_models_of_one_recording_keep_their_own_constants():
    """The recording is multiplied once; the second model contains the remaining factor."""
    made, other = logged({}, "b", "A"), driven({CONSTANT: 0.5, f"{CONSTANT}@b": 0.7, "motor.viscous": 0.1})
    (found,), drives = as_torques_for_models([made], [driven({CONSTANT: K}), other])
    alone = as_torques([made], other)
    np.testing.assert_allclose(speeds(drives[1], found, found.number), speeds(alone[1], alone[0][0]), rtol=1e-9)
    np.testing.assert_array_equal(found.signals["motor_torque"], K * WAVE)
    with pytest.raises(BadParameters, match="torques in Nm, as the first has them; found one in A"):
        as_torques_for_models([made], [driven({CONSTANT: K}), one_body("A")])


def test_of_torques_no_model_takes_its_constant():
    _, drives = as_torques_for_models([logged({})], [driven({CONSTANT: K}), driven({CONSTANT: 0.5})])
    assert [CONSTANT in d.values for d in drives] == [False, False]


@pytest.mark.parametrize("more", [
    {}, {"converter.bandwidth": 300.0}, {"converter.bandwidth": 300.0, "converter.order": 1.0},
    {"converter.bandwidth": 300.0, "converter.dead_time": 2.3 * STEP, "converter.interpolation": 0.3}])
@pytest.mark.usefixtures("code_for_any_size")
def test_another_constant_is_as_so_much_more_torque(more):
    """Simulation and exact derivatives, of one motor and of a second one; frequency response."""
    values = {"motor.inertia": 0.02, "motor2.inertia": 0.03, "load.inertia": 0.05, "shaft.stiffness": 200.0,
              "shaft.damping": 0.1, "shaft2.stiffness": 300.0, "shaft2.damping": 0.1, "motor.viscous": 0.05, **more}
    plain = Drive("tandem", ("motor", "motor2", "load"), ("shaft", "shaft2"), values)
    names = (CONSTANT, "motor2.torque_constant")
    drive = replace(plain, values=values | dict(zip(names, (0.6, 1.5), strict=True)),
                    constants=dict(zip(names, (0.5, 2.0), strict=True)))
    inputs, outputs = ("motor_torque", "motor2_torque"), ("motor_speed", "load_speed")

    def trace(*factors):
        columns = np.column_stack([f * c for f, c in zip(factors, (WAVE, np.cos(25.0 * T)), strict=True)])
        return Trace(columns, np.zeros((len(T), 2)), STEP)

    def run(drive, factors, free=()):
        plant = plant_of(drive, Layout(free, inputs, outputs, STEP, gradient=bool(free)))
        return plant, plant.outputs(trace(*factors), np.zeros(plant.nx))

    plant, found = run(drive, (1.0, 1.0), names)
    np.testing.assert_allclose(found, run(plain, (1.2, 0.75))[1], rtol=1e-9, atol=1e-9)
    slopes = plant.jacobian(trace(1.0, 1.0), np.zeros(plant.nx))[1]
    alone = [run(plain, factors)[1] for factors in ((1.0, 0.0), (0.0, 1.0))]  # linear: of each motor for itself
    for j, (own, applied) in enumerate(zip(alone, (0.5, 2.0), strict=True)):
        np.testing.assert_allclose(slopes[..., j].reshape(own.shape), own / applied, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(frequency_response(drive, np.array([3.0])), 1.2 * frequency_response(
        plain, np.array([3.0])), rtol=1e-12)


MOTION = Roles(("motor_torque",), ("motor_speed",))


@pytest.mark.parametrize("values, roles, hold", [
    ({}, MOTION, ("motor.inertia",)), ({"motor.added_inertia@b": 0.01}, MOTION, ()),
    ({"motor.coulomb": 2.0}, MOTION, ("motor.coulomb",)), ({f"{CONSTANT}@b": 0.3}, MOTION, ()),
    ({}, Roles(("motor_torque",), ("motor_speed", "shaft_torque")), ()),
    ({}, Roles(("motor_torque", "load_torque"), ("motor_speed",)), ()),
    ({}, Roles(("motor_torque", "motor2_torque"), ("motor_speed",)), ()),
])
def test_which_known_torques_identify_the_constant(values, roles, hold):
    drive, free = driven({CONSTANT: K, **values}, two_mass()), (CONSTANT, "motor.inertia", "load.inertia")
    check_torque_scale(drive, tuple(n for n in free if n not in hold), roles, hold)


@pytest.mark.parametrize("values", [{}, {"motor.coulomb": 2.0}, {"shaft.ratio": 3.0}])
def test_where_none_does_the_fit_is_refused(values):
    """A friction that was not named may come from a step that took the constant as given."""
    drive = driven({CONSTANT: K, **values}, two_mass())
    with pytest.raises(BadOption, match=r"known size beside a free motor.torque_constant; found only motor_torque"):
        check_torque_scale(drive, (CONSTANT, "motor.inertia", "load.inertia"), MOTION, ("shaft.ratio",))


def one_body_record(seed=3, **more):
    """A body with friction, its input in A, both noisy."""
    rng, made = np.random.default_rng(seed), record(swing(2000))
    torque = made.signals["motor_torque"] + 0.02 * rng.standard_normal(2000)
    speed = made.signals["motor_speed"] + 2e-3 * rng.standard_normal(2000)
    return replace(made, signals={"motor_torque": torque / K, "motor_speed": speed, **more}, torque_unit="A")


def fitted(made, drive, *hold):
    (seen,), known = as_torques([made], drive, (CONSTANT,))
    estimate = greybox([seen], known, Options(hold=hold, free=(CONSTANT, "motor.coulomb", "motor.idle_torque")))
    return {p.name: p for p in estimate.parameters}, estimate


def test_a_held_inertia_identifies_the_constant():
    rows, estimate = fitted(one_body_record(), driven({**TRUTH, CONSTANT: 0.45}), "motor.inertia")
    line = rows[CONSTANT]
    assert abs(line.value - K) < 3.0 * line.std < 0.05 * K and line.unit == "Nm/A" and line.status == "fitted"
    assert line.start == 0.45 and CONSTANT in estimate.covariance.names


def test_a_load_torque_that_never_acts_does_not_identify_it():
    """The record shows what the structure does not: no torque has an interval."""
    made = one_body_record(load_torque=np.zeros(2000))
    rows, estimate = fitted(replace(made, torque_unit="Nm", input_units={"motor_torque": "A"}),
                            driven({**TRUTH, CONSTANT: 0.45}))
    assert "not-identifiable" in {f.code for f in estimate.findings}
    for name in (CONSTANT, "motor.inertia", "motor.coulomb"):
        assert rows[name].std is None and rows[name].status == "not-identifiable" and "ratio" in rows[name].reason


def test_other_estimators_refuse_it_by_name():
    (made,), drive = as_torques([one_body_record()], driven({**TRUTH, CONSTANT: 0.45}), (CONSTANT,))
    with pytest.raises(BadOption, match=r"criterion inverse; found motor.torque_constant"):
        greybox([made], drive, Options(free=(CONSTANT,), criterion="inverse"))
    with pytest.raises(BadOption, match=r"motor.torque_constant held in this step"):
        backlash([made], two_mass(), Options(free=(CONSTANT,)))


def chirped(seed, shaft):
    """Two masses in A; with the torque of the shaft in Nm or without it."""
    rated, start, f = MACHINE.rated_torque, running(MACHINE, 20.0), resonance(MACHINE)
    torque = steps(start.torque, [0.08 * rated] * 4, (0.6, 1.0), 0.5, STEP, seed)[:3000]
    size = len(torque)
    torque = torque + multisine(np.linspace(0.3, 2.0, 9) * f, 0.01 * rated, size * STEP, STEP, seed)[:size]
    run = simulate_linear(MACHINE, torque, STEP, start, white_noise(size, 0.003 * rated, 7 * seed + 1))
    scale = rated * 0.25 / sum(MACHINE.inertia)
    speed = run.speeds[:, 0] + white_noise(size, 0.002 * scale, 7 * seed + 2)
    if not shaft:
        return replace(experiment(torque / K, speed), torque_unit="A")
    twist = run.shaft_torques[:, 0] + white_noise(size, 0.02 * rated, 7 * seed + 3)
    return replace(experiment(torque / K, speed, shaft_torque=twist), input_units={"motor_torque": "A"})


@pytest.mark.slow
@pytest.mark.parametrize("shaft", [True, False], ids=["torque of the shaft", "held inertia"])
def test_the_truth_is_recovered_and_the_interval_is_that_of_its_scatter(shaft):
    values, free = truth(MACHINE), ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping",
                                    "total.viscous", "total.idle_torque")
    hold, z = () if shaft else ("motor.inertia",), {}
    for seed in range(1, 7):
        drive = replace(drive_like(MACHINE, list(free), 0.2, seed), input_unit="A").with_values(
            {CONSTANT: 0.45, **{n: values[n] for n in hold}})
        (made,), drive = as_torques([chirped(seed, shaft)], drive, (CONSTANT,))
        rows = {p.name: p for p in greybox([made], drive, Options(hold=hold, free=(CONSTANT,))).parameters}
        for name, true in ((CONSTANT, K), ("load.inertia", values["load.inertia"])):
            assert rows[name].std < 0.02 * true
            z.setdefault(name, []).append((rows[name].value - true) / rows[name].std)
    for name, each in z.items():
        assert np.abs(each).max() < 3.0, name
        # Chi-square of six: 0.0006 below 0.4, 0.001 above 22.
        assert 0.4 < np.sum(np.square(each)) < 22.0, name
