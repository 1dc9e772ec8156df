"""Breakaway friction without a standstill: Stribeck, Coulomb and viscous friction as one smooth curve through zero.

Simulation tools use it where a true standstill is awkward. Near zero the curve is steep instead of set-valued, so
that a body under a torque creeps. Coulomb friction and the Stribeck effect are the alternative that sticks.
"""

from math import exp, sqrt, tanh

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

BELL_SCALE = sqrt(2.0 * exp(1.0))  # normalises the bell r exp(-r^2), largest at r = 1/sqrt(2), to a peak of one
BELL_WIDTH = sqrt(2.0)  # of the breakaway speed, the width of the bell: its peak is at the breakaway speed
COULOMB_STEEPNESS = 10.0  # breakaway speed over the Coulomb curve's threshold speed; a constant of eq. (18)


def torque(w, _, time, side, p, out):
    """-(sqrt(2e) D exp(-r^2) r + Tc tanh(10 w/wb)), r = w / (sqrt(2) wb); Tc, D, wb = p[0..2]."""
    r, coulomb = w / (BELL_WIDTH * p[2, 0]), tanh(COULOMB_STEEPNESS * w / p[2, 0])
    bell, steep = BELL_SCALE * exp(-r * r), 1.0 - coulomb * coulomb
    rise = p[1, 0] * bell * (1.0 - 2.0 * r * r)
    out[0] = -(p[1, 0] * bell * r + p[0, 0] * coulomb)
    out[1] = -(rise / BELL_WIDTH + COULOMB_STEEPNESS * p[0, 0] * steep) / p[2, 0]
    out[3] = -coulomb
    out[4] = -bell * r
    out[5] = (rise * r + COULOMB_STEEPNESS * p[0, 0] * steep * w / p[2, 0]) / p[2, 0]


def has_breakaway(assembly, body):
    """Whether a body has it. With a breakaway torque of zero, even a free one, Coulomb friction sticks."""
    return assembly.acts(body, "breakaway") and assembly.of_body(body, "breakaway").v > 0.0


def prepare(assembly, body):
    """Coulomb friction is part of the curve."""
    if has_breakaway(assembly, body):
        assembly.replaced.add((body, "coulomb"))


def stamp(assembly, body):
    """The whole curve but for its viscous part; Coulomb friction is in it."""
    if has_breakaway(assembly, body):
        parameters = [assembly.of_body(body, s) for s in ("coulomb", "breakaway", "breakaway_speed")]
        assembly.law(torque, parameters, {assembly.speed(body): assembly.number(1.0)}, body=body)


EFFECT = Effect(
    code="breakaway",
    of="body",
    quantities={
        "breakaway": Quantity("{T}", "breakaway torque above Coulomb friction, without a standstill", (0.0, 1e12),
                              1e-3, 0.0),
        "breakaway_speed": Quantity("{q}/s", "speed of the breakaway torque", (1e-3, 1e6), 1e-3, 1.0),
    },
    prepare=prepare,
    stamp=stamp,
    torque=torque,
    law="T = sqrt(2e) D exp(-(w/ws)^2) w/ws + Tc tanh(10 w/wb), ws = sqrt(2) wb; D = Tbrk - Tc",
    needs="speeds about the breakaway speed, as in a coast-down to standstill",
    source="Mechanical Parameter Estimation of an Induction Motor for a Digital Twin Using Coast-Down Data, "
           "eq. (18)",
    present=("breakaway",),
    friction=("breakaway",),
)
