"""The drive near steady running: each law replaced by its tangent. Every loop of `tune` is built around this drive.

The working point is a speed of the first motor, forward unless it is negative, with no load torque beyond the
drive's own friction. A gap and Coulomb friction remain: the linear loop has the contact closed and the bodies
moving, the simulation includes both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import scipy

from drivetool.drive import MOTOR_TORQUE, TOTALS, Assembly, Drive, Law, Layout
from drivetool.drive.effects import EFFECTS, hardening, load_damping
from drivetool.errors import BadParameters
from drivetool.quantity import name_of, record_of

# Treatment of each effect of the catalogue, by its code; `check_known_effects` rejects one that is not listed.
LINEAR_EFFECTS = frozenset({"inertia", "added-inertia", "carried-mass", "clamp", "viscous", "shaft",
                            "converter-lag",
                            "damping-in-gap", "dead-time", "friction-factor", "speed-filter"})
TANGENT_LAWS = frozenset({"stribeck", "breakaway", "asymmetric-friction", "quadratic-drag", "hardening-stiffness",
                          "load-dependent-damping"})
SIMULATED_EFFECTS: Mapping[str, str] = MappingProxyType({
    "coulomb": "constant for one direction of motion; only the simulation includes it",
    "idle-torque": "constant; only the simulation includes it",
    "backlash": "the linear loop assumes contact; the simulation and the describing function include the gap"})
LEFT_OUT_EFFECTS: Mapping[str, str] = MappingProxyType({
    "torque-constant": "makes a torque of a logged current or voltage; the loop is in torques",
    "induction-motor": "makes a torque of the supply's voltages; the loop is in torques",
    "torque-hold": "states how the torque was logged between two samples",
    "friction-drift": "fades while the drive warms up; the loop is that of the warm drive",
    "warm-up": "fades while the drive warms up; the loop is that of the warm drive",
    "torque-ripple": "a disturbance that repeats with the angle",
    "imbalance": "a disturbance that repeats with the angle",
    "load-step": "a disturbance at one time of a recording",
    "transmission-loss": "grows with the torque transmitted; the loop is that of a drive without it",
    "bristle-friction": "a spring before the friction slides; the loop is that of a moving drive"})
ONE_RECORDING_REASON = "holds in one recording only"
FLAT_AT_STANDSTILL = ("stribeck", "quadratic-drag")  # without a slope at standstill
SLOW_SPEED = 1e-60  # a speed with a direction only: its powers in friction laws are negligible and do not underflow


def acting_effects(drive: Drive) -> dict[str, list[str]]:
    """Code -> the parameters by which an optional effect acts on this drive, in all recordings."""
    found: dict[str, list[str]] = {}
    for effect, owner, _ in drive.effects():
        for name in (name_of(owner, suffix) for suffix in effect.present):
            if drive.value(name) not in (None, drive.quantity(name).neutral):
                found.setdefault(effect.code, []).append(name)
    return found


def left_out_parameters(drive: Drive) -> dict[str, list[str]]:
    """Reason -> the parameters that the loop does not have for it; see LEFT_OUT_EFFECTS."""
    found: dict[str, list[str]] = {}
    for code, names in acting_effects(drive).items():
        if code in LEFT_OUT_EFFECTS:
            found.setdefault(LEFT_OUT_EFFECTS[code], []).extend(names)
    if own := [name for name in drive.values if record_of(name)]:
        found[ONE_RECORDING_REASON] = own
    return found


def check_known_effects(drive: Drive) -> None:
    """Reject an effect that the loop does not cover.

    raises  BadParameters: naming its parameters
    """
    known = {*LINEAR_EFFECTS, *TANGENT_LAWS, *SIMULATED_EFFECTS, *LEFT_OUT_EFFECTS}
    unknown = [name for code, names in acting_effects(drive).items() if code not in known for name in names]
    if unknown:
        raise BadParameters("parameters that the speed loop can include", ", ".join(unknown),
                            "Delete them, or set them to their neutral value with --set.")


def at_working_point(drive: Drive, speed: float) -> Drive:
    """The drive with viscous friction, stiffness and damping linearised at a speed of the first motor.

    speed    [drive's unit]; zero is slow motion forward
    returns  Drive without smooth laws; viscous friction may be negative, the constant part of a tangent is in
             coulomb (Stribeck) or idle_torque. Idempotent
    raises   BadParameters: an unknown effect, or a softening shaft that cannot carry the friction
    """
    check_known_effects(drive)
    codes = acting_effects(drive)
    own = any(record_of(name) for name in drive.values)
    if not own and codes.keys().isdisjoint({*TANGENT_LAWS, *LEFT_OUT_EFFECTS, "friction-factor"}):
        return drive
    left_out = {name for names in left_out_parameters(drive).values() for name in names}
    drive = replace(drive, values={k: v for k, v in drive.values.items() if k not in left_out})
    plain = Assembly(drive, Layout((), (MOTOR_TORQUE,), (), 1.0, gradient=False))
    # A total is split before any slope is added to its parts.
    removed = {*TOTALS, *(name_of(owner, suffix) for effect, owner, _ in drive.effects()
                          for suffix in effect.quantities
                          if effect.code in {*TANGENT_LAWS, *LEFT_OUT_EFFECTS, "friction-factor"})}
    values = {k: v for k, v in drive.values.items() if k not in removed}
    for k, body in enumerate(drive.bodies):
        values |= _body_tangent(plain, k, body, (speed or SLOW_SPEED) / drive.gear_ratios()[k])
    linearised = replace(drive, values=values)
    torques, _ = steady_torques(linearised, speed, 0.0, np.copysign(1.0, speed))
    for k, shaft in enumerate(drive.shafts):
        values |= _shaft_tangent(plain, k, shaft, torques[k])
    return replace(drive, values=values)


def steady_torques(drive: Drive, speed: float, load: float, direction: float) -> tuple[list[float], float]:
    """(torque in each shaft, torque of all motors) in steady running, from viscous and constant friction.

    speed      of the first motor; load: torque at the last body; direction: 1, -1, or 0 at standstill
    """
    plain = Assembly(drive, Layout((), (MOTOR_TORQUE,), (), 1.0, gradient=False))
    speeds = speed / np.array(drive.gear_ratios())
    own = [plain.of_body(k, "viscous").v * w + plain.of_body(k, "idle_torque").v
           + plain.of_body(k, "coulomb").v * direction for k, w in enumerate(speeds)]
    torques, outer_torque = [0.0] * len(drive.shafts), load
    for k in range(len(drive.shafts) - 1, -1, -1):  # from the load inwards
        torques[k] = outer_torque + own[k + 1]
        outer_torque = torques[k] / drive.value(name_of(drive.shafts[k], "ratio"))
    return torques, outer_torque + own[0]


def _body_tangent(plain: Assembly, index: int, body: str, speed: float) -> dict[str, float]:
    """Friction of a body as its tangent at a speed."""
    viscous, coulomb, idle = (plain.of_body(index, s).v for s in ("viscous", "coulomb", "idle_torque"))
    for law in _laws_with_tangent(plain, body=index):
        torque, slope = _torque_and_slope(law, speed, side=np.copysign(1.0, speed))
        viscous -= slope
        rest = slope * speed - torque
        if law.slides:
            coulomb += np.copysign(1.0, speed) * rest
        else:
            idle += rest
    found = {"viscous": viscous, "coulomb": coulomb, "idle_torque": idle}
    return {name_of(body, suffix): float(value) for suffix, value in found.items()}


def _shaft_tangent(plain: Assembly, index: int, shaft: str, torque: float) -> dict[str, float]:
    """Stiffness and damping of a shaft for small swings about the torque that it carries."""
    laws = {law.torque: law for law in _laws_with_tangent(plain, shaft=index)}
    if not laws:
        return {}
    stiffness, damping, _ = (dual.v for dual in plain.shafts[index])
    twist, tangent = torque / stiffness, stiffness
    if hardens := laws.get(hardening.torque):
        twist = _twist_under_torque(hardens, stiffness, torque, shaft)
        tangent += _torque_and_slope(hardens, twist)[1]
    if damps := laws.get(load_damping.torque):
        damping += _torque_and_slope(damps, twist, 1.0)[0]
    return {name_of(shaft, "stiffness"): float(tangent), name_of(shaft, "damping"): float(damping)}


def _twist_under_torque(law: Law, stiffness: float, torque: float, shaft: str) -> float:
    """Twist at which a hardening or softening shaft carries a torque."""
    extra, reach, power = (p.v for p in law.parameters)
    end = abs(torque) / stiffness
    if extra < 0.0:  # up to where the torque would fall again
        end = reach * (-stiffness / (extra * (1.0 + power))) ** (1.0 / power)
        if stiffness * end + _torque_and_slope(law, end)[0] <= abs(torque):
            raise BadParameters(
                f"a {shaft}.hardening that gives an equilibrium under {abs(torque):.3g} of friction",
                "a shaft that softens too much", f"Set {shaft}.hardening=0 and the stiffness under load.")
    size = scipy.optimize.brentq(lambda z: stiffness * z + _torque_and_slope(law, z)[0] - abs(torque),
                                 0.0, end) if torque else 0.0
    return float(np.copysign(size, torque))


def _laws_with_tangent(plain: Assembly, body: int = -1, shaft: int = -1) -> Sequence[Law]:
    """The laws of one body or shaft that have a tangent."""
    tangent = {effect.torque for effect in EFFECTS if effect.code in TANGENT_LAWS}
    return [law for law in plain.laws if law.torque in tangent and (law.body, law.shaft) == (body, shaft)]


def _torque_and_slope(law: Law, first: float, second: float = 0.0, side: float = 1.0) -> tuple[float, float]:
    """(torque of a law, its slope over the first argument)."""
    parameters, out = np.array([p.jet() for p in law.parameters]), np.zeros(3 + len(law.parameters))
    law.torque(first, second, 0.0, side, parameters, out)
    return float(out[0]), float(out[1])
