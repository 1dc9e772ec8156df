"""LuGre friction: Coulomb and Stribeck friction that acts through bristles, elastic before they slide.

A bristle bends with the motion until it carries the sliding friction. So the body moves before it breaks away, and
friction lags behind the speed. While bristles act, Coulomb and Stribeck friction act through them alone.
"""

from math import copysign, exp, log

from drivetool.drive.effects.effect import Effect
from drivetool.errors import BadParameters
from drivetool.quantity import Quantity, name_of

# Their dry friction would stick beside the bristles.
RIVALS = ("breakaway", "drift_coulomb", "loss_driving", "loss_driven")
# Rate at which a body that reverses passes the deflection at breakaway, over that of its bristles' oscillation.
# It is the root of twice the torque over the friction; both pull one way. A choice: torques up to 30 times it.
SLIDING_RATE = 8.0


def torque(w, z, time, side, p, out):
    """s0 |w| z / g(w), the rate at which bristles slide, g = Tc + Ts exp(-(|w|/ws)^n); s0, Tc, Ts, ws, n = p."""
    speed = side * w
    ratio = speed / p[3, 0]
    power = ratio ** p[4, 0] if ratio > 0.0 else 0.0
    bell = exp(-power)
    level = p[1, 0] + p[2, 0] * bell
    bend = p[0, 0] * z / level
    out[0] = speed * bend
    out[1] = side * bend
    out[2] = p[0, 0] * speed / level
    out[3] = speed * z / level
    out[4] = -out[0] / level
    out[5] = out[4] * bell
    if ratio > 0.0:
        fall = out[4] * p[2, 0] * bell * power  # over the logarithm of the ratio, its sign turned
        out[1] -= fall * p[4, 0] / w
        out[6] = fall * p[4, 0] / p[3, 0]
        out[7] = -fall * log(ratio)


def states(assembly, body):
    """The deflection of the bristles."""
    return (_state(assembly, body),) if assembly.acts(body, "bristle_stiffness") else ()


def start(drive, body, speeds, inputs):
    """That of steady sliding at the start speed; zero at rest."""
    owner, speed = drive.bodies[body], speeds[body]
    stiffness, coulomb, surplus, reach, power = (
        drive.value(name_of(owner, s))
        for s in ("bristle_stiffness", "coulomb", "stribeck", "stribeck_speed", "stribeck_power"))
    if not coulomb:
        raise BadParameters(f"{name_of(owner, 'coulomb')} above zero, for the bristles carry it", "zero",
                            f"Give it, or delete {name_of(owner, 'bristle_stiffness')}.")
    level = drive.value("friction.factor") * (coulomb + surplus * exp(-(abs(speed) / reach) ** power))
    return copysign(level / stiffness, speed) if speed else 0.0,


def prepare(assembly, body):
    """Coulomb and Stribeck friction do not act beside the bristles."""
    name = assembly.drive.bodies[body]
    for rival in (*(name_of(name, suffix) for suffix in RIVALS), "friction.drift_coulomb"):
        if rival in assembly.acting:
            raise BadParameters(f"one law of dry friction for {name}", f"{rival} beside its bristle_stiffness",
                                "Delete one of them.")
    assembly.replaced |= {(body, "coulomb"), (body, "stribeck")}


def stamp(assembly, body):
    """T = s0 z + s1 dz/dt against the motion; the sign of the speed is an event, for the law has a kink there."""
    speed, bristle = assembly.speed(body), assembly.states.index(_state(assembly, body))
    stiffness, damping = (assembly.of_body(body, s) for s in ("bristle_stiffness", "bristle_damping"))
    one = assembly.number(1.0)
    assembly.friction(body, assembly.number(0.0))
    assembly.law_rate = max(assembly.law_rate, SLIDING_RATE)
    assembly.torque(bristle, speed, one)
    assembly.torque(body, bristle, -stiffness)
    assembly.torque(body, speed, -damping)
    parameters = [assembly.of_body(body, s) for s in ("coulomb", "stribeck", "stribeck_speed", "stribeck_power")]
    assembly.law(torque, [stiffness, *parameters], {speed: one}, {bristle: one}, body=body, slides=True,
                 into={bristle: -one, body: damping})


def _state(assembly, body):
    return f"{assembly.drive.bodies[body]}.bristle"


EFFECT = Effect(
    code="bristle-friction",
    of="body",
    quantities={
        "bristle_stiffness": Quantity("{T}/{q}", "stiffness of the bristles of LuGre friction", (1e-9, 1e15), 1.0,
                                      float("inf")),
        "bristle_damping": Quantity("{T} s/{q}", "damping of the bristles", (0.0, 1e12), 1e-3, 0.0),
    },
    prepare=prepare,
    stamp=stamp,
    torque=torque,
    states=states,
    start=start,
    law="T = s0 z + s1 dz/dt, dz/dt = w - s0 |w| z/g(w), g = Tc + Ts exp(-(|w|/ws)^n)",
    needs="several samples within the deflection at breakaway, Tc/s0, and several sliding speeds",
    source="Canudas de Wit, Olsson, Astrom, Lischinsky 1995, IEEE Trans. Automatic Control 40(3)",
    present=("bristle_stiffness",),
)
