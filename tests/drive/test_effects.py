"""The contract that every effect keeps, over the whole catalogue."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from drivetool.drive import chain
from drivetool.drive.chain import three_mass, two_mass
from drivetool.drive.effects import converter, drag, imbalance, ripple, viscous
from drivetool.drive.effects.catalogue import EFFECTS
from drivetool.drive.effects.catalogue_check import check_effects
from drivetool.drive.effects.induction import VOLTAGES
from drivetool.drive.simulation.simulate import Trace
from tests.drive.test_kernel import STEP, plant_of

pytestmark = pytest.mark.usefixtures("code_for_any_size")
EACH_EFFECT = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.code)
OWNER = {"body": "load", "shaft": "shaft", "path": "converter", "sensor": "sensor", "friction": "friction",
         "motor": "motor"}
OUTPUTS = ("motor_speed", "load_speed", "shaft_torque", "load_angle")
HYPOTHESIS_SETTINGS = settings(max_examples=25, deadline=None, derandomize=True)
EACH_DAMPING_LAW = pytest.mark.parametrize("law", ["inside", "always"])


def base(law="inside", **more):
    """A two-mass drive in which every effect acts but idle torque."""
    values = {"motor.inertia": 0.6, "load.inertia": 5.2, "motor.viscous": 0.8, "load.viscous": 0.3,
              "motor.coulomb": 5.0, "load.coulomb": 4.0, "shaft.stiffness": 3300.0, "shaft.damping": 3.1,
              "shaft.half_gap": 0.01, "converter.bandwidth": 433.0, "converter.damping": 0.69,
              "converter.dead_time": 1.4 * STEP, "converter.interpolation": 0.4}
    return replace(two_mass(), values=values | more, damping_law=law, constants={"motor.torque_constant": 1.0})


# Effects with a smooth law, by themselves, on top of the base: (owner, values).
SMOOTH = {
    "added-inertia": {"load.added_inertia": 2.0},
    "friction-factor": {"friction.factor": 1.4},
    "carried-mass": {"load.carried_mass": 8.0, "load.radius": 0.4},
    "clamp": {"load.clamped": 1.0},
    "stribeck": {"load.stribeck": 3.0, "load.stribeck_speed": 0.2},
    "breakaway": {"load.breakaway": 3.0, "load.breakaway_speed": 0.2},
    "asymmetric-friction": {"load.viscous_asymmetry": 0.2},
    "quadratic-drag": {"load.drag": 0.5},
    "friction-drift": {"load.drift_coulomb": 2.0, "load.drift_viscous": 0.3, "load.drift_time": 0.2},
    "warm-up": {"friction.drift_coulomb": 0.5, "friction.drift_viscous": 0.8, "friction.drift_time": 0.2},
    "torque-ripple": {"motor.ripple_sine": 3.0, "motor.ripple_cosine": 2.0, "motor.ripple_order": 7.5},
    "imbalance": {"load.imbalance_sine": 3.0, "load.imbalance_cosine": 2.0},
    "bristle-friction": {"load.bristle_stiffness": 400.0, "load.bristle_damping": 3.0},
    "transmission-loss": {"load.loss_driving": 0.1, "load.loss_driven": 0.2},
    "load-step": {"load.step_torque": 8.0, "load.step_time": 0.2},
    "hardening-stiffness": {"shaft.hardening": 0.5, "shaft.hardening_twist": 0.01},
    "load-dependent-damping": {"shaft.load_damping": 0.02},
    "speed-filter": {"sensor.bandwidth": 500.0},
    "damping-in-gap": {"shaft.gap_damping": 1.5},
    "torque-constant": {"motor.torque_constant": 1.4},
    "induction-motor": {"motor.magnetizing_inductance": 0.2, "motor.stator_resistance": 0.5,
                        "motor.rotor_resistance": 0.3, "motor.leakage_inductance": 0.02, "motor.pole_pairs": 2.0,
                        "motor.supply_frequency": 5.0},
}


def run(drive, torque, start=None, free=(), outputs=OUTPUTS):
    """(n, ny) outputs from a start (motor speed, load speed, twist)."""
    fed = VOLTAGES if drive.value("motor.magnetizing_inductance") else ()
    plant = plant_of(drive, outputs, free, more_inputs=fed)
    x = np.zeros(plant.system.nx)
    x[:3] = (0.0, 0.0, 0.0) if start is None else start
    torque = np.asarray(torque, float)
    inputs = np.column_stack([torque, *(np.full(len(torque), 40.0) for _ in fed)])
    return plant.outputs(Trace(inputs, np.zeros((len(torque), len(outputs))), STEP), x)


def reversals(n=600):
    """Torque levels of both signs."""
    return np.repeat(np.random.default_rng(5).uniform(-40.0, 40.0, n // 50), 50)


@EACH_EFFECT
def test_says_what_it_is(effect):
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", effect.code) and effect.of in OWNER
    assert effect.law and effect.needs and effect.source and effect.quantities
    assert set(effect.present) <= set(effect.quantities)
    for suffix, quantity in effect.quantities.items():
        assert re.fullmatch(r"[a-z]+[2-9]?(_[a-z]+)*", suffix) and quantity.meaning and quantity.scale > 0.0
        assert quantity.unit_for("Nm", "rad") is not None and "{" not in quantity.unit_for("A", "m")
        low, high = quantity.bounds
        assert low < high and np.isfinite([low, high]).all()
        # Infinite: what is infinitely fast is absent, and cannot be tried.
        assert quantity.neutral is None or low <= quantity.neutral <= high or quantity.neutral == np.inf
        assert suffix not in effect.present or quantity.neutral is not None


def test_codes_are_not_used_twice():
    assert len({e.code for e in EFFECTS}) == len(EFFECTS)


def without_slope(w, _, time, side, p, out):
    drag.torque(w, _, time, side, p, out)
    out[1] = 0.0


WRONG_EFFECTS = {
    "two effects with one quantity": (
        replace(drag.EFFECT, code="second", quantities={"viscous": drag.EFFECT.quantities["drag"]}),
        "the quantity viscous of a body is declared by viscous and by second"),
    "a law without derivative": (
        replace(drag.EFFECT, code="third", quantities={}, torque=without_slope),
        "the law of third does not write the derivatives of its torque into out[1:]"),
    "a state without a start": (
        replace(converter.EFFECT, code="fourth", quantities={}, start=None),
        "fourth adds states and has no `start` that gives their start values"),
}


@pytest.mark.parametrize(("wrong", "sentence"), WRONG_EFFECTS.values(), ids=WRONG_EFFECTS)
def test_a_wrong_effect_is_one_sentence_when_the_catalogue_is_built(wrong, sentence):
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}$"):
        check_effects((viscous.EFFECT, wrong))


@EACH_DAMPING_LAW
@EACH_EFFECT
def test_neutral_value_changes_nothing(effect, law):
    """The neutral value, no value, and the neutral value of a free parameter: the same simulation."""
    names = [f"{OWNER[effect.of]}.{s}" for s, q in effect.quantities.items() if q.neutral is not None]
    drive, start = base(law), (0.5, -0.3, 0.012)
    without = replace(drive, values={k: v for k, v in drive.values.items() if k not in names})
    neutral = replace(drive, values=drive.values | {n: drive.quantity(n).neutral for n in names})
    plain = run(without, reversals(), start)
    np.testing.assert_allclose(run(neutral, reversals(), start), plain, rtol=0.0, atol=1e-12)
    free = [n for n in names if np.isfinite(drive.quantity(n).neutral) and not drive.quantity(n).choice]
    if free:
        np.testing.assert_allclose(run(neutral, reversals(), start, free), plain, rtol=0.0, atol=1e-9)


@EACH_EFFECT
def test_an_effect_that_is_present_acts(effect):
    """A value that differs from the present one changes the simulation."""
    drive = base(**{"load.idle_torque": 3.0, **SMOOTH.get(effect.code, {})})
    names = SMOOTH.get(effect.code) or [f"{OWNER[effect.of]}.{s}" for s in effect.quantities]
    assert names
    for name in names:
        now, choice = drive.value(name), drive.quantity(name).choice
        other = replace(drive, values=drive.values | {name: next((v for v in choice if v != now), 1.5 * now)})
        assert np.abs(run(other, reversals()) - run(drive, reversals())).max() > 1e-6, name


def same_without_an_angle(drive):
    """Whether the motor's speed is the same whatever else is measured."""
    alone, beside = (run(drive, reversals(), outputs=outputs)[:, 0] for outputs in (OUTPUTS[:1], OUTPUTS))
    np.testing.assert_allclose(alone, beside, rtol=0.0, atol=1e-9)


@EACH_EFFECT
def test_an_effect_acts_where_the_speed_alone_is_measured(effect):
    """The usual record. A law over an angle that does not declare it works only with an encoder."""
    same_without_an_angle(base(**{"load.idle_torque": 3.0, **SMOOTH.get(effect.code, {})}))


def test_a_further_law_over_an_angle_needs_its_declaration_only(monkeypatch):
    def stamp(assembly, body):
        if assembly.acts(body, "cogging"):
            assembly.law(ripple.torque, [assembly.of_body(body, "cogging"), *map(assembly.number, (0.0, 12.0))],
                         assembly.angle_of(body), body=body)

    force = replace(imbalance.EFFECT.quantities["imbalance_sine"], meaning="cogging torque")
    cogging = replace(imbalance.EFFECT, code="cogging", quantities={"cogging": force}, present=("cogging",),
                      stamp=stamp)
    monkeypatch.setattr(chain, "EFFECTS", (*EFFECTS, cogging))
    for function in (chain._effects, chain._quantities):  # they remember the catalogue as it was
        monkeypatch.setattr(chain, function.__name__, cache(function.__wrapped__))
    drive = base(**{"load.cogging": 3.0})
    same_without_an_angle(drive)
    assert np.abs(run(drive, reversals()) - run(base(), reversals())).max() > 1e-6


@pytest.mark.parametrize("code", [e.code for e in EFFECTS if e.of == "body" and e.code in SMOOTH
                                  and e.code != "torque-constant"])  # there it has no input
@pytest.mark.parametrize("body", ["motor", "gear", "arm"])
def test_an_effect_of_a_body_acts_on_any_of_them(code, body):
    """An effect of the last body must not be lost when another body is added behind it."""
    values = {"motor.inertia": 0.6, "gear.inertia": 2.0, "arm.inertia": 3.2, "shaft.stiffness": 3300.0,
              "shaft.damping": 3.1, "shaft2.stiffness": 6000.0, "shaft2.damping": 4.0, f"{body}.coulomb": 2.0,
              f"{body}.viscous": 0.5}
    own = {f"{body}.{n.partition('.')[2]}": v for n, v in SMOOTH[code].items()}
    drives = (replace(three_mass(), values=values | more) for more in (own, {}))
    with_it, without = (run(drive, reversals(), (0.0,) * 3, outputs=("motor_speed",)) for drive in drives)
    assert np.abs(with_it - without).max() > 1e-4


@EACH_DAMPING_LAW
@EACH_EFFECT
def test_odd_where_declared(effect, law):
    """Mirrored input and start give the mirrored output to the last digit, or the effect is not odd."""
    drive = base(law, **SMOOTH.get(effect.code, {}))
    if not effect.odd:
        drive = replace(drive, values=drive.values | SMOOTH.get(effect.code, {"load.idle_torque": 3.0}))
    start = np.array([0.5, -0.3, 0.012])
    there, back = run(drive, reversals(), start), run(drive, -reversals(), -start)
    assert np.array_equal(there, -back) == effect.odd


SIZES = st.tuples(*(st.floats(-1.0, 1.0) for _ in range(3)))
LEVELS = st.floats(0.0, 1.0)


def simulated(drive, torque, start):
    """((n, ny) outputs, (n, 3) speeds and twist)."""
    plant = plant_of(drive, OUTPUTS[:3])
    trace = Trace(np.asarray(torque, float)[:, None], np.zeros((len(torque), 3)), STEP)
    return plant.simulate(trace, np.array([start[0], start[1], 0.05 * start[2]]), keep=True)[:2]


def energy(drive, states):
    """(n,) kinetic and elastic energy [J]."""
    value, squares = drive.value, states**2
    wound = np.maximum(np.abs(states[:, 2]) - value("shaft.half_gap"), 0.0)
    return 0.5 * (value("motor.inertia") * squares[:, 0] + value("load.inertia") * squares[:, 1]
                  + value("shaft.stiffness") * wound**2)


@EACH_DAMPING_LAW
@pytest.mark.parametrize("suffix", ["viscous", "coulomb", "damping"])
@HYPOTHESIS_SETTINGS
@given(start=SIZES, level=LEVELS, half_gap=st.sampled_from([0.0, 0.002, 0.02]))
def test_friction_never_gives_energy(law, suffix, start, level, half_gap):
    owner = ["shaft"] if suffix == "damping" else ["motor", "load"]
    values = {"motor.inertia": 0.6, "load.inertia": 5.2, "shaft.stiffness": 3300.0,
              "shaft.half_gap": half_gap} | {f"{o}.{suffix}": 10.0 * level for o in owner}
    drive = replace(two_mass(), values=values, damping_law=law)
    stored = energy(drive, simulated(drive, np.zeros(250), start)[1])
    assert np.diff(stored).max() <= 1e-11 * (1.0 + stored[0])


@HYPOTHESIS_SETTINGS
@given(start=SIZES, level=st.floats(0.0, 3.0), half_gap=st.sampled_from([1e-4, 0.002, 0.02]))
def test_a_dead_zone_with_the_damping_inside_never_pulls(start, level, half_gap):
    """Torque only in the direction in which the contact is pressed, however large the damping."""
    values = {"motor.inertia": 0.6, "load.inertia": 5.2, "shaft.stiffness": 3300.0,
              "shaft.damping": 10.0**level, "shaft.half_gap": half_gap}
    torque = 30.0 * np.sign(np.sin(np.arange(400) / 17.0))
    out, states = simulated(replace(two_mass(), values=values), torque, start)
    push = 3300.0 * states[:, 2] + 10.0**level * (states[:, 0] - states[:, 1])
    assume(np.abs(out[:, 2]).max() > 1e-6)
    assert np.all(out[:, 2] * push >= 0.0)
    expected = np.sign(push) * np.maximum(np.abs(push) - 3300.0 * half_gap, 0.0)
    np.testing.assert_allclose(out[:, 2], expected, atol=1e-8)


def test_the_damping_that_acts_always_does_pull():
    """According to chapter 6: negative torque at a positive twist."""
    for law, pulls in (("inside", False), ("always", True)):
        values = {k: v for k, v in base().values.items() if "converter" not in k}
        drive = replace(two_mass(), values=values | {"shaft.damping": 60.0}, damping_law=law)
        out, states = simulated(drive, reversals(), (0.0, 0.0, 0.0))
        wound = np.where(np.abs(states[:, 2]) > 0.01, np.sign(states[:, 2]), 0.0)
        assert bool(np.any(out[:, 2] * wound < -1e-3)) == pulls
