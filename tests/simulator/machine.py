"""The machine that is simulated: a chain of bodies, its shafts and its torque path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from tests.simulator.effects import NONE, Effects

Law = Literal["inside", "always", "contact"]
BODY_FIELDS = ("inertia", "viscous", "coulomb", "idle_torque")
SHAFT_FIELDS = ("stiffness", "damping", "half_gap", "ratio")


@dataclass(frozen=True)
class Machine:
    """A chain of n bodies and n-1 shafts; the motor torque enters body 0.

    inertia      (n,) [kg m^2, or kg for a linear axis]
    viscous      (n,) [Nm s/rad]; empty is zero, also for the other tuples
    coulomb      (n,) [Nm], set-valued: the body sticks while the other torques stay below it
    idle_torque  (n,) [Nm], constant, opposes positive motion; not a friction
    stiffness    (n-1,) [Nm/rad]
    damping      (n-1,) [Nm s/rad]
    half_gap     (n-1,) [rad]
    ratio        (n-1,) twist = angle/ratio - next angle; empty is one
    law          "inside": Ts = ks dead(twist + cs/ks d(twist)/dt, a), which never pulls;
                 "always": Ts = ks dead(twist, a) + cs d(twist)/dt
                 "contact", of Nordin, Galic, Gutman 1997: Ts = ks (twist - b) + cs d(twist - b)/dt, where
                 the place b in the gap, |b| <= a, is such that Ts = 0 until b is at an end of the gap and
                 Ts has its sign
    converter_bandwidth  [rad/s] or None: T'' + 2 zeta w0 T' + w0^2 T = w0^2 u(t - dead_time);
                 of first order, T' = w0 (u(t - dead_time) - T), where converter_damping is infinite
    dead_time    [s], any fraction of a sample
    rated_torque [Nm] or None; a scale for experiments, no part of the physics
    effects      further laws, see Effects
    """

    inertia: tuple[float, ...]
    viscous: tuple[float, ...] = ()
    coulomb: tuple[float, ...] = ()
    idle_torque: tuple[float, ...] = ()
    stiffness: tuple[float, ...] = ()
    damping: tuple[float, ...] = ()
    half_gap: tuple[float, ...] = ()
    ratio: tuple[float, ...] = ()
    law: Law = "inside"
    converter_bandwidth: float | None = None
    converter_damping: float = 0.69
    dead_time: float = 0.0
    rated_torque: float | None = None
    effects: Effects = NONE

    def __post_init__(self):
        n = len(self.inertia)
        for name in (*BODY_FIELDS, *SHAFT_FIELDS):
            size = n if name in BODY_FIELDS else n - 1
            neutral = (1.0 if name == "ratio" else 0.0,) * size
            # Python floats: NumPy scalars are several times slower in the equations.
            values = tuple(float(v) for v in getattr(self, name)) or neutral
            if len(values) != size:
                raise ValueError(f"{name}: wanted {size} values, found {len(values)}")
            object.__setattr__(self, name, values)
        if min(self.inertia) <= 0 or min(self.stiffness, default=1.0) <= 0:
            raise ValueError("inertia and stiffness must be positive")
        unsigned = (*self.viscous, *self.coulomb, *self.damping, *self.half_gap, self.dead_time)
        if min(unsigned) < 0 or self.law not in get_args(Law):
            raise ValueError("friction, damping, gap and dead time must not be negative; "
                             "law is inside, always or contact")
        if self.law == "contact" and (self.effects.hardening_twist or self.effects.damping_torque):
            raise ValueError("law contact is of shafts with constant stiffness and damping")
        back = self.effects.of("coulomb_back", n)
        if any(self.coulomb[i] <= 0 or back[i] <= 0 for i in self.lugre):
            raise ValueError("LuGre friction needs a Coulomb level on its body, in both directions")
        shares = [share for both in self.losses.values() for share in both]
        if min(shares, default=0.0) < 0.0 or max(shares, default=0.0) > 0.9 or set(self.losses) & set(self.lugre):
            raise ValueError("losses lie between 0 and 0.9, and not on a body with LuGre friction")
        if not 0.0 <= self.effects.rotor_inertia < self.inertia[0] or (n > 1 and self.effects.rotor_inertia):
            raise ValueError("the rotor is a part of the inertia of one body alone")

    @property
    def bodies(self) -> int:
        """Number of bodies."""
        return len(self.inertia)

    @property
    def lugre(self) -> tuple[int, ...]:
        """Bodies with LuGre friction."""
        stiffness = self.effects.of("lugre_stiffness", self.bodies)
        return tuple(i for i, s0 in enumerate(stiffness) if s0)

    @property
    def losses(self) -> dict[int, tuple[float, float]]:
        """Body behind a transmission -> what is lost of its torque, driving and driven."""
        size = max(self.bodies - 1, 1)
        both = zip(self.effects.of("loss_driving", size), self.effects.of("loss_driven", size), strict=True)
        return {i: shares for i, shares in enumerate(both, start=self.bodies > 1) if any(shares)}

    @property
    def places(self) -> tuple[int, ...]:
        """Shafts whose place in the gap is a state of its own; without damping it follows the twist."""
        return tuple(k for k, (gap, cs) in enumerate(zip(self.half_gap, self.damping, strict=True))
                     if self.law == "contact" and gap and cs)

    @property
    def is_linear(self) -> bool:
        """Neither gap nor Coulomb friction nor another law: nothing ever switches."""
        return not any(self.half_gap) and not any(self.coulomb) and self.effects.none


@dataclass(frozen=True)
class State:
    """Where a simulation starts or ends.

    speeds       (n,) [rad/s]
    twists       (n-1,) [rad]
    angle        of body 0 [rad]
    torque       [Nm] behind the converter, and the command in force before the first sample
    torque_rate  [Nm/s] behind the converter
    bristles     (n,) [rad] z of LuGre friction; empty is zero
    places       (n-1,) [rad] b of law "contact"; empty is the twist or the end of the gap next to it
    """

    speeds: tuple[float, ...]
    twists: tuple[float, ...]
    angle: float = 0.0
    torque: float = 0.0
    torque_rate: float = 0.0
    bristles: tuple[float, ...] = ()
    places: tuple[float, ...] = ()

    def places_in(self, machine: Machine) -> tuple[float, ...]:
        """(n-1,) [rad] b; ValueError outside the gap."""
        if any(abs(b) > gap for b, gap in zip(self.places, machine.half_gap, strict=bool(self.places))):
            raise ValueError(f"places {self.places} are not within the gaps {machine.half_gap}")
        return self.places or tuple(
            min(max(twist, -gap), gap) for twist, gap in zip(self.twists, machine.half_gap, strict=True))


def at_rest(machine: Machine) -> State:
    """No speed, no twist, no torque."""
    return State((0.0,) * machine.bodies, (0.0,) * (machine.bodies - 1))


def running(machine: Machine, speed: float, load_torque: float = 0.0) -> State:
    """Steady running of body 0 at `speed` [rad/s]; `torque` is what keeps it there.

    At zero speed Coulomb friction is counted as zero, the middle of what it can hold. The Stribeck effect is
    not counted, and bristles of LuGre friction are not bent yet.
    """
    speeds = [speed]
    for ratio in machine.ratio:
        speeds.append(speeds[-1] / ratio)
    twists, through = [], load_torque
    for i in reversed(range(machine.bodies)):
        through += machine.viscous[i] * speeds[i] + machine.idle_torque[i]
        through += machine.coulomb[i] * float(np.sign(speeds[i]))
        driving, driven = machine.losses.get(i, (0.0, 0.0))
        if through * speeds[i]:
            through /= 1.0 - driving if through * speeds[i] > 0.0 else 1.0 + driven
        if i:
            gap = machine.half_gap[i - 1] * float(np.sign(through))
            twists.insert(0, through / machine.stiffness[i - 1] + gap)
            through /= machine.ratio[i - 1]
    return State(tuple(speeds), tuple(twists), 0.0, through)


def machine_by_seed(seed: int, gap: float = 0.0, friction: bool = False, **changes) -> Machine:
    """A plausible two-mass machine; the same seed with another gap is otherwise the same machine.

    gap       half gap as a share of the rated twist (rated torque / stiffness)
    friction  whether there is Coulomb friction, on motor and load
    changes   any field of Machine to replace
    """
    rng = np.random.default_rng(seed)
    motor = 10.0 ** rng.uniform(-1.0, 1.0)
    load = motor * 10.0 ** rng.uniform(-1.0, 1.0)
    resonance = 2.0 * np.pi * 5.0 * 12.0 ** rng.uniform()
    relative_damping = rng.uniform(0.01, 0.05)
    rated = (motor + load) * rng.uniform(20.0, 80.0)
    viscous = rng.uniform(0.005, 0.03, 2) * rated / 150.0
    idle = rng.uniform(0.02, 0.1) * rated
    coulomb = rng.uniform([0.01, 0.005], [0.04, 0.02]) * rated * friction
    reduced = motor * load / (motor + load)
    stiffness = reduced * resonance**2
    values = {
        "inertia": (motor, load), "viscous": tuple(viscous), "coulomb": tuple(coulomb),
        "idle_torque": (0.0, idle), "stiffness": (stiffness,),
        "damping": (2.0 * relative_damping * reduced * resonance,),
        "half_gap": (gap * rated / stiffness,), "rated_torque": float(rated),
    } | changes
    return Machine(**values)
