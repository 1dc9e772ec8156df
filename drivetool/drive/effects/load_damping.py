"""Shaft damping that grows with the torque the shaft carries."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def torque(twist, rate, time, side, p, out):
    """d ks |twist| rate; d ks = p[0]."""
    size = abs(twist)
    out[0] = p[0, 0] * size * rate
    out[1] = p[0, 0] * rate if twist > 0.0 else -p[0, 0] * rate
    out[2] = p[0, 0] * size
    out[3] = size * rate


def stamp(assembly, shaft):
    """On top of the constant damping."""
    factor = assembly.of_shaft(shaft, "stiffness") * assembly.of_shaft(shaft, "load_damping")
    assembly.law(torque, [factor], assembly.twist(shaft), assembly.twist_rate(shaft), shaft=shaft)


EFFECT = Effect(
    code="load-dependent-damping",
    of="shaft",
    quantities={"load_damping": Quantity(
        "s/{q}", "shaft damping per torque of its spring", (0.0, 1e12), 1e-6, 0.0)},
    stamp=stamp,
    torque=torque,
    law="Ts = ks twist + (cs + d |ks twist|) d(twist)/dt",
    needs="ringing at several levels of preload",
    source="Lazan 1968, Damping of Materials and Members",
    present=("load_damping",),
)
