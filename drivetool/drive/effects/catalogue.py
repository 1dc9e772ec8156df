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
    ripple,
    shaft,
    speed_filter,
    stribeck,
    torque_constant,
    viscous,
    warm_up,
)
from drivetool.drive.effects.effect import Effect

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
)

# The smooth laws by the names under which they are stamped; the kernel uses their position. Each gives its torque
# and the derivatives over both its arguments and over its parameters.
LAW_TORQUES: Mapping[str, Callable] = {
    "stribeck": stribeck.torque,
    "breakaway": breakaway.torque,
    "asymmetry": asymmetry.torque,
    "drag": drag.torque,
    "drift": drift.torque,
    "ripple": ripple.torque,
    "load-step": load_step.torque,
    "hardening": hardening.torque,
    "load-damping": load_damping.torque,
    "product": induction.torque,
}

__all__ = ["EFFECTS", "LAW_TORQUES", "Effect"]
