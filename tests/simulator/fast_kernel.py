"""The equations of `laws.py` compiled: fixed small Runge-Kutta steps of order 8, events by bisection.

Written apart from the plain simulator and from drivetool's kernel; a test holds it to the former.
State: n speeds, n-1 twists, angle of body 0, converter torque and rate, filtered speed of body 0.
"""

from __future__ import annotations

from collections import namedtuple

import numpy as np
from numba import njit
from scipy.integrate import DOP853

A, B, C = (np.ascontiguousarray(a) for a in (DOP853.A[:12, :12], DOP853.B, DOP853.C[:12]))
STAGES = 12
SPEED_NOISE = 1e-14
MOST_EVENTS = 1000

# Few arrays with many rows: compiled calls copy the description of every array they are given.
Plant = namedtuple("Plant", ("body", "shaft", "path"))
BODY = ("inertia", "viscous", "viscous_back", "coulomb", "coulomb_back", "stribeck", "stribeck_speed",
        "quadratic", "idle", "rough")
JN, VIS, VBK, COU, CBK, STR, SSP, QUA, IDL, ROU = range(len(BODY))
SHAFT = ("stiffness", "damping", "half_gap", "ratio", "hardening_twist", "hardening_power", "damping_torque")
KS, CS, GAP, RAT, HTW, HPO, DTO = range(len(SHAFT))
PATH = ("bandwidth", "zeta", "ripple", "order", "ripple_phase", "imbalance", "imbalance_ratio",
        "imbalance_phase", "drift", "drift_time", "load_step", "load_time", "filter_time", "always")
W0, ZETA, RIP, ORD, RPH, IMB, IRA, IPH, DRI, DTI, LST, LTI, FIL, ALW = range(len(PATH))
# Contact states, slip states and counts of events.
Mode = namedtuple("Mode", ("contact", "slip", "events"))
MADE, LOST, STUCK, RELEASED, REVERSED = range(5)
# Rows of the integrator's work array after its stages.
TRIAL, NEXT, NET, ROWS = STAGES, STAGES + 1, STAGES + 2, STAGES + 3
# What acts from outside over one piece: command, torque noise, load torque.
Input = namedtuple("Input", ("command", "noise", "load"))


@njit(cache=True, error_model="numpy")
def one_side(y, k, side, p):
    """Torque of shaft k as if it touched on `side` (+1, -1; 0 without gap)."""
    n = p.body.shape[1]
    rate = y[k] / p.shaft[RAT, k] - y[k + 1]
    bend = y[n + k] - side * p.shaft[GAP, k]
    elastic = p.shaft[KS, k] * bend
    if p.shaft[HTW, k] < np.inf:
        elastic *= 1.0 + (abs(bend) / p.shaft[HTW, k]) ** p.shaft[HPO, k]
    damping = p.shaft[CS, k]
    if p.shaft[DTO, k] < np.inf:
        damping *= 1.0 + abs(elastic) / p.shaft[DTO, k]
    if p.path[ALW] > 0.0:
        damping = 0.0
    return elastic + damping * rate


@njit(cache=True, error_model="numpy")
def shaft_torque(y, k, p, mode):
    """Torque that shaft k passes on to its next body."""
    extra = p.shaft[CS, k] * (y[k] / p.shaft[RAT, k] - y[k + 1]) if p.path[ALW] > 0.0 else 0.0
    if p.shaft[GAP, k] > 0.0 and mode.contact[k] == 0:
        return extra
    return one_side(y, k, mode.contact[k] if p.shaft[GAP, k] > 0.0 else 0, p) + extra


@njit(cache=True, error_model="numpy")
def worn(t, p):
    """Factor of viscous and Coulomb friction at time t."""
    return 1.0 + p.path[DRI] * np.exp(-t / p.path[DTI]) if p.path[DRI] != 0.0 else 1.0


@njit(cache=True, error_model="numpy")
def net_torques(y, t, u, p, mode, net):
    """All torques on each body except its Coulomb and Stribeck friction, into net."""
    n, path, factor = p.body.shape[1], p.path, worn(t, p)
    for i in range(n):
        w = y[i]
        back = mode.slip[i] < 0 if p.body[ROU, i] > 0.0 else w < 0.0
        viscous = p.body[VBK, i] if back else p.body[VIS, i]
        net[i] = -viscous * factor * w - p.body[IDL, i] - p.body[QUA, i] * w * abs(w)
    net[0] += (y[2 * n] if path[W0] > 0.0 else u.command) + u.noise
    if path[RIP] != 0.0:
        net[0] += path[RIP] * np.sin(path[ORD] * y[2 * n - 1] + path[RPH])
    net[n - 1] -= u.load
    if path[IMB] != 0.0:
        angle = y[2 * n - 1]
        for k in range(n - 1):
            angle = angle / p.shaft[RAT, k] - y[n + k]
        net[n - 1] -= path[IMB] * np.sin(angle / path[IRA] + path[IPH])
    for k in range(n - 1):
        torque = shaft_torque(y, k, p, mode)
        net[k] -= torque / p.shaft[RAT, k]
        net[k + 1] += torque


@njit(cache=True, error_model="numpy")
def level(i, way, t, p):
    """Torque that body i can hold against motion in direction `way`."""
    coulomb = p.body[COU, i] if way > 0 else p.body[CBK, i]
    return coulomb * worn(t, p) + p.body[STR, i]


@njit(cache=True, error_model="numpy")
def derivative(y, t, u, p, mode, net, rate):
    """d/dt of the state in the current mode, into rate."""
    n = p.body.shape[1]
    net_torques(y, t, u, p, mode, net)
    for i in range(n):
        force, way = net[i], mode.slip[i]
        if p.body[ROU, i] > 0.0:
            if way == 0:
                force = 0.0
            else:
                held = (p.body[COU, i] if way > 0 else p.body[CBK, i]) * worn(t, p)
                if p.body[STR, i] > 0.0:
                    held += p.body[STR, i] * np.exp(-((y[i] / p.body[SSP, i]) ** 2))
                force -= way * held
        rate[i] = force / p.body[JN, i]
    for k in range(n - 1):
        rate[n + k] = y[k] / p.shaft[RAT, k] - y[k + 1]
    rate[2 * n - 1] = y[0]
    w0 = p.path[W0]
    if w0 > 0.0:
        rate[2 * n] = y[2 * n + 1]
        rate[2 * n + 1] = w0 * w0 * (u.command - y[2 * n]) - 2.0 * p.path[ZETA] * w0 * y[2 * n + 1]
    if p.path[FIL] > 0.0:
        rate[2 * n + 2] = (y[0] - y[2 * n + 2]) / p.path[FIL]


@njit(cache=True, error_model="numpy")
def step_ahead(y, t, h, u, p, mode, work):
    """State h seconds after y in the same mode, into work[NEXT]."""
    trial, ahead = work[TRIAL], work[NEXT]
    ahead[:] = y
    for s in range(STAGES):
        trial[:] = y
        for r in range(s):
            share = h * A[s, r]
            if share != 0.0:
                for j in range(y.size):
                    trial[j] += share * work[r, j]
        derivative(trial, t + C[s] * h, u, p, mode, work[NET], work[s])
        share = h * B[s]
        if share != 0.0:
            for j in range(y.size):
                ahead[j] += share * work[s, j]


@njit(cache=True, error_model="numpy")
def direction(y, i, t, u, p, mode, work):
    """Where a body at standstill goes: nowhere while friction can hold it."""
    net_torques(y, t, u, p, mode, work[NET])
    if work[NET, i] > level(i, 1, t, p):
        return 1
    return -1 if work[NET, i] < -level(i, -1, t, p) else 0


@njit(cache=True, error_model="numpy")
def violated(y, t, u, p, mode, work):
    """(shaft or n-1 + body, new contact or slip) of the first guard that fails; (-1, 0) if none."""
    n = p.body.shape[1]
    for k in range(n - 1):
        if p.shaft[GAP, k] > 0.0:
            noise = p.shaft[KS, k] * (1e-15 + 1e-13 * p.shaft[GAP, k])
            side = mode.contact[k]
            if side != 0:
                if side * one_side(y, k, side, p) < -noise:
                    return k, 0
            elif one_side(y, k, 1, p) > noise:
                return k, 1
            elif one_side(y, k, -1, p) < -noise:
                return k, -1
    known = False
    for i in range(n):
        if p.body[ROU, i] > 0.0:
            if mode.slip[i] != 0:
                if mode.slip[i] * y[i] < -SPEED_NOISE:
                    return n - 1 + i, 0
                continue
            if not known:
                net_torques(y, t, u, p, mode, work[NET])
                known = True
            for way in (1, -1):
                hold = level(i, way, t, p)
                if way * work[NET, i] - hold > 1e-12 * hold:
                    return n - 1 + i, way
    return -1, 0


@njit(cache=True, error_model="numpy")
def leave(which, new, y, t, u, p, mode, work):
    """Change the mode at an event; a body that halts gets exactly zero speed in y."""
    n = p.body.shape[1]
    if which < n - 1:
        mode.contact[which] = new
        mode.events[MADE if new else LOST] += 1
        return
    i = which - (n - 1)
    if new:
        mode.slip[i] = new
        mode.events[RELEASED] += 1
        return
    y[i] = 0.0
    before = mode.slip[i]
    now = direction(y, i, t, u, p, mode, work)
    mode.slip[i] = now
    if now != before:
        mode.events[REVERSED if now else STUCK] += 1


@njit(cache=True, error_model="numpy")
def settle(y, t, u, p, mode, work):
    """Choose slip states after the torques may have jumped."""
    for i in range(p.body.shape[1]):
        if p.body[ROU, i] == 0.0:
            continue
        before = mode.slip[i]
        if before * y[i] < 0.0 and abs(y[i]) <= SPEED_NOISE:
            y[i] = 0.0
        now = int(np.sign(y[i])) if y[i] != 0.0 else direction(y, i, t, u, p, mode, work)
        mode.slip[i] = now
        if now != before and y[i] == 0.0:
            mode.events[RELEASED if before == 0 else (REVERSED if now else STUCK)] += 1


@njit(cache=True, error_model="numpy")
def advance(y, t, length, longest, u, p, mode, work):
    """State `length` seconds on, into y; False after too many events."""
    settle(y, t, u, p, mode, work)
    end, count = t + length, 0
    while True:
        which, new = violated(y, t, u, p, mode, work)
        if which >= 0:
            count += 1
            if count > MOST_EVENTS:
                return False
            leave(which, new, y, t, u, p, mode, work)
            continue
        left = end - t
        if left <= 1e-16:
            return True
        h = longest if left > 1.000001 * longest else left
        step_ahead(y, t, h, u, p, mode, work)
        if violated(work[NEXT], t + h, u, p, mode, work)[0] >= 0:
            low = 0.0
            for _ in range(64):
                middle = 0.5 * (low + h)
                if middle <= low or middle >= h or h - low < 1e-17:
                    break
                step_ahead(y, t, middle, u, p, mode, work)
                if violated(work[NEXT], t + middle, u, p, mode, work)[0] >= 0:
                    h = middle
                else:
                    low = middle
            step_ahead(y, t, h, u, p, mode, work)
        y[:] = work[NEXT]
        t = t + h if h < left else end


@njit(cache=True, error_model="numpy")
def begin(y, p, mode):
    """Choose the contact states that belong to state y."""
    for k in range(p.shaft.shape[1]):
        mode.contact[k] = 0
        if p.shaft[GAP, k] > 0.0:
            if one_side(y, k, 1, p) > 0.0:
                mode.contact[k] = 1
            elif one_side(y, k, -1, p) < 0.0:
                mode.contact[k] = -1


@njit(cache=True, error_model="numpy")
def whole_record(y, p, mode, work, signals, control, timing, kept, commands):
    """Every sample of a record.

    signals   (5, samples) torque, torque noise, load torque, sensor noise, speed reference
    control   gain, reset, integral at the start, limit, resolution of the torque, of the speed
    timing    step, longest step of the integrator, whole samples and rest of the dead time,
              command before the first sample
    kept      (samples, 5n) filled: speeds, twists, angle, shaft torques, applied, measured, contacts, stuck
    commands  (samples,) filled
    returns   sample at which there were too many events, or -1
    """
    n, samples = p.body.shape[1], commands.size
    step, longest, whole, rest, before = timing
    integral = control[2]
    begin(y, p, mode)
    for i in range(samples):
        t = i * step
        seen = (y[2 * n + 2] if p.path[FIL] > 0.0 else y[0]) + signals[3, i]
        if control[5] > 0.0:
            seen = np.rint(seen / control[5]) / (1.0 / control[5])
        commands[i] = signals[0, i]
        if control[0] > 0.0:
            error = signals[4, i] - seen
            wanted = control[0] * error + integral + signals[0, i]
            if abs(wanted) <= control[3] or error * wanted < 0.0:
                integral += control[1] * error * step
            wanted = min(control[3], max(-control[3], wanted))
            commands[i] = np.rint(wanted / control[4]) / (1.0 / control[4]) if control[4] > 0.0 else wanted
        now = i - int(whole)
        late = commands[now] if now >= 0 else before
        later = commands[now - 1] if now >= 1 else before
        load, switch = signals[2, i], p.path[LTI]
        first = later if rest > 0.0 else late
        stepped = p.path[LST] if switch <= t else 0.0
        u = Input(first, signals[1, i], load + stepped)
        settle(y, t, u, p, mode, work)
        keep(kept[i], y, seen, u, p, mode)
        cuts = (rest, switch - t if t < switch < t + step and p.path[LST] != 0.0 else 0.0)
        begun = 0.0
        for cut in (min(cuts), max(cuts), step):
            if cut > begun:
                half = 0.5 * (begun + cut)
                u = Input(late if half > rest else later, signals[1, i],
                          load + (p.path[LST] if t + half > switch else 0.0))
                if not advance(y, t + begun, cut - begun, longest, u, p, mode, work):
                    return i
                begun = cut
    return -1


@njit(cache=True, error_model="numpy")
def keep(row, y, seen, u, p, mode):
    """All that is kept of one instant."""
    n = p.body.shape[1]
    row[: 2 * n] = y[: 2 * n]
    for k in range(n - 1):
        torque = shaft_torque(y, k, p, mode)
        row[2 * n + k] = torque
        row[3 * n + 1 + k] = mode.contact[k] if p.shaft[GAP, k] > 0.0 else np.sign(torque)
    row[3 * n - 1] = (y[2 * n] if p.path[W0] > 0.0 else u.command) + u.noise
    row[3 * n] = seen
    for i in range(n):
        row[4 * n + i] = 1.0 if p.body[ROU, i] > 0.0 and mode.slip[i] == 0 else 0.0
