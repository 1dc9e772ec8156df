"""The torque from the motion: closed forms of every effect, exact records, intervals, instruments, refusals."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from drivetool.drive import one_body
from drivetool.drive.effects import EFFECTS
from drivetool.errors import BadOption
from drivetool.identify.greybox.estimator import greybox, torque_in_feedback
from drivetool.identify.inverse.regression import first_stage_f, regression_of, with_instruments
from drivetool.identify.motion.filtered_equations import near_reversal
from drivetool.identify.motion.linear import Rows, change_of, covariance_of, inverse_of
from drivetool.identify.motion.motion import Motion, Smoothing
from drivetool.identify.motion.required_torque import check_no_signal_path, required_torque_of
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.start import KnownStart
from drivetool.identify.setup.task import Task
from tests.identify.loop import MACHINES, loop_record, open_record
from tests.identify.swing import STEP, TRUTH, record, swing

S = swing()
START = one_body().with_values({"motor.inertia": 0.05})
MOTION = Motion(S.mean_speed, S.acceleration, S.middle, S.side, np.arange(len(S.middle)) * STEP + 0.5 * STEP,
                np.zeros(len(S.middle), bool), np.ones(len(S.middle), bool), Smoothing(0.02, 0.0))
W, A, Q, SIDE, T = S.mean_speed, S.acceleration, S.middle, S.side, MOTION.time

# name -> (values of its parameters, torque that it requires of the motor, by the law as the effect states it)
LAWS = {
    "inertia": ({"inertia": 0.3}, 0.3 * A),
    "added-inertia": ({"added_inertia": 0.2}, 0.2 * A),
    "carried-mass": ({"carried_mass": 2.0, "radius": 0.3}, 2.0 * 0.3**2 * A),
    "viscous": ({"viscous": 0.7}, 0.7 * W),
    "coulomb": ({"coulomb": 0.4}, 0.4 * SIDE),
    "idle-torque": ({"idle_torque": -0.2}, -0.2 + 0.0 * W),
    "stribeck": ({"stribeck": 0.5, "stribeck_speed": 2.0}, 0.5 * SIDE * np.exp(-(W / 2.0) ** 2)),
    "breakaway": ({"coulomb": 0.4, "breakaway": 0.5, "breakaway_speed": 2.0}, 0.4 * np.tanh(5.0 * W)
                  + (2 * np.e) ** 0.5 * 0.5 * np.exp(-W * W / 8.0) * W / 8.0**0.5),
    "asymmetric-friction": ({"viscous_asymmetry": 0.1}, 0.1 * np.abs(W)),
    "quadratic-drag": ({"drag": 0.03}, 0.03 * W * np.abs(W)),
    "friction-drift": ({"drift_coulomb": 0.2, "drift_viscous": 0.1, "drift_time": 3.0},
                       (0.2 * SIDE + 0.1 * W) * np.exp(-T / 3.0)),
    "torque-ripple": ({"ripple_sine": 0.3, "ripple_cosine": -0.1, "ripple_order": 3.0},
                      -0.3 * np.sin(3.0 * Q) + 0.1 * np.cos(3.0 * Q)),
    "imbalance": ({"imbalance_sine": 0.3, "imbalance_cosine": 0.2}, -0.3 * np.sin(Q) - 0.2 * np.cos(Q)),
    "load-step": ({"step_torque": 0.4, "step_time": 4.0}, 0.4 * (T > 4.0)),
}


def torque_of(values, free=()):
    given = one_body().with_values({"motor.inertia": 1e-9, **values})
    a = required_torque_of(given, tuple(free), MOTION, STEP, {})
    parts = (a.accelerating, a.sliding, a.rest)
    return sum(p.value for p in parts), sum(p.slopes for p in parts)


def test_every_effect_on_a_body_is_here():
    """But for a scale or loss of the torque, a clamp, which is no torque of a body that moves, laws with states."""
    others = {"torque-constant", "clamp", "transmission-loss", *(e.code for e in EFFECTS if e.has_states)}
    assert {e.code for e in EFFECTS if e.of == "body"} - others == set(LAWS)


@pytest.mark.parametrize("effect", [e for e in EFFECTS
                                    if (e.has_states and e.of != "shaft") or e.code == "transmission-loss"],
                         ids=lambda e: e.code)
def test_a_law_with_a_state_or_a_loss_is_refused_by_name(effect):
    owner = {"path": "converter", "sensor": "sensor"}.get(effect.of, "motor")
    name = f"{owner}.{effect.present[0]}"
    value = min(90.0, START.quantity(name).bounds[1])
    for given, free in ((START.with_values({name: value}), ()), (START, (name,))):
        with pytest.raises(BadOption, match=re.escape(name)):
            check_no_signal_path(given, free)


@pytest.mark.parametrize("code", LAWS)
def test_an_effect_requires_its_torque(code):
    values, expected = LAWS[code]
    values = {f"motor.{n}": v for n, v in values.items()}
    found, slopes = torque_of(values, values)
    away = np.abs(T - 4.0) > 4.0 * STEP if code == "load-step" else np.ones(len(T), bool)
    np.testing.assert_allclose(found[away], expected[away], atol=1e-8 * max(np.abs(A).max(), 1.0))
    for j, name in enumerate(values):
        h = 1e-5 * abs(values[name])
        up, down = (torque_of({**values, name: values[name] + s * h})[0] for s in (1.0, -1.0))
        numeric = (up - down) / (2.0 * h)
        np.testing.assert_allclose(slopes[away, j], numeric[away], atol=1e-5 * np.abs(numeric).max())


@pytest.mark.parametrize("role", ["motor_speed", "motor_angle"])
def test_without_noise_it_is_exact(role):
    e = greybox([record(S, role)], START, Options(criterion="inverse"))
    found = {p.name: p for p in e.parameters}
    assert {n: found[n].value for n in TRUTH} == pytest.approx(TRUTH, rel=1e-3)
    assert all(found[n].std < 0.01 * TRUTH[n] for n in TRUTH)
    assert e.fit["torque_rmse_over_rms_percent"] < 1.0


@pytest.mark.slow
def test_laws_that_are_not_linear_are_found_from_far():
    more = 0.3 * S.side * np.exp(-(W / 1.5) ** 2) - 0.2 * np.sin(Q + 0.5)
    drive = START.with_values({"motor.stribeck": 0.1, "motor.stribeck_speed": 3.0})
    free = ("motor.stribeck", "motor.stribeck_speed", "motor.imbalance_sine", "motor.imbalance_cosine")
    e = greybox([record(S, "motor_angle", more=more)], drive, Options(criterion="inverse", free=free))
    found = {p.name: p.value for p in e.parameters}
    wanted = {**TRUTH, "motor.stribeck": 0.3, "motor.stribeck_speed": 1.5,
              "motor.imbalance_sine": 0.2 * np.cos(0.5), "motor.imbalance_cosine": 0.2 * np.sin(0.5)}
    assert {n: found[n] for n in wanted} == pytest.approx(wanted, rel=0.02)


@pytest.mark.parametrize("pole", [0.0, 0.95])
def test_the_covariance_holds_under_correlated_errors(pole):
    n, errors, stated = 1500, [], []
    rng = np.random.default_rng(5)
    slow = lfilter([0.05], [1.0, -0.95], rng.standard_normal(n))
    x = np.column_stack([np.sin(np.arange(n) / 30.0), slow / slow.std(), np.ones(n)])
    for _ in range(300):
        r = lfilter([1.0], [1.0, -pole], rng.standard_normal(n + 200))[200:]
        inverse = inverse_of([Rows(r, x, x)])
        change = change_of([Rows(r, x, x)], inverse)
        errors.append(change)
        stated.append(np.diag(covariance_of([Rows(r - x @ change, x, x)], inverse)))
    ratio = np.sqrt(np.mean(stated, axis=0) / np.mean(np.square(errors), axis=0))
    assert np.all((ratio > 0.88) & (ratio < 1.12))  # the scatter of 300 is known to 4 per cent


@pytest.mark.slow
@pytest.mark.parametrize("reference", ["reference_angle", pytest.param("reference_speed", marks=pytest.mark.long)])
def test_instruments_have_no_bias_where_least_squares_has(reference):
    machine, errors = MACHINES[2], {True: [], False: []}
    for seed in range(60):
        made = loop_record(machine, 700 + seed, disturbance=0.1)
        for with_it in errors:
            signals = {k: v for k, v in made.signals.items() if not k.startswith("reference") or (
                with_it and k == reference)}
            e = greybox([replace(made, signals=signals)], machine.start, Options(criterion="inverse"))
            p = next(p for p in e.parameters if p.name == "motor.inertia")
            errors[with_it].append((p.value - machine.truth["motor.inertia"], p.std))
    off = {k: np.mean([e for e, _ in v]) / np.std([e for e, _ in v]) * np.sqrt(len(v)) for k, v in errors.items()}
    assert abs(off[True]) < 3.0 < abs(off[False])
    for with_it, least in ((True, 0.85), (False, 0.95)):  # std_structure of least squares covers its bias
        assert np.mean([abs(e) < 1.96 * s for e, s in errors[with_it]]) >= least


@pytest.mark.slow
def test_the_stated_std_is_that_of_its_parts_whatever_the_units():
    more = 0.3 * S.side * np.exp(-(W / 1.5) ** 2)
    drive = START.with_values({"motor.stribeck": 0.1, "motor.stribeck_speed": 3.0})
    noisy = record(S, "motor_angle", more=more + 0.05 * np.random.default_rng(2).standard_normal(len(W)))
    stated = []
    for unit in (1.0, 1e6):  # of the torque
        made = replace(noisy, signals={**noisy.signals, "motor_torque": unit * noisy.signals["motor_torque"]})
        start = {n: v if n.endswith("speed") else unit * v for n, v in drive.values.items()}
        e = greybox([made], one_body().with_values(start), Options(
            criterion="inverse", free=("motor.stribeck", "motor.stribeck_speed")))
        for p in e.parameters:
            assert p.std == pytest.approx(np.hypot(p.std_noise, p.std_structure), rel=1e-6), p.name
        stated.append([p.std / (1.0 if p.name.endswith("speed") else unit) for p in e.parameters])
    assert stated[0] == pytest.approx(stated[1], rel=1e-3)


def test_the_first_stage_is_an_f_of_the_numbers_fitted():
    record_, other = (loop_record(MACHINES[0], seed, 0.03, seconds=8.0) for seed in (1, 2))
    seen = regression_of([record_], MACHINES[0].start, (), "motor_angle", ())
    known = with_instruments(seen, "motor_angle", "reference_angle")
    own, made = (m.acceleration[::seen.kept] for m in (seen.seen.each[0], known.predicted[0]))
    explained, left = 1.0 - np.var(own - made) / np.var(own), np.var(own - made) / np.var(own)
    count = 3 * 6 + 2  # shapes by memories, and a zero and a drift
    assert first_stage_f(known) == pytest.approx(explained / count / (left / (len(own) - count)), rel=0.02)
    both = regression_of([record_, other], MACHINES[0].start, (), "motor_angle", ())
    assert with_instruments(both, "motor_angle", "reference_angle").fitted == count + 2


@pytest.mark.slow
def test_recordings_have_zeros_of_their_own():
    """A speed reference says nothing of where an angle began."""
    each = [loop_record(MACHINES[0], seed, 0.03, seconds=8.0) for seed in (1, 2)]
    moved = [replace(e, signals={**e.signals, "motor_angle": e.signals["motor_angle"] + zero})
             for e, zero in zip(each, (0.0, 50.0), strict=True)]
    fits = []
    for records in (each, moved):
        given = [replace(e, signals={k: v for k, v in e.signals.items() if k != "reference_angle"})
                 for e in records]
        e = greybox(given, MACHINES[0].start, Options(criterion="inverse"))
        assert e.details["instruments"] == "reference_speed"
        fits.append([(p.value, p.std) for p in e.parameters])
    # The encoder's steps lie otherwise about another zero.
    assert np.all(np.abs(np.subtract(*fits)[:, 0]) < 0.2 * np.array(fits[0])[:, 1])


def codes(e):
    return {f.code for f in e.findings}


@pytest.mark.slow
def test_what_is_said_of_the_reference():
    made = loop_record(MACHINES[0], 1)
    with_it = greybox([made], MACHINES[0].start, Options(criterion="inverse"))
    assert not codes(with_it) & {"weak-instrument", "torque-without-feedback"}
    assert with_it.details["instruments"] == "reference_angle"
    other = np.cumsum(np.random.default_rng(1).standard_normal(made.size)) * 1e-3
    unrelated = replace(made, signals={**made.signals, "reference_angle": other})
    assert "weak-instrument" in codes(greybox([unrelated], MACHINES[0].start, Options(criterion="inverse")))


def test_the_set_point_of_an_outer_loop_is_no_instrument():
    axis = MACHINES[2]
    made = loop_record(axis, 1, 0.03, seconds=8.0)
    s = made.signals
    reference_speed = s["reference_speed"] + axis.bandwidth / 3.0 * (s["reference_angle"] - s["motor_angle"])
    cascade = replace(made, signals={"motor_torque": s["motor_torque"], "motor_angle": s["motor_angle"],
                                     "reference_speed": reference_speed})
    e = greybox([cascade], axis.start, Options(criterion="inverse"))
    finding = next(f for f in e.findings if f.code == "weak-instrument")
    assert "depends on the motion" in finding.text and e.details["instruments"] == "none"


def test_an_open_loop_is_the_forward_fits_question():
    e = greybox([open_record(MACHINES[0], 1)], MACHINES[0].start, Options(criterion="inverse"))
    assert {"weak-instrument", "torque-without-feedback"} <= codes(e)


@pytest.mark.parametrize("made, failed, said", [
    (loop_record(MACHINES[0], 1, 0.1, seconds=4.0), True, True),
    (open_record(MACHINES[0], 1), True, False),
    (loop_record(MACHINES[0], 1, 0.1, seconds=4.0), False, False)])
def test_a_loop_whose_motion_no_torque_explains_is_the_inverse_fits_question(made, failed, said):
    task = Task(MACHINES[0].start, tuple(MACHINES[0].truth), roles_of([made], MACHINES[0].start), (made,))
    assert [f.code for f in torque_in_feedback(failed, task)] == ["torque-in-feedback"] * said


def test_a_torque_of_another_axis_has_no_interval():
    other = np.random.default_rng(0).standard_normal(len(S.speed))
    made = record(S)
    e = greybox([replace(made, signals={**made.signals, "motor_torque": other})], START,
                Options(criterion="inverse"))
    assert "explains-nothing" in codes(e)
    assert all(p.std is None and p.ci95 is None for p in e.parameters)


@pytest.mark.parametrize("drive, options, words", [
    (START.with_values({"converter.dead_time": 0.01}), {}, "converter.dead_time"),
    (START, {"free": ("total.viscous",)}, "friction of each body"),
    (START, {"start": KnownStart(rest=True)}, "start state")])
def test_what_it_cannot_do_it_refuses(drive, options, words):
    with pytest.raises(BadOption, match=words):
        greybox([record(S)], drive, Options(criterion="inverse", **options))


@pytest.mark.slow
def test_reversals_that_the_filter_rounds_are_left_out():
    """An axis that is slowly sampled: with them its dry friction would be 0.2 % too small, two scatters of one."""
    axis, errors = MACHINES[3], []
    for seed in range(8):
        made = loop_record(axis, 993_000 + seed, log_noise=0.01)
        found = greybox([made], axis.start, Options(criterion="inverse")).drive.values
        errors.append(found["motor.coulomb"] / axis.truth["motor.coulomb"] - 1.0)
    assert abs(np.mean(errors)) < 1e-3  # 0.1 % of scatter each


def test_a_body_that_turns_all_the_time_keeps_its_reversals():
    assert 0.0 < np.mean(near_reversal(MOTION)) < 0.5
    assert not near_reversal(replace(MOTION, smoothing=Smoothing(0.0005, 0.0))).any()
