"""Recordings with a body clamped: start values without a file, joint fits, and contradictions of the clamp."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.drive.chain import three_mass, vehicle
from drivetool.errors import BadOption, BadParameters, BadRecording
from drivetool.identify.greybox.clamped import (
    MAX_CLAMP_MOTION,
    MAX_CLAMPED_NOISE_RATIO,
    MAX_MEAN_OVER_RMS,
    check_clamped,
    clamped_oscillation_of,
    with_start_values_from_clamped,
)
from drivetool.identify.greybox.estimator import default_free, greybox
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import problem_of, roles_of, traces_of
from tests.bus_fixtures import BUS, bus, bus_drive
from tests.simulator.machine import Machine, State
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

HELD, ROLLING = bus("held"), bus("acceleration")


def clamped(drive=None, body="wheels"):
    drive = replace(drive or bus_drive(), records={"held.parquet": HELD.sha256})
    return drive.with_values({f"{body}.clamped@held.parquet": 1.0})


def test_a_clamped_record_needs_no_first_values():
    """Frequency within the grid of twelfths of an octave, the inertia within what that leaves."""
    found = with_start_values_from_clamped(clamped(), [HELD])
    assert found.value("shaft.stiffness") == pytest.approx(BUS["shaft.stiffness"], rel=0.2)
    assert found.value("motor.inertia") == pytest.approx(BUS["motor.inertia"], rel=0.2)
    assert found.value("wheels.inertia") == 22.1  # what is known stays


def test_what_is_given_stays_and_a_drive_without_a_clamp_is_left_alone():
    given = clamped().with_values({"motor.inertia": 4.2, "shaft.stiffness": 1.4e6, "shaft.damping": 3000.0})
    assert with_start_values_from_clamped(given, [HELD]) == given
    assert with_start_values_from_clamped(bus_drive(), [HELD]) == bus_drive()


def test_without_a_start_the_load_follows_from_what_it_accelerates_with():
    drive = replace(two_mass(), records={"held.parquet": HELD.sha256}).with_values(
        {"load.clamped@held.parquet": 1.0, "shaft.ratio": 8.79})
    found = with_start_values_from_clamped(drive, [HELD, ROLLING])
    assert found.value("load.inertia") == pytest.approx(22.1 + 12350.0 * 0.45**2, rel=0.2)


@pytest.mark.slow
def test_the_shaft_and_motor_from_a_clamped_record_alone():
    estimate = greybox([HELD], clamped(), Options())
    lines = {p.name: p for p in estimate.parameters if p.status == "fitted"}
    assert not {"wheels.carried_mass", "total.viscous", "total.idle_torque"} & set(lines)
    for name in ("motor.inertia", "shaft.stiffness", "shaft.damping"):
        assert abs(lines[name].value - BUS[name]) < 3.0 * lines[name].std, name
        assert lines[name].std < 0.02 * BUS[name]
    assert "model-error" not in {f.code for f in estimate.findings}


@pytest.mark.slow
def test_clamped_and_rolling_in_one_fit():
    estimate = greybox([HELD, ROLLING], clamped(), Options())
    lines = {p.name: p for p in estimate.parameters}
    for name in ("motor.inertia", "wheels.carried_mass", "shaft.stiffness", "shaft.damping"):
        assert abs(lines[name].value - BUS[name]) < 3.0 * lines[name].std, name
    idle = lines["total.idle_torque"]
    assert abs(idle.value - BUS["wheels.idle_torque"] / 8.79) < 3.0 * idle.std
    assert lines["wheels.carried_mass"].std < 20.0
    assert "model-error" not in {f.code for f in estimate.findings}


def test_a_clamped_body_has_no_start_speed_to_fit():
    drive = with_start_values_from_clamped(clamped(), [HELD])
    roles = roles_of([HELD, ROLLING], drive)
    problem = problem_of(drive, ("motor.inertia",), roles, traces_of([HELD, ROLLING], roles))
    assert [dict(t.start) for t in problem.traces] == [{"wheels.speed": 0.0}, {}]


def test_the_friction_of_a_clamped_body_is_not_freed():
    assert not {n for n in default_free(clamped(), [HELD]) if n.startswith(("wheels.", "total."))}
    assert "wheels.carried_mass" in default_free(clamped(), [HELD, ROLLING])


@pytest.mark.parametrize("frequency, ratio", [(20.0, 0.01), (60.0, 0.1), (150.0, 0.5)])
def test_a_swing_is_found_in_the_noise(frequency, ratio):
    """A mass of 2 on its spring: against a body of 1e12 the two-mass simulator has the same motion."""
    stiffness, damping, n, step = 2.0 * frequency**2, 4.0 * ratio * frequency, 4000, 1e-3
    machine = Machine((2.0, 1e12), stiffness=(stiffness,), damping=(damping,))
    torque = np.repeat(np.random.default_rng(3).choice([-10.0, 10.0], n // 20), 20)
    run = simulate_linear(machine, torque, step, State((0.0, 0.0), (0.0,), 0.0, 0.0), np.zeros(n))
    speed = run.speeds[:, 0]
    noisy = speed + white_noise(n, 0.5 * float(speed.std()), 5)
    record = replace(HELD, step=step, segments=((0, n),), signals={"motor_torque": torque, "motor_speed": noisy})
    found = clamped_oscillation_of(record)
    assert found.frequency == pytest.approx(frequency, rel=0.06)
    assert found.inertia == pytest.approx(2.0, rel=0.3)


def moving(motor, load=None):
    signals = {"motor_torque": HELD.signals["motor_torque"], "motor_speed": motor}
    return replace(HELD, signals=signals | ({} if load is None else {"load_speed": load}))


SWING = np.sin(np.arange(HELD.size) / 7.0)


@pytest.mark.parametrize("share, stands", [(0.0, True), (0.3, True), (0.9, False), (3.0, False)])
def test_a_motor_that_turns_on_is_not_clamped_behind_its_shaft(share, stands):
    """share: mean speed over the rms of the swing; 0.9 is a mean of 0.67 of the rms of both."""
    assert MAX_MEAN_OVER_RMS == 0.5
    record = moving(SWING + share * SWING.std())
    if stands:
        check_clamped(record, vehicle(), "wheels")
    else:
        with pytest.raises(BadRecording, match="rotates at"):
            check_clamped(record, vehicle(), "wheels")


def test_a_noisy_sensor_does_not_refute_a_clamp():
    """Five times as much noise as the limit of the motion behind the gear."""
    noise = white_noise(HELD.size, 5.0 * MAX_CLAMP_MOTION * float(SWING.std()) / 8.79, 11)
    record = replace(moving(SWING), signals={**moving(SWING).signals, "wheels_speed": noise})
    check_clamped(record, bus_drive(), "wheels")


@pytest.mark.parametrize("share, stands", [(0.03, True), (0.09, False)])
def test_a_sensor_of_the_clamped_body_is_checked_first(share, stands):
    assert MAX_CLAMP_MOTION == 0.05
    record = moving(SWING, share * SWING)
    if stands:
        check_clamped(record, two_mass(), "load")
    else:
        with pytest.raises(BadRecording, match="load at standstill"):
            check_clamped(record, two_mass(), "load")


def test_a_clamped_motor_may_not_swing():
    with pytest.raises(BadRecording, match="it oscillates with"):
        check_clamped(moving(SWING), two_mass(), "motor")
    assert MAX_CLAMPED_NOISE_RATIO == 3.0
    for size, stands in ((2.5, True), (4.5, False)):  # over the noise; halved or doubled, one of them turns over
        record = moving(white_noise(HELD.size, 0.01, 3) + 0.01 * size * SWING / SWING.std())
        if stands:
            check_clamped(record, two_mass(), "motor")
        else:
            with pytest.raises(BadRecording):
                check_clamped(record, two_mass(), "motor")


def test_nothing_beyond_a_clamp_is_freed():
    drive = replace(three_mass(), records={"held.parquet": HELD.sha256}).with_values(
        {"gear.clamped@held.parquet": 1.0})
    assert set(default_free(drive, [HELD])) == {
        "motor.inertia", "shaft.stiffness", "shaft.damping", "motor.coulomb"}
    assert "arm.inertia" in default_free(drive, [HELD, ROLLING])


def test_a_clamp_is_a_choice_and_no_number():
    with pytest.raises(BadParameters, match="0 or 1"):
        clamped().with_values({"wheels.clamped": 0.5})
    with pytest.raises(BadOption, match="0 or 1"):
        greybox([HELD], with_start_values_from_clamped(clamped(), [HELD]), Options(free=("wheels.clamped",)))
