"""Every effect that can be hidden: its size in words, what it does to a machine or its logger.

Sizes are relative, so that one number means as much on a small machine as on a large one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tests.hidden.rigs import Rig, resonances
from tests.simulator.machine import Machine


@dataclass(frozen=True)
class Logger:
    """What the logger makes of what the sensors gave, by role.

    scale, offset  logged = scale * (value + offset); resolution of the quantiser afterwards
    spikes         (count per record, height) of values that are wrong for one sample
    """

    scale: Mapping[str, float] = field(default_factory=dict)
    offset: Mapping[str, float] = field(default_factory=dict)
    resolution: Mapping[str, float] = field(default_factory=dict)
    spikes: Mapping[str, tuple[int, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class HiddenEffect:
    """One hidden effect of a machine.

    code, size  as requested
    machine     with the effect
    logger      with the effect
    truth       parameter -> value in SI
    """

    code: str
    size: float
    machine: Machine
    logger: Logger
    truth: Mapping[str, float]


@dataclass(frozen=True)
class Kind:
    """How an effect is hidden.

    hide      (rig, machine, logger, size, generator) -> (machine, logger, truth)
    size      in words
    usual     a size that a record of twelve seconds shows clearly on most machines
    coulomb   body -> share of the rated torque: Coulomb friction that the plain fit knows of
    needs     roles that must be logged for the effect to be there at all, any one of a tuple
    bodies    fewest bodies
    """

    hide: Callable
    size: str
    usual: float
    coulomb: Mapping[int, float] = field(default_factory=dict)
    needs: tuple[tuple[str, ...], ...] = ()
    bodies: int = 1


def hide(code: str, rig: Rig, machine: Machine, logger: Logger, size: float | None, seed: int) -> HiddenEffect:
    """Hide one effect in a machine that may have others already.

    size    as in the kind's words, or None for the usual
    raises  ValueError: no such effect, or not on this machine
    """
    if code not in KINDS:
        raise ValueError(f"effect: wanted one of {', '.join(KINDS)}, found {code!r}")
    kind = KINDS[code]
    if machine.bodies < kind.bodies:
        raise ValueError(f"{code}: wanted {kind.bodies} bodies, found {machine.bodies}")
    size = kind.usual if size is None else float(size)
    rng = np.random.default_rng([seed, list(KINDS).index(code)])
    machine, logger, truth = kind.hide(rig, machine, logger, size, rng)
    return HiddenEffect(code, size, machine, logger, {name: float(v) for name, v in truth.items()})


def _law(machine: Machine, **changes) -> Machine:
    return replace(machine, effects=replace(machine.effects, **changes))


def _with_value(values, index: int, value: float, size: int, neutral: float) -> tuple[float, ...]:
    """A tuple with one value replaced; index -1 is the last."""
    values = list(values or (neutral,) * size)
    values[index] = value
    return tuple(values)


def _owner(rig: Rig, index: int) -> str:
    return rig.bodies[index]


def _backlash(rig, machine, logger, size, _rng):
    gap = size * rig.rated / machine.stiffness[0]
    return (replace(machine, half_gap=_with_value(machine.half_gap, 0, gap, machine.bodies - 1, 0.0)), logger,
            {"shaft.half_gap": gap})


def _coulomb(index):
    def change(rig, machine, logger, size, _rng):
        level = size * rig.rated
        return (replace(machine, coulomb=_with_value(machine.coulomb, index, level, machine.bodies, 0.0)), logger,
                {f"{_owner(rig, index)}.coulomb": level})
    return change


def _stribeck(index):
    def change(rig, machine, logger, size, rng):
        extra, speed, n = size * rig.rated, rng.uniform(0.03, 0.12) * rig.top, machine.bodies
        owner, coulomb = _owner(rig, index), machine.coulomb[index]
        law = {"stribeck": _with_value(machine.effects.stribeck, index, extra, n, 0.0),
               "stribeck_speed": _with_value(machine.effects.stribeck_speed, index, speed, n, 1.0)}
        return _law(machine, **law), logger, {
            f"{owner}.coulomb": coulomb, f"{owner}.breakaway": coulomb + extra,
            f"{owner}.stribeck_speed": speed}
    return change


def _asymmetric(rig, machine, logger, size, _rng):
    extra, n, e = size * rig.rated, machine.bodies, machine.effects
    viscous, coulomb = machine.viscous[0] + extra / rig.top, machine.coulomb[0] + 0.5 * extra
    law = _law(machine, viscous_back=_with_value(e.viscous_back, 0, machine.viscous[0], n, math.nan),
               coulomb_back=_with_value(e.coulomb_back, 0, machine.coulomb[0], n, math.nan))
    changed = replace(law, viscous=_with_value(machine.viscous, 0, viscous, n, 0.0),
                      coulomb=_with_value(machine.coulomb, 0, coulomb, n, 0.0))
    return changed, logger, {
        "motor.viscous": viscous, "motor.viscous_back": machine.viscous[0],
        "motor.coulomb": coulomb, "motor.coulomb_back": machine.coulomb[0]}


def _quadratic(rig, machine, logger, size, _rng):
    drag = size * rig.rated / rig.top**2
    return (_law(machine, quadratic=_with_value(machine.effects.quadratic, -1, drag, machine.bodies, 0.0)), logger,
            {f"{_owner(rig, -1)}.quadratic_drag": drag})


def _hardening(rig, machine, logger, size, rng):
    power, n = float(rng.choice([1.0, 1.5, 2.0, 2.0, 3.0])), machine.bodies - 1
    twist = rig.rated / machine.stiffness[0] / size ** (1.0 / power) if size > 0 else math.inf
    e = machine.effects
    return _law(machine, hardening_twist=_with_value(e.hardening_twist, 0, twist, n, math.inf),
                hardening_power=_with_value(e.hardening_power, 0, power, n, 2.0)), logger, {
        "shaft.hardening_twist": twist, "shaft.hardening_power": power}


def _load_dependent_damping(rig, machine, logger, size, _rng):
    torque = rig.rated / size if size > 0 else math.inf
    damping = _with_value(machine.effects.damping_torque, 0, torque, machine.bodies - 1, math.inf)
    return _law(machine, damping_torque=damping), logger, {"shaft.damping_torque": torque}


def _third_mass(rig, machine, logger, size, rng):
    inertia_share, zeta = rng.uniform(1.5, 3.0), rng.uniform(0.01, 0.03)
    share = max(size, 1e-6)
    last = machine.inertia[-1]
    first, second = last * (1.0 - share), last * share
    hertz = inertia_share * max(resonances(rig.machine))
    reduced = first * second / last
    stiffness = reduced * (2.0 * math.pi * hertz) ** 2
    damping = 2.0 * zeta * reduced * 2.0 * math.pi * hertz
    n, e = machine.bodies, machine.effects

    def with_third_mass(values, value):
        return (*values, value) if values else ()
    e = replace(e, **{name: with_third_mass(getattr(e, name), neutral) for name, neutral in (
        ("stribeck", 0.0), ("stribeck_speed", 1.0), ("stribeck_power", 2.0), ("coulomb_back", math.nan),
        ("viscous_back", math.nan), ("quadratic", 0.0), ("hardening_twist", math.inf), ("hardening_power", 2.0),
        ("damping_torque", math.inf))})
    # All friction stays where it was; only a part of the load's inertia moves behind a shaft.
    changed = replace(
        machine, inertia=(*machine.inertia[:-1], first, second), viscous=(*machine.viscous, 0.0),
        coulomb=(*machine.coulomb, 0.0), idle_torque=(*machine.idle_torque, 0.0),
        stiffness=(*machine.stiffness, stiffness), damping=(*machine.damping, damping),
        half_gap=(*machine.half_gap, 0.0), ratio=(*machine.ratio, 1.0), effects=e)
    return changed, logger, {f"body{n + 1}.inertia": second, f"shaft{n}.stiffness": stiffness,
                             f"shaft{n}.damping": damping, f"body{n + 1}.local_hertz": hertz}


def _ripple(rig, machine, logger, size, rng):
    order, phase, amplitude = rng.uniform(1.5, 12.0) / rig.turn, rng.uniform(-3.0, 3.0), size * rig.rated
    return _law(machine, ripple=(amplitude, order, phase)), logger, {
        "motor.ripple_amplitude": amplitude, "motor.ripple_order": order, "motor.ripple_phase": phase}


def _imbalance(rig, machine, logger, size, rng):
    amplitude, phase = size * rig.rated, rng.uniform(-3.0, 3.0)
    return _law(machine, imbalance=(amplitude, rig.turn, phase)), logger, {
        f"{_owner(rig, -1)}.imbalance": amplitude, f"{_owner(rig, -1)}.imbalance_ratio": rig.turn,
        f"{_owner(rig, -1)}.imbalance_phase": phase}


def _dead_time(_rig, machine, logger, size, _rng):
    return replace(machine, dead_time=size * 1e-3), logger, {"converter.dead_time": size * 1e-3}


def _converter(_rig, machine, logger, size, rng):
    """Of first or of second order."""
    if size <= 0:
        return machine, logger, {"converter.bandwidth": math.inf}
    first, zeta = bool(rng.uniform() < 0.5), machine.converter_damping
    bandwidth = (1.0 if first else 2.0 * zeta) / (size * 1e-3)
    label = {"converter.order": 1.0} if first else {"converter.order": 2.0, "converter.damping": zeta}
    machine = replace(machine, converter_bandwidth=bandwidth, converter_damping=math.inf if first else zeta)
    return machine, logger, {"converter.bandwidth": bandwidth, **label}


def _speed_filter(_rig, machine, logger, size, _rng):
    return _law(machine, filter_time=size * 1e-3), logger, {"sensor.filter_time": size * 1e-3}


def _quantisation(rig, machine, logger, size, _rng):
    step = size * nominal_speed_noise(rig)
    fine = {"motor_speed": step, "load_speed": step, "motor_angle": step * 0.01, "load_angle": step * 0.01}
    if step <= 0:
        return machine, logger, {"sensor.resolution": 0.0}
    return machine, replace(logger, resolution=fine), {
        "motor_speed.resolution": step, "motor_angle.resolution": step * 0.01}


def _offset(rig, machine, logger, size, rng):
    offset = size * rig.rated * float(rng.choice([-1.0, 1.0]))
    return machine, replace(logger, offset={**logger.offset, "motor_torque": offset}), {
        "motor_torque.offset": offset}


def _load_step(rig, machine, logger, size, rng):
    torque, time = size * rig.rated, rng.uniform(0.3, 0.7) * rig.duration
    return _law(machine, load_step=(torque, time)), logger, {
        f"{_owner(rig, -1)}.load_step": torque, f"{_owner(rig, -1)}.load_step_time": time}


def _outliers(rig, machine, logger, size, rng):
    height, count = size * nominal_speed_noise(rig), int(rng.integers(5, 15))
    return machine, replace(logger, spikes={"motor_speed": (count, height)}), {
        "motor_speed.spikes": count, "motor_speed.spike_height": height}


def _drift(rig, machine, logger, size, rng):
    time = rng.uniform(0.25, 0.5) * rig.duration
    return _law(machine, drift=(size, time)), logger, {"friction.drift": size, "friction.drift_time": time}


def _sign(channel):
    def change(_rig, machine, logger, size, _rng):
        factor = -1.0 if size > 0 else 1.0
        return machine, replace(logger, scale={**logger.scale, channel: factor}), {f"{channel}.scale": factor}
    return change


def _scale(channel):
    def change(_rig, machine, logger, size, rng):
        factor = 1.0 + size * float(rng.choice([-1.0, 1.0]))
        return machine, replace(logger, scale={**logger.scale, channel: factor}), {f"{channel}.scale": factor}
    return change


def nominal_speed_noise(rig: Rig) -> float:
    """[rad/s] 0.02 on the rig of 200 Nm and 5.766 kg m^2, in proportion to acceleration on others."""
    return 0.02 / (200.0 / 5.766) * rig.rated / sum(rig.machine.inertia)


_TORQUE, _SAMPLES = "torque over rated torque", "milliseconds (samples)"
SPEED, ANGLE, SHAFT = (("motor_speed",), ("motor_angle",), ("shaft_torque",))
KINDS: dict[str, Kind] = {
    "backlash": Kind(_backlash, "half gap over rated twist", 0.1, bodies=2),
    "coulomb-motor": Kind(_coulomb(0), _TORQUE, 0.02),
    "coulomb-load": Kind(_coulomb(-1), _TORQUE, 0.02, bodies=2),
    "stribeck-motor": Kind(_stribeck(0), f"extra breakaway {_TORQUE}", 0.02, {0: 0.03}),
    "stribeck-load": Kind(_stribeck(-1), f"extra breakaway {_TORQUE}", 0.02, {-1: 0.03}, bodies=2),
    "asymmetric-friction": Kind(
        _asymmetric, f"difference of viscous {_TORQUE} at the top speed", 0.03, {0: 0.03}),
    "quadratic-drag": Kind(_quadratic, f"{_TORQUE} at the top speed", 0.05),
    "hardening-stiffness": Kind(_hardening, "rise of the secant stiffness at rated twist", 0.5, bodies=2),
    "load-dependent-damping": Kind(
        _load_dependent_damping, "rise of the damping at rated torque", 3.0, bodies=2),
    "third-mass": Kind(_third_mass, "share of the load's inertia", 0.3, bodies=2),
    "torque-ripple": Kind(_ripple, f"amplitude {_TORQUE}", 0.01),
    "imbalance": Kind(_imbalance, f"amplitude {_TORQUE}", 0.02),
    "dead-time": Kind(_dead_time, _SAMPLES, 1.4),
    "converter-lag": Kind(_converter, f"mean delay in {_SAMPLES}", 2.5),
    "speed-filter": Kind(_speed_filter, f"time constant in {_SAMPLES}", 2.0, needs=(SPEED,)),
    "quantisation": Kind(_quantisation, "resolution over nominal sensor noise", 8.0),
    "torque-offset": Kind(_offset, _TORQUE, 0.02),
    "load-step": Kind(_load_step, _TORQUE, 0.03),
    "outliers": Kind(_outliers, "height over nominal sensor noise", 30.0, needs=(SPEED,)),
    "friction-drift": Kind(_drift, "relative excess at the start", 0.5, {0: 0.03}),
    "wrong-sign": Kind(_sign("motor_speed"), "any above zero", 1.0, needs=(SPEED, ANGLE)),
    "wrong-scale": Kind(_scale("motor_speed"), "relative error of the speed", 0.03, needs=(SPEED, ANGLE)),
    "wrong-sign-shaft": Kind(_sign("shaft_torque"), "any above zero", 1.0, needs=(SHAFT,), bodies=2),
    "wrong-scale-shaft": Kind(
        _scale("shaft_torque"), "relative error of the shaft torque", 0.05, needs=(SHAFT,), bodies=2),
}
CODES = {code: code.removesuffix("-shaft") for code in KINDS}
