"""The drive near steady running: each law by its tangent. Every loop of `tune` is built around this drive.

The working point is a speed of the first motor, forward unless it is negative, with no load torque beyond the
drive's own friction. A gap and Coulomb friction remain: the linear loop has the contact closed and the bodies
moving, the simulation has both as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from scipy.optimize import brentq

from drivetool.drive import AT, MOTOR, TOTALS, Assembly, Drive, Law, Layout
from drivetool.drive.effects import LAW_TORQUES
from drivetool.errors import BadParameters

# What each effect of the catalogue is to the loop, by its code; `check_known` refuses one that stands nowhere.
LINEAR = frozenset({"inertia", "added-inertia", "carried-mass", "clamp", "viscous", "shaft", "converter-lag",
                    "damping-in-gap", "dead-time", "friction-factor", "speed-filter"})
TANGENT: Mapping[str, str] = MappingProxyType({  # code -> its law
    "stribeck": "stribeck", "breakaway": "breakaway", "asymmetric-friction": "asymmetry", "quadratic-drag": "drag",
    "hardening-stiffness": "hardening", "load-dependent-damping": "load-damping"})
SIMULATED: Mapping[str, str] = MappingProxyType({
    "coulomb": "constant while a body moves; the simulation has it",
    "idle-torque": "constant; the simulation has it",
    "backlash": "the contact is closed; the simulation and the softened shaft have the gap"})
LEFT_OUT: Mapping[str, str] = MappingProxyType({
    "torque-constant": "makes a torque of a logged current or voltage; the loop is in torques",
    "induction-motor": "makes a torque of the supply's voltages; the loop is in torques",
    "torque-hold": "says how the torque was logged between two samples",
    "friction-drift": "fades while the drive warms up; the loop is that of the warm drive",
    "warm-up": "fades while the drive warms up; the loop is that of the warm drive",
    "torque-ripple": "a disturbance that repeats with the angle",
    "imbalance": "a disturbance that repeats with the angle",
    "load-step": "a disturbance at one time of a recording"})
OF_RECORDINGS = "holds in one recording only"
FLAT = ("stribeck", "quadratic-drag")  # without a slope at standstill
SLOW = 1e-60  # of a speed whose direction matters; a power of it, as Stribeck friction has, is nothing yet


def acting(drive: Drive) -> dict[str, list[str]]:
    """Code -> the parameters by which an effect that need not be there acts on this drive, in all recordings."""
    found: dict[str, list[str]] = {}
    for effect, owner, _ in drive.effects():
        for name in (f"{owner}.{suffix}" for suffix in effect.present):
            if drive.value(name) not in (None, drive.quantity(name).neutral):
                found.setdefault(effect.code, []).append(name)
    return found


def left_out(drive: Drive) -> dict[str, list[str]]:
    """Reason -> the parameters that the loop does not have for it; see LEFT_OUT."""
    found: dict[str, list[str]] = {}
    for code, names in acting(drive).items():
        if code in LEFT_OUT:
            found.setdefault(LEFT_OUT[code], []).extend(names)
    if own := [name for name in drive.values if AT in name]:
        found[OF_RECORDINGS] = own
    return found


def check_known(drive: Drive) -> None:
    """Refuse an effect that the loop knows nothing of.

    raises  BadParameters: naming its parameters
    """
    known = {*LINEAR, *TANGENT, *SIMULATED, *LEFT_OUT}
    strange = [name for code, names in acting(drive).items() if code not in known for name in names]
    if strange:
        raise BadParameters("parameters that a speed loop can have", ", ".join(strange),
                            "Delete them, or set them to their neutral value with --set.")


def at_working_point(drive: Drive, speed: float) -> Drive:
    """The drive with viscous friction, stiffness and damping as they are near a speed of the first motor.

    speed    [drive's unit]; zero is slow motion forward
    returns  Drive without smooth laws; viscous friction may be negative, the constant part of a tangent is in
             coulomb (Stribeck) or idle_torque. Done twice, it changes nothing
    raises   BadParameters: an effect that is not known, or a softening shaft that cannot carry the friction
    """
    check_known(drive)
    codes = acting(drive)
    own = any(AT in name for name in drive.values)
    if not own and codes.keys().isdisjoint({*TANGENT, *LEFT_OUT, "friction-factor"}):
        return drive
    drive = replace(drive, values={k: v for k, v in drive.values.items() if AT not in k})
    plain = Assembly(drive, Layout((), (MOTOR,), (), 1.0, gradient=False))
    # A total is shared out before any slope is added to its parts.
    gone = {*TOTALS, *(f"{owner}.{suffix}" for effect, owner, _ in drive.effects() for suffix in effect.quantities
                       if effect.code in {*TANGENT, *LEFT_OUT, "friction-factor"})}
    values = {k: v for k, v in drive.values.items() if k not in gone}
    for k, body in enumerate(drive.bodies):
        values |= _body(plain, k, body, (speed or SLOW) / drive.turns()[k])
    straight = replace(drive, values=values)
    torques, _ = carried(straight, speed, 0.0, np.copysign(1.0, speed))
    for k, shaft in enumerate(drive.shafts):
        values |= _shaft(plain, k, shaft, torques[k])
    return replace(drive, values=values)


def carried(drive: Drive, speed: float, load: float, direction: float) -> tuple[list[float], float]:
    """(torque in each shaft, torque of all motors) in steady running, from viscous and constant friction.

    speed      of the first motor; load: torque at the last body; direction: 1, -1, or 0 at standstill
    """
    plain = Assembly(drive, Layout((), (MOTOR,), (), 1.0, gradient=False))
    speeds = speed / np.array(drive.turns())
    own = [plain.of_body(k, "viscous").v * w + plain.of_body(k, "idle_torque").v
           + plain.of_body(k, "coulomb").v * direction for k, w in enumerate(speeds)]
    torques, wanted = [0.0] * len(drive.shafts), load
    for k in range(len(drive.shafts) - 1, -1, -1):  # from the load inwards
        torques[k] = wanted + own[k + 1]
        wanted = torques[k] / drive.value(f"{drive.shafts[k]}.ratio")
    return torques, wanted + own[0]


def _body(plain: Assembly, index: int, body: str, speed: float) -> dict[str, float]:
    """Friction of a body as a straight line that touches it at its speed."""
    viscous, coulomb, idle = (plain.of_body(index, s).v for s in ("viscous", "coulomb", "idle_torque"))
    for law in _laws(plain, body=index):
        torque, slope = _at(law, speed, side=np.copysign(1.0, speed))
        viscous -= slope
        rest = slope * speed - torque
        if law.slides:
            coulomb += np.copysign(1.0, speed) * rest
        else:
            idle += rest
    found = {"viscous": viscous, "coulomb": coulomb, "idle_torque": idle}
    return {f"{body}.{suffix}": float(value) for suffix, value in found.items()}


def _shaft(plain: Assembly, index: int, shaft: str, torque: float) -> dict[str, float]:
    """Stiffness and damping of a shaft for small swings about the torque that it carries."""
    laws = {law.name: law for law in _laws(plain, shaft=index)}
    if not laws:
        return {}
    stiffness, damping, _ = (dual.v for dual in plain.shafts[index])
    twist, tangent = torque / stiffness, stiffness
    if "hardening" in laws:
        twist = _twist(laws["hardening"], stiffness, torque, shaft)
        tangent += _at(laws["hardening"], twist)[1]
    if "load-damping" in laws:
        damping += _at(laws["load-damping"], twist, 1.0)[0]
    return {f"{shaft}.stiffness": float(tangent), f"{shaft}.damping": float(damping)}


def _twist(law: Law, stiffness: float, torque: float, shaft: str) -> float:
    """Twist at which a hardening or softening shaft carries a torque."""
    extra, reach, power = (p.v for p in law.parameters)
    end = abs(torque) / stiffness
    if extra < 0.0:  # up to where the torque would fall again
        end = reach * (-stiffness / (extra * (1.0 + power))) ** (1.0 / power)
        if stiffness * end + _at(law, end)[0] <= abs(torque):
            raise BadParameters(
                f"a {shaft}.hardening with which the shaft carries {abs(torque):.3g} of friction",
                "a shaft that softens until it does not", f"Set {shaft}.hardening=0 and the stiffness under load.")
    size = brentq(lambda z: stiffness * z + _at(law, z)[0] - abs(torque), 0.0, end) if torque else 0.0
    return float(np.copysign(size, torque))


def _laws(plain: Assembly, body: int = -1, shaft: int = -1) -> Sequence[Law]:
    """The laws of one body or shaft that have a tangent."""
    return [law for law in plain.laws if law.name in TANGENT.values() and (law.body, law.shaft) == (body, shaft)]


def _at(law: Law, first: float, second: float = 0.0, side: float = 1.0) -> tuple[float, float]:
    """(torque of a law, its slope over the first argument)."""
    parameters, out = np.array([p.jet() for p in law.parameters]), np.zeros(3 + len(law.parameters))
    LAW_TORQUES[law.name](first, second, 0.0, side, parameters, out)
    return float(out[0]), float(out[1])
