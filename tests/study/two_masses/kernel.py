"""Two inertias on a shaft, with dry friction on either, a gap, and one law that the model lacks.

    JM dvm/dt + BM vm + dry sgn vm + TM + shaft + (the law) = motor torque,    shaft = KS dead(z, HALF_GAP)
    JL dvl/dt + BL vl + dry sgn vl + TL - shaft + (the law) = load torque,     z = twist + CS/KS (vm - vl)

Torques are held over each sample. Runge-Kutta steps of order 4; where a body stops or breaks loose and where the
gap closes or opens, the step is cut at the instant, found by bisection. Shares no code with drivetool or the other
simulators of the tests, so that each checks the others.
"""

from __future__ import annotations

import numpy as np
from numba import njit

CODES = ("plain", "asymmetry", "stribeck", "warm-up", "dry", "drag", "cogging", "gravity", "crank", "third-mass",
         "eccentricity")
(PLAIN, ASYMMETRY, STRIBECK, WARM_UP, DRY, DRAG, COGGING, GRAVITY, CRANK, THIRD, ECCENTRICITY) = range(len(CODES))
# Entries of the state: speeds of motor and load, twist between them, motor angle; a third mass' speed and twist.
VM, VL, TWIST, QM, V3, TWIST3, STATES = 0, 1, 2, 3, 4, 5, 6
# Entries of a machine.
JM, JL, KS, CS, HALF_GAP, BM, BL, FM, TM, TL, NUMBERS = range(11)
# Entries of the controller, and its modes.
OPEN, SPEED, POSITION = range(3)
KP, KI, KQ, FILTER, LIMIT, TOP = range(6)
# Entries of a mode: the side to which each body slides (+1, -1; 0: it stands), the side of the gap that touches.
MOTOR, LOAD, CONTACT = range(3)
NO_KINK = 2  # side of a body that has no dry friction
HALVINGS = 40  # of a substep: its end is then located to 1e-12 of it
MAX_EVENTS = 400  # of one sample; more are a failure of the simulator


@njit(cache=True)
def has_dry(which, code, body, p):
    """Whether a body has dry friction at all."""
    return (which == MOTOR and p[FM] > 0.0) or (which == body and ASYMMETRY <= code <= DRY)


@njit(cache=True)
def dry(which, code, body, p, a, side, speed, t):
    """Dry friction [N m] of a body in the direction `side` at an absolute speed."""
    friction = p[FM] if which == MOTOR else 0.0
    if which != body:
        return friction
    if code == ASYMMETRY and side == a[1]:
        friction += a[0] * (a[2] + (1.0 - a[2]) * min(speed / a[3], 1.0))
    elif code == STRIBECK:
        x = speed / a[1]
        friction += a[0] * (np.exp(-x) if a[2] == 0.0 else np.exp(-x * x) if a[2] == 1.0 else 1.0 / (1.0 + x * x))
    elif code == WARM_UP:
        friction += a[0] * np.exp(-t / a[1])
    elif code == DRY:
        friction += a[0]
    return friction


@njit(cache=True)
def smooth(code, a, angle, speed, inertia):
    """(torque [N m] of a law on its body, which is no dry friction; inertia of the body under it)."""
    if code == DRAG:
        return -a[0] * speed * abs(speed), inertia
    if code == COGGING:
        return -a[0] * np.sin(a[1] * angle + a[2]), inertia
    if code == GRAVITY:
        return -a[0] * np.cos(angle + a[1]), inertia
    if code == CRANK:  # half of dJ/dq v^2
        return (inertia * a[0] * np.sin(2.0 * angle + a[1]) * speed * speed,
                inertia * (1.0 + a[0] * np.cos(2.0 * angle + a[1])))
    return 0.0, inertia


@njit(cache=True)
def shaft(y, contact, p):
    """Torque [N m] of the shaft on the load."""
    if contact == 0:
        return 0.0
    return p[KS] * (y[TWIST] - contact * p[HALF_GAP]) + p[CS] * (y[VM] - y[VL])


@njit(cache=True)
def push(y, net, motor, load, contact, code, body, p, a):
    """Fill net: torques on motor and load but for dry friction; their inertias; the torque on a third mass."""
    passed = shaft(y, contact, p)
    net[0] = motor - p[TM] - p[BM] * y[VM] - passed
    net[1] = load - p[TL] - p[BL] * y[VL] + passed
    net[2], net[3], net[4] = p[JM], p[JL], 0.0
    if code == THIRD:
        net[3] -= a[0]
        net[4] = a[1] * y[TWIST3] + a[2] * (y[VL] - y[V3])
        net[1] -= net[4]
    elif code >= DRAG:
        angle = y[QM] if body == MOTOR else y[QM] - y[TWIST]
        torque, inertia = smooth(code, a, angle, y[body], net[2 + body])
        net[body] += torque
        net[2 + body] = inertia


@njit(cache=True)
def slope(y, out, net, t, motor, load, mode, code, body, p, a):
    """Time derivative of the state in a mode."""
    push(y, net, motor, load, mode[CONTACT], code, body, p, a)
    for which in range(2):
        side = mode[which]
        if side == 0:
            out[which] = 0.0
            continue
        if side != NO_KINK:
            net[which] -= side * dry(which, code, body, p, a, side, abs(y[which]), t)
        out[which] = net[which] / net[2 + which]
    out[TWIST], out[QM] = y[VM] - y[VL], y[VM]
    out[V3], out[TWIST3] = 0.0, 0.0
    if code == THIRD:
        out[V3], out[TWIST3] = net[4] / a[0], y[VL] - y[V3]


@njit(cache=True)
def advance(y, end, work, net, t, h, motor, load, mode, code, body, p, a):
    """The state after h in a mode, in `end`."""
    slope(y, work[0], net, t, motor, load, mode, code, body, p, a)
    for i, part in ((1, 0.5), (2, 0.5), (3, 1.0)):
        for j in range(STATES):
            work[4, j] = y[j] + h * part * work[i - 1, j]
        slope(work[4], work[i], net, t + h * part, motor, load, mode, code, body, p, a)
    for j in range(STATES):
        end[j] = y[j] + h / 6.0 * (work[0, j] + 2.0 * work[1, j] + 2.0 * work[2, j] + work[3, j])


@njit(cache=True)
def touching(y, p):
    """Side of the gap that touches; without a gap always the same."""
    if p[HALF_GAP] == 0.0:
        return 1
    z = y[TWIST] + p[CS] / p[KS] * (y[VM] - y[VL])
    return 1 if z > p[HALF_GAP] else -1 if z < -p[HALF_GAP] else 0


@njit(cache=True)
def loose(which, net, t, code, body, p, a):
    """Whether the torque on a standing body exceeds its dry friction."""
    return abs(net[which]) > dry(which, code, body, p, a, np.sign(net[which]), 0.0, t)


@njit(cache=True)
def left_mode(y, net, t, motor, load, mode, code, body, p, a):
    """Whether a body has passed zero speed or breaks loose, or the contact has changed."""
    if touching(y, p) != mode[CONTACT]:
        return True
    if mode[MOTOR] == 0 or mode[LOAD] == 0:
        push(y, net, motor, load, mode[CONTACT], code, body, p, a)
    for which in range(2):
        side = mode[which]
        if side == 0:
            if loose(which, net, t, code, body, p, a):
                return True
        elif side != NO_KINK and side * y[which] < 0.0:
            return True
    return False


@njit(cache=True)
def settle(y, net, t, motor, load, mode, code, body, p, a):
    """Set the mode in which the motion goes on."""
    mode[CONTACT] = touching(y, p)
    push(y, net, motor, load, mode[CONTACT], code, body, p, a)
    for which in range(2):
        if not has_dry(which, code, body, p):
            mode[which] = NO_KINK
        elif y[which] != 0.0:
            mode[which] = 1 if y[which] > 0.0 else -1
        elif not loose(which, net, t, code, body, p, a):
            mode[which] = 0
        else:
            mode[which] = 1 if net[which] > 0.0 else -1


@njit(cache=True)
def over_sample(y, end, work, net, mode, t, h, parts, motor, load, code, body, p, a):
    """Move the state y over h under held torques; NaN if the events do not end."""
    settle(y, net, t, motor, load, mode, code, body, p, a)
    at, step = 0.0, h / parts
    for _ in range(parts + MAX_EVENTS):
        length = min(step, h - at)
        if length <= 1e-12 * h:
            return
        advance(y, end, work, net, t + at, length, motor, load, mode, code, body, p, a)
        event = left_mode(end, net, t + at + length, motor, load, mode, code, body, p, a)
        if event:
            low, high = 0.0, length
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                advance(y, end, work, net, t + at, middle, motor, load, mode, code, body, p, a)
                if left_mode(end, net, t + at + middle, motor, load, mode, code, body, p, a):
                    high = middle
                else:
                    low = middle
            length = high
            advance(y, end, work, net, t + at, length, motor, load, mode, code, body, p, a)
            for which in range(2):
                if mode[which] != NO_KINK and mode[which] * end[which] < 0.0:
                    end[which] = 0.0
        y[:] = end
        at += length
        if event:
            settle(y, net, t + at, motor, load, mode, code, body, p, a)
    y[:] = np.nan


@njit(cache=True)
def read(y, is_angle, noise, quantum, code, a):
    """What the motor's sensor gives."""
    wave = a[0] if code == ECCENTRICITY else 0.0
    value = y[QM] + wave * np.sin(y[QM] + a[1]) if is_angle else y[VM] * (1.0 + wave * np.cos(y[QM] + a[1]))
    value += noise
    return quantum * np.floor(value / quantum + 0.5) if quantum > 0.0 else value


@njit(cache=True)
def run(h, parts, start, mode, command, speeds, angles, c, code, body, p, a, extra, noise, quantum, is_angle):
    """A record: (n,) commanded motor torque, (n,) sensor, (n + 1, STATES) states at the samples and after the last.

    command          (n,) [N m], with a controller added to its output; speeds [rad/s], angles [rad]: its references
    c                controller: KP, KI, KQ, FILTER (share of a new speed), LIMIT [N m], TOP [rad/s] of torque mode
    code, body, a    the law, the body that it acts on and its constants, see laws.py; p: the machine
    extra            (n, 2) [N m] held on motor and load, behind the log
    noise, quantum   of the motor's sensor
    """
    n = len(command)
    y, end, work = start.copy(), np.zeros(STATES), np.zeros((5, STATES))
    net, inside = np.zeros(5), np.zeros(3, np.int64)
    torque, sensor, states = np.zeros(n), np.zeros(n), np.zeros((n + 1, STATES))
    seen, integral = start[VM], 0.0
    for i in range(n):
        states[i] = y
        sensor[i] = read(y, is_angle, noise[i], quantum, code, a)
        wanted = command[i]
        if mode == OPEN:  # a drive in torque mode keeps its speed limit
            wanted = min(max(wanted, -c[KP] * (c[TOP] + y[VM])), c[KP] * (c[TOP] - y[VM]))
        else:
            speed = sensor[i]
            if is_angle:
                speed = (sensor[i] - sensor[i - 1]) / h if i > 0 else start[VM]
            seen += c[FILTER] * (speed - seen)
            angle = sensor[i] if is_angle else y[QM]  # a position loop beside a speed sensor has an encoder
            error = speeds[i] - seen + (c[KQ] * (angles[i] - angle) if mode == POSITION else 0.0)
            wanted += c[KP] * error + integral
            if abs(wanted) < c[LIMIT]:
                integral += c[KI] * h * error
            wanted = min(max(wanted, -c[LIMIT]), c[LIMIT])
        torque[i] = wanted
        over_sample(y, end, work, net, inside, i * h, h, parts, wanted + extra[i, 0], extra[i, 1], code, body, p, a)
    states[n] = y
    return torque, sensor, states


@njit(cache=True)
def observed(states, h, held, code, body, p, a):
    """(n, 2) at the samples: torque of the shaft, and torque of the law on its body, in N m.

    held  (n, 2) [N m] on motor and load over each sample

    Of a crank: what its mean inertia does not explain; of a third mass: what it adds to one fixed to the load; of
    dry friction while its body stands: nothing.
    """
    found, net, out, mode = np.zeros((len(held), 2)), np.zeros(5), np.zeros(STATES), np.zeros(3, np.int64)
    for i in range(len(held)):
        y, t = states[i], i * h
        settle(y, net, t, held[i, 0], held[i, 1], mode, code, body, p, a)
        found[i, 0] = shaft(y, mode[CONTACT], p)
        if mode[body] in (-1, 1) and ASYMMETRY <= code <= DRY:
            base = p[FM] if body == MOTOR else 0.0
            found[i, 1] = -mode[body] * (dry(body, code, body, p, a, mode[body], abs(y[body]), t) - base)
        elif code >= DRAG:
            slope(y, out, net, t, held[i, 0], held[i, 1], mode, code, body, p, a)
            if code == THIRD:
                found[i, 1] = a[0] * out[VL] - net[4]
            else:
                angle = y[QM] if body == MOTOR else y[QM] - y[TWIST]
                torque, inertia = smooth(code, a, angle, y[body], p[JM + body])
                found[i, 1] = torque + (p[JM + body] - inertia) * out[body]
    return found
