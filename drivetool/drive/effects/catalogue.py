"""The catalogue: every effect, in the order in which they are stamped."""

from collections.abc import Callable, Mapping

from drivetool.drive.effects import (
    added_inertia,
    asymmetry,
    backlash,
    breakaway,
    carried_mass,
    clamp,
    converter,
    coulomb,
    dead_time,
    drag,
    drift,
    friction_factor,
    gap_damping,
    hardening,
    idle_torque,
    imbalance,
    induction,
    inertia,
    interpolation,
    load_damping,
    load_step,
    lugre,
    ripple,
    shaft,
    speed_filter,
    stribeck,
    torque_constant,
    transmission_loss,
    viscous,
    warm_up,
)
from drivetool.drive.effects.catalogue_check import check_effects
from drivetool.drive.effects.effect import Effect
from drivetool.quantity import name_of

EFFECTS: tuple[Effect, ...] = (
    inertia.EFFECT,
    added_inertia.EFFECT,
    carried_mass.EFFECT,
    clamp.EFFECT,
    viscous.EFFECT,
    coulomb.EFFECT,
    idle_torque.EFFECT,
    shaft.EFFECT,
    backlash.EFFECT,
    gap_damping.EFFECT,
    torque_constant.EFFECT,
    converter.EFFECT,
    dead_time.EFFECT,
    interpolation.EFFECT,
    stribeck.EFFECT,
    breakaway.EFFECT,
    asymmetry.EFFECT,
    drag.EFFECT,
    drift.EFFECT,
    friction_factor.EFFECT,
    warm_up.EFFECT,
    ripple.EFFECT,
    imbalance.EFFECT,
    load_step.EFFECT,
    hardening.EFFECT,
    load_damping.EFFECT,
    speed_filter.EFFECT,
    induction.EFFECT,
    lugre.EFFECT,
    transmission_loss.EFFECT,
)

# The smooth laws; the kernel uses their position. Effects may share one.
LAW_TORQUES: tuple[Callable, ...] = tuple(dict.fromkeys(e.torque for e in EFFECTS if e.torque is not None))
# Parameters of which a record identifies only the sum over all bodies, referred to the motor: behind a reduction n
# a torque counts 1/n and a friction coefficient 1/n^2.
TOTALS: Mapping[str, str] = {name_of("total", suffix): suffix for e in EFFECTS for suffix in e.total}
TOTAL_RULES: Mapping[str, str] = {suffix: rule for e in EFFECTS for suffix, rule in e.total.items()}
# Power of n by which a parameter is divided when it is referred to the motor.
GEAR_RATIO_EXPONENTS: Mapping[str, int] = {suffix: power for e in EFFECTS for suffix, power in e.referred.items()}
FRICTION_SUFFIXES = frozenset(suffix for e in EFFECTS for suffix in e.friction)
OPTIONAL_SUFFIXES = frozenset(suffix for e in EFFECTS if not e.required for suffix in e.quantities)
# Roles that an effect turns into torques: no torque on a body by themselves.
EFFECT_INPUTS = frozenset(role for e in EFFECTS for role in e.inputs)

check_effects(EFFECTS)

__all__ = ["EFFECTS", "LAW_TORQUES", "Effect"]
