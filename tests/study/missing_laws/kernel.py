"""A body under dry friction and one law that the model lacks, integrated with its zero speeds located.

    inertia dv/dt + viscous v + dry sgn v + idle + (the law) = torque, held over each sample

Runge-Kutta steps of order 4. Where the speed reaches zero, and where a body that stands breaks loose, the step
is cut at the instant, found by bisection. Shares no code with drivetool or the other simulators of the tests.
"""

from __future__ import annotations

import numpy as np
from numba import njit

CODES = ("plain", "asymmetry", "stribeck", "lugre", "cogging", "gravity", "crank", "backlash", "elastic-shaft",
         "eccentricity", "saturation", "warm-up")
(PLAIN, ASYMMETRY, STRIBECK, LUGRE, COGGING, GRAVITY, CRANK, BACKLASH, SHAFT, ECCENTRICITY, SATURATION,
 WARM_UP) = range(len(CODES))
# Entries of the state: angle and speed of the body, of the second mass, and the bristles' deflection.
Q, V, Q2, V2, Z, STATES = 0, 1, 2, 3, 4, 5
# Entries of a machine.
INERTIA, VISCOUS, COULOMB, IDLE = range(4)
# Entries of the controller.
OPEN, SPEED, POSITION = range(3)
KP, KI, KQ, FILTER, LIMIT, TOP = range(6)
NO_KINK = 2  # side of a friction that passes zero speed without an event
HALVINGS = 40  # of a substep: its end is then located to 1e-12 of it
MAX_EVENTS = 400  # of one sample; more are a failure of the simulator


@njit(cache=True)
def falling(x, shape):
    """Decay of the extra friction over speed: Tustin's, Gauss's or Hess and Soom's."""
    if shape == 0.0:
        return np.exp(-x)
    return np.exp(-x * x) if shape == 1.0 else 1.0 / (1.0 + x * x)


@njit(cache=True)
def dry(code, p, a, side, speed, t):
    """Dry friction [N m] in the direction `side` at an absolute speed."""
    friction = p[COULOMB]
    if code == ASYMMETRY and side == a[1]:
        friction += a[0] * (a[2] + (1.0 - a[2]) * min(speed / a[3], 1.0))
    elif code in (STRIBECK, LUGRE):
        friction += a[0] * falling(speed / a[1], a[2])
    elif code == WARM_UP:
        friction += a[0] * np.exp(-t / a[1])
    return friction


@njit(cache=True)
def coupling(code, a, twist, rate):
    """Torque on the second mass: a shaft, or a contact of Hunt and Crossley behind a gap."""
    if code == SHAFT:
        return a[1] * twist + a[2] * rate
    side = 1.0 if twist > 0.0 else -1.0
    depth = side * twist - a[3]
    return side * a[1] * depth * max(1.0 + a[2] * side * rate, 0.0) if depth > 0.0 else 0.0


@njit(cache=True)
def push(y, torque, code, p, a):
    """(torque that is left for friction and acceleration, inertia, torque on the second mass)."""
    net, inertia, passed = torque - p[IDLE] - p[VISCOUS] * y[V], p[INERTIA], 0.0
    if code == COGGING:
        net -= a[0] * np.sin(a[1] * y[Q] + a[2])
    elif code == GRAVITY:
        net -= a[0] * np.cos(y[Q] + a[1])
    elif code == CRANK:
        net += inertia * a[0] * np.sin(2.0 * y[Q] + a[1]) * y[V] * y[V]  # half of dJ/dq v^2
        inertia *= 1.0 + a[0] * np.cos(2.0 * y[Q] + a[1])
    elif code in (BACKLASH, SHAFT):
        passed = coupling(code, a, y[Q] - y[Q2], y[V] - y[V2])
        net -= passed
        inertia *= 1.0 - a[0]
    return net, inertia, passed


@njit(cache=True)
def slope(y, out, t, torque, side, code, p, a):
    """Time derivative of the state while the body slides to `side` (+1, -1), stands (0) or needs none."""
    net, inertia, passed = push(y, torque, code, p, a)
    out[:] = 0.0
    if code in (BACKLASH, SHAFT):
        out[Q2], out[V2] = y[V2], passed / (p[INERTIA] * a[0])
    if side == NO_KINK:  # LuGre: Canudas de Wit et al. 1995
        out[Z] = y[V] - a[3] * abs(y[V]) / dry(code, p, a, 0.0, abs(y[V]), t) * y[Z]
        net -= a[3] * y[Z] + a[4] * out[Z]
    elif side == 0:
        return
    else:
        net -= side * dry(code, p, a, side, abs(y[V]), t)
    out[Q], out[V] = y[V], net / inertia


@njit(cache=True)
def advance(y, end, work, t, h, torque, side, code, p, a):
    """The state after h, in `end`; work (5, STATES) is scratch."""
    slope(y, work[0], t, torque, side, code, p, a)
    for i, part in ((1, 0.5), (2, 0.5), (3, 1.0)):
        work[4] = y + h * part * work[i - 1]
        slope(work[4], work[i], t + h * part, torque, side, code, p, a)
    end[:] = y + h / 6.0 * (work[0] + 2.0 * work[1] + 2.0 * work[2] + work[3])


@njit(cache=True)
def left_mode(y, t, torque, side, code, p, a):
    """Whether the body has passed zero speed, or breaks loose."""
    if side == 0:
        net = push(y, torque, code, p, a)[0]
        return abs(net) > dry(code, p, a, np.sign(net), 0.0, t)
    return side != NO_KINK and side * y[V] < 0.0


@njit(cache=True)
def direction(y, t, torque, code, p, a):
    """Side to which the body slides from now on; 0 if it stands."""
    if code == LUGRE:
        return NO_KINK
    if y[V] != 0.0:
        return 1 if y[V] > 0.0 else -1
    if not left_mode(y, t, torque, 0, code, p, a):
        return 0
    return 1 if push(y, torque, code, p, a)[0] > 0.0 else -1


@njit(cache=True)
def over_sample(y, end, work, t, h, parts, torque, code, p, a):
    """Move the state y over h under a held torque; NaN if the events do not end."""
    side, at, step = direction(y, t, torque, code, p, a), 0.0, h / parts
    for _ in range(parts + MAX_EVENTS):
        length = min(step, h - at)
        if length <= 1e-12 * h:
            return
        advance(y, end, work, t + at, length, torque, side, code, p, a)
        if left_mode(end, t + at + length, torque, side, code, p, a):
            low, high = 0.0, length
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                advance(y, end, work, t + at, middle, torque, side, code, p, a)
                if left_mode(end, t + at + middle, torque, side, code, p, a):
                    high = middle
                else:
                    low = middle
            length = high
            advance(y, end, work, t + at, length, torque, side, code, p, a)
            if side == 0:  # loose, and the torque says to where
                side = 1 if push(end, torque, code, p, a)[0] > 0.0 else -1
            else:
                end[V] = 0.0
                side = direction(end, t + at + length, torque, code, p, a)
        y[:] = end
        at += length
    y[:] = np.nan


@njit(cache=True)
def read(y, is_angle, noise, quantum, code, a):
    """What the sensor gives."""
    wave = a[0] if code == ECCENTRICITY else 0.0
    value = y[Q] + wave * np.sin(y[Q] + a[1]) if is_angle else y[V] * (1.0 + wave * np.cos(y[Q] + a[1]))
    value += noise
    return quantum * np.floor(value / quantum + 0.5) if quantum > 0.0 else value


@njit(cache=True)
def run(h, parts, start, mode, command, speeds, angles, c, code, p, a, disturbance, noise, quantum, is_angle):
    """A record: (n,) commanded torque, (n,) sensor, (n + 1, STATES) states at the samples and after the last.

    command          (n,) [N m] without a controller; speeds [rad/s], angles [rad]: its references
    c                controller: KP, KI, KQ, FILTER (share of a new speed), LIMIT [N m], TOP [rad/s] of torque mode
    code, a          the law and its constants, see laws.py; p: the machine
    disturbance      (n,) [N m] held, added behind the log and the law of saturation
    noise, quantum   of the sensor
    """
    n = len(command)
    y, end, work = start.copy(), np.zeros(STATES), np.zeros((5, STATES))
    torque, sensor, states = np.zeros(n), np.zeros(n), np.zeros((n + 1, STATES))
    seen, integral = start[V], 0.0
    for i in range(n):
        states[i] = y
        sensor[i] = read(y, is_angle, noise[i], quantum, code, a)
        wanted = command[i]
        if mode == OPEN:  # a drive in torque mode keeps its speed limit
            wanted = min(max(wanted, -c[KP] * (c[TOP] + y[V])), c[KP] * (c[TOP] - y[V]))
        else:
            speed = sensor[i]
            if is_angle:
                speed = (sensor[i] - sensor[i - 1]) / h if i > 0 else start[V]
            seen += c[FILTER] * (speed - seen)
            angle = sensor[i] if is_angle else y[Q]  # a position loop beside a speed sensor has an encoder
            error = speeds[i] - seen + (c[KQ] * (angles[i] - angle) if mode == POSITION else 0.0)
            wanted = c[KP] * error + integral
            if abs(wanted) < c[LIMIT]:
                integral += c[KI] * h * error
            wanted = min(max(wanted, -c[LIMIT]), c[LIMIT])
        torque[i] = wanted
        if code == SATURATION:
            wanted = min(max(wanted, -a[0]), a[0])
        over_sample(y, end, work, i * h, h, parts, wanted + disturbance[i], code, p, a)
    states[n] = y
    return torque, sensor, states
