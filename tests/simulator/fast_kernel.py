"""The equations of `laws.py` compiled: fixed small Runge-Kutta steps of order 8, events by bisection.

Written independently of the plain simulator and of drivetool's kernel; a test compares it with the former.
State: n speeds, n-1 twists, angle of body 0, converter torque and rate, filtered speed of body 0; with LuGre
friction n torques s0 z of bristles, with the law "contact" n-1 places in the gaps.
"""

from __future__ import annotations

from collections import namedtuple

import numpy as np
from numba import njit
from scipy.integrate import DOP853

A, B, C = (np.ascontiguousarray(a) for a in (DOP853.A[:12, :12], DOP853.B, DOP853.C[:12]))
STAGES = 12
SPEED_NOISE = 1e-14
KINK_NOISE = 1e-12
TWIST_NOISE = 1e-15
MAX_EVENTS_PER_SAMPLE = 1000

# Everything about the machine is one array, a row per quantity and a column per body or shaft, and
# the states of the integrator are another: compiled calls pay for every array they are handed.
BODY = ("inertia", "viscous", "viscous_back", "coulomb", "coulomb_back", "stribeck", "stribeck_speed",
        "stribeck_power", "quadratic", "idle", "direction_dependent", "lugre_stiffness", "lugre_damping",
        "loss_driving", "loss_driven")
JN, VIS, VBK, COU, CBK, STR, SSP, SPO, QUA, IDL, ROU, BRK, BRC, LDG, LDN = range(len(BODY))
SHAFT = ("stiffness", "damping", "half_gap", "ratio", "hardening_twist", "hardening_power", "damping_torque")
KS, CS, GAP, RAT, HTW, HPO, DTO = range(len(BODY), len(BODY) + len(SHAFT))
PATH = ("bandwidth", "zeta", "ripple", "order", "ripple_phase", "ripple2", "order2", "ripple2_phase",
        "imbalance", "imbalance_ratio", "imbalance_phase", "drift", "drift_time",
        "load_step", "load_time", "filter_time", "always", "bodies", "bristles", "places",
        "rotor_inertia")
LINE = len(BODY) + len(SHAFT)
(W0, ZETA, RIP, ORD, RPH, RI2, OR2, RP2, IMB, IRA, IPH, DRI, DTI, LST, LTI, FIL, ALW, NUM, BRI,
 PLA, ROT) = range(len(PATH))
# Rows of the modes: contact states, slip states, counts of events, signs of torques passed on with a loss.
CONTACT, SLIP, EVENTS, PULL = range(4)
MADE, LOST, STUCK, RELEASED, REVERSED = range(5)
# Rows of the states after the stages: now, within a step, at its end; and torques on the bodies.
NOW, TRIAL, NEXT, NET, ROWS = range(STAGES, STAGES + 5)
# What acts from outside over one piece: command, torque noise, load torque.
Input = namedtuple("Input", ("command", "noise", "load"))


@njit(cache=True, error_model="numpy")
def bodies(p):
    """Number of bodies."""
    return int(p[LINE, NUM])


@njit(cache=True, error_model="numpy")
def one_side(x, at, k, side, p):
    """Torque of shaft k as if it touched on `side` (+1, -1; 0 without gap)."""
    n = bodies(p)
    rate = x[at, k] / p[RAT, k] - x[at, k + 1]
    bend = x[at, n + k] - side * p[GAP, k]
    elastic = p[KS, k] * bend
    if p[HTW, k] < np.inf:
        elastic *= 1.0 + (abs(bend) / p[HTW, k]) ** p[HPO, k]
    damping = p[CS, k]
    if p[DTO, k] < np.inf:
        damping *= 1.0 + abs(elastic) / p[DTO, k]
    if p[LINE, ALW] > 0.0:
        damping = 0.0
    return elastic + damping * rate


@njit(cache=True, error_model="numpy")
def load_dependent(k, p):
    """Whether stiffness or damping depend on the load: the law then has a kink at no load.

    Without a gap the contact state is the sign of the twist, so that no step goes over the kink.
    """
    return p[HTW, k] < np.inf or p[DTO, k] < np.inf


@njit(cache=True, error_model="numpy")
def shaft_torque(x, at, k, p, mode):
    """Torque that shaft k passes on to its next body."""
    extra = p[CS, k] * (x[at, k] / p[RAT, k] - x[at, k + 1]) if p[LINE, ALW] > 0.0 else 0.0
    if p[GAP, k] > 0.0 and mode[CONTACT, k] == 0:
        return extra
    return one_side(x, at, k, mode[CONTACT, k] if p[GAP, k] > 0.0 else 0, p) + extra


@njit(cache=True, error_model="numpy")
def friction_factor(t, p):
    """Factor of viscous and Coulomb friction at time t."""
    return 1.0 + p[LINE, DRI] * np.exp(-t / p[LINE, DTI]) if p[LINE, DRI] != 0.0 else 1.0


@njit(cache=True, error_model="numpy")
def motor_torques(x, at, u, p):
    """Torques on body 0 from the motor's side: behind the converter with its noise, two ripples."""
    n, ripple, ripple2 = bodies(p), 0.0, 0.0
    if p[LINE, RIP] != 0.0:
        ripple = p[LINE, RIP] * np.sin(p[LINE, ORD] * x[at, 2 * n - 1] + p[LINE, RPH])
    if p[LINE, RI2] != 0.0:
        ripple2 = p[LINE, RI2] * np.sin(p[LINE, OR2] * x[at, 2 * n - 1] + p[LINE, RP2])
    return (x[at, 2 * n] if p[LINE, W0] > 0.0 else u.command) + u.noise, ripple, ripple2


@njit(cache=True, error_model="numpy")
def net_torques(x, at, t, u, p, mode):
    """All torques on each body except its Coulomb and Stribeck friction, into row NET."""
    n, factor = bodies(p), friction_factor(t, p)
    for i in range(n):
        w = x[at, i]
        back = mode[SLIP, i] < 0 if p[ROU, i] > 0.0 or p[BRK, i] > 0.0 else w < 0.0
        viscous = p[VBK, i] if back else p[VIS, i]
        x[NET, i] = -viscous * factor * w - p[IDL, i] - p[QUA, i] * w * abs(w)
        if p[BRK, i] > 0.0:
            x[NET, i] -= x[at, bristle(i, p)] + p[BRC, i] * bending(x, at, i, t, p, mode)
    applied, ripple, ripple2 = motor_torques(x, at, u, p)
    x[NET, 0] += applied
    x[NET, 0] += ripple
    x[NET, 0] += ripple2
    x[NET, n - 1] -= u.load
    if p[LINE, IMB] != 0.0:
        angle = x[at, 2 * n - 1]
        for k in range(n - 1):
            angle = angle / p[RAT, k] - x[at, n + k]
        x[NET, n - 1] -= p[LINE, IMB] * np.sin(angle / p[LINE, IRA] + p[LINE, IPH])
    for k in range(n - 1):
        torque = shaft_torque(x, at, k, p, mode)
        x[NET, k] -= torque / p[RAT, k]
        x[NET, k + 1] += torque


@njit(cache=True, error_model="numpy")
def sliding(w, i, t, p, mode):
    """Coulomb and Stribeck friction of a body that slides."""
    held = (p[COU, i] if mode[SLIP, i] > 0 else p[CBK, i]) * friction_factor(t, p)
    if p[STR, i] > 0.0:
        held += p[STR, i] * np.exp(-(abs(w) / p[SSP, i]) ** p[SPO, i])
    return held


@njit(cache=True, error_model="numpy")
def bristle(i, p):
    """Where the state has the torque of body i's bristle."""
    return int(p[LINE, BRI]) + i


@njit(cache=True, error_model="numpy")
def has_place(k, p):
    """Whether the place of shaft k in its gap is a state."""
    return p[LINE, PLA] > 0.0 and p[GAP, k] > 0.0 and p[CS, k] > 0.0


@njit(cache=True, error_model="numpy")
def place(k, p):
    """Where the state has it."""
    return int(p[LINE, PLA]) + k


@njit(cache=True, error_model="numpy")
def bending(x, at, i, t, p, mode):
    """dz/dt of the bristle of body i, whose slip state is the sign of its speed."""
    w = x[at, i]
    return w - mode[SLIP, i] * w * x[at, bristle(i, p)] / sliding(w, i, t, p, mode)


@njit(cache=True, error_model="numpy")
def loses(i, p):
    """Whether body i is behind a transmission with losses."""
    return p[LDG, i] > 0.0 or p[LDN, i] > 0.0


@njit(cache=True, error_model="numpy")
def through(x, at, i, u, p, mode):
    """Torque that the transmission passes on to body i, if that is not accelerated where it is the first."""
    if i > 0:
        return shaft_torque(x, at, i - 1, p, mode)
    applied, ripple, ripple2 = motor_torques(x, at, u, p)
    return applied + ripple + ripple2


@njit(cache=True, error_model="numpy")
def level(x, at, i, way, t, u, p, mode):
    """Torque that body i can hold against motion in direction `way`."""
    coulomb = p[COU, i] if way > 0 else p[CBK, i]
    hold = coulomb * friction_factor(t, p) + p[STR, i]
    if loses(i, p):
        torque = through(x, at, i, u, p, mode)
        hold += (p[LDG, i] if torque * way > 0.0 else p[LDN, i]) * abs(torque)
    return hold


@njit(cache=True, error_model="numpy")
def accelerating(x, at, i, t, u, p, mode):
    """What is left of the row NET to accelerate body i."""
    force, way = x[NET, i], mode[SLIP, i]
    if p[ROU, i] == 0.0:
        return force
    if way == 0:
        return 0.0
    force -= way * sliding(x[at, i], i, t, p, mode)
    return less_loss(force, x, at, i, u, p, mode) if loses(i, p) else force


@njit(cache=True, error_model="numpy")
def less_loss(force, x, at, i, u, p, mode):
    """What of a force is left behind a transmission with losses."""
    same = mode[SLIP, i] * mode[PULL, i]
    share = same * (p[LDG, i] if same > 0 else p[LDN, i])
    force -= share * through(x, at, i, u, p, mode)
    return force / (1.0 - share * p[LINE, ROT] / p[JN, i])


@njit(cache=True, error_model="numpy")
def transmitted(x, at, i, t, u, p, mode):
    """Torque that the transmission passes on to body i."""
    torque = through(x, at, i, u, p, mode)
    if p[LINE, ROT] > 0.0:
        net_torques(x, at, t, u, p, mode)
        torque -= p[LINE, ROT] * accelerating(x, at, i, t, u, p, mode) / p[JN, i]
    return torque


@njit(cache=True, error_model="numpy")
def derivative(x, at, to, t, u, p, mode):
    """d/dt of the state in the current mode, from row `at` into row `to`."""
    n = bodies(p)
    net_torques(x, at, t, u, p, mode)
    for i in range(n):
        x[to, i] = accelerating(x, at, i, t, u, p, mode) / p[JN, i]
        if p[BRK, i] > 0.0:
            x[to, bristle(i, p)] = p[BRK, i] * bending(x, at, i, t, p, mode)
    for k in range(n - 1):
        x[to, n + k] = x[at, k] / p[RAT, k] - x[at, k + 1]
        if has_place(k, p):
            rate = x[to, n + k] + p[KS, k] / p[CS, k] * (x[at, n + k] - x[at, place(k, p)])
            x[to, place(k, p)] = 0.0 if mode[CONTACT, k] else rate
    x[to, 2 * n - 1] = x[at, 0]
    w0 = p[LINE, W0]
    if w0 > 0.0 and np.isinf(p[LINE, ZETA]):
        x[to, 2 * n], x[to, 2 * n + 1] = w0 * (u.command - x[at, 2 * n]), 0.0
    elif w0 > 0.0:
        x[to, 2 * n] = x[at, 2 * n + 1]
        x[to, 2 * n + 1] = w0 * w0 * (u.command - x[at, 2 * n]) - 2.0 * p[LINE, ZETA] * w0 * x[at, 2 * n + 1]
    if p[LINE, FIL] > 0.0:
        x[to, 2 * n + 2] = (x[at, 0] - x[at, 2 * n + 2]) / p[LINE, FIL]


@njit(cache=True, error_model="numpy")
def step_ahead(x, t, h, u, p, mode):
    """State h seconds after row NOW in the same mode, into row NEXT."""
    size = x.shape[1]
    for j in range(size):
        x[NEXT, j] = x[NOW, j]
    for s in range(STAGES):
        for j in range(size):
            x[TRIAL, j] = x[NOW, j]
        for r in range(s):
            share = h * A[s, r]
            if share != 0.0:
                for j in range(size):
                    x[TRIAL, j] += share * x[r, j]
        derivative(x, TRIAL, s, t + C[s] * h, u, p, mode)
        share = h * B[s]
        if share != 0.0:
            for j in range(size):
                x[NEXT, j] += share * x[s, j]


@njit(cache=True, error_model="numpy")
def direction(x, i, t, u, p, mode):
    """Where a body at standstill goes: nowhere while friction can hold it."""
    net_torques(x, NOW, t, u, p, mode)
    if x[NET, i] > level(x, NOW, i, 1, t, u, p, mode):
        return 1
    return -1 if x[NET, i] < -level(x, NOW, i, -1, t, u, p, mode) else 0


@njit(cache=True, error_model="numpy")
def violated(x, at, t, u, p, mode):
    """(shaft, n-1 + body or 2n-1 + body, new contact, slip or pull) of the first guard that fails; or (-1, 0)."""
    n = bodies(p)
    for k in range(n - 1):
        if p[GAP, k] > 0.0:
            noise = p[KS, k] * (1e-15 + 1e-13 * p[GAP, k])
            side = mode[CONTACT, k]
            if side != 0:
                if side * one_side(x, at, k, side, p) < -noise:
                    return k, 0
            elif has_place(k, p):
                b = x[at, place(k, p)]
                if p[KS, k] * (abs(b) - p[GAP, k]) > noise:
                    return k, int(np.sign(b))
            elif one_side(x, at, k, 1, p) > noise:
                return k, 1
            elif one_side(x, at, k, -1, p) < -noise:
                return k, -1
        elif load_dependent(k, p) and mode[CONTACT, k] * x[at, n + k] < -TWIST_NOISE:
            return k, -mode[CONTACT, k]
    known = False
    for i in range(n):
        if p[BRK, i] > 0.0 and mode[SLIP, i] * x[at, i] < -KINK_NOISE:
            return n - 1 + i, -mode[SLIP, i]
        if p[ROU, i] > 0.0:
            if mode[SLIP, i] != 0:
                if mode[SLIP, i] * x[at, i] < -SPEED_NOISE:
                    return n - 1 + i, 0
                if loses(i, p):
                    noise = 1e-14 * p[KS, i - 1] if i > 0 else 1e-12
                    if mode[PULL, i] * transmitted(x, at, i, t, u, p, mode) < -noise:
                        return 2 * n - 1 + i, -mode[PULL, i]
                continue
            if not known:
                net_torques(x, at, t, u, p, mode)
                known = True
            for way in (1, -1):
                hold = level(x, at, i, way, t, u, p, mode)
                if way * x[NET, i] - hold > 1e-12 * hold:
                    return n - 1 + i, way
    return -1, 0


@njit(cache=True, error_model="numpy")
def leave(which, new, x, t, u, p, mode):
    """Change the mode at an event; a body that halts gets exactly zero speed."""
    n = bodies(p)
    if which >= 2 * n - 1:
        mode[PULL, which - (2 * n - 1)] = new
        return
    change(which, new, x, t, u, p, mode)
    choose_pulls(x, t, u, p, mode)


@njit(cache=True, error_model="numpy")
def choose_pulls(x, t, u, p, mode):
    """The signs of the torques that transmissions pass on."""
    for i in range(bodies(p)):
        if loses(i, p):
            mode[PULL, i] = 1
            mode[PULL, i] = 1 if transmitted(x, NOW, i, t, u, p, mode) >= 0.0 else -1


@njit(cache=True, error_model="numpy")
def change(which, new, x, t, u, p, mode):
    """Change a contact or slip state."""
    n = bodies(p)
    if which < n - 1:
        mode[CONTACT, which] = new
        if new and has_place(which, p):
            x[NOW, place(which, p)] = new * p[GAP, which]
        if p[GAP, which] > 0.0:
            mode[EVENTS, MADE if new else LOST] += 1
        return
    i = which - (n - 1)
    if p[BRK, i] > 0.0:
        mode[SLIP, i] = new
        return
    if new:
        mode[SLIP, i] = new
        mode[EVENTS, RELEASED] += 1
        return
    x[NOW, i] = 0.0
    before = mode[SLIP, i]
    now = direction(x, i, t, u, p, mode)
    mode[SLIP, i] = now
    if now != before:
        mode[EVENTS, REVERSED if now else STUCK] += 1


@njit(cache=True, error_model="numpy")
def settle(x, t, u, p, mode):
    """Choose slip states after the torques may have jumped."""
    for i in range(bodies(p)):
        if p[BRK, i] > 0.0:
            net_torques(x, NOW, t, u, p, mode)
            mode[SLIP, i] = 1 if x[NOW, i] > 0.0 or (x[NOW, i] == 0.0 and x[NET, i] >= 0.0) else -1
        if p[ROU, i] == 0.0:
            continue
        before = mode[SLIP, i]
        if before * x[NOW, i] < 0.0 and abs(x[NOW, i]) <= SPEED_NOISE:
            x[NOW, i] = 0.0
        now = int(np.sign(x[NOW, i])) if x[NOW, i] != 0.0 else direction(x, i, t, u, p, mode)
        mode[SLIP, i] = now
        if now != before and x[NOW, i] == 0.0:
            mode[EVENTS, RELEASED if before == 0 else (REVERSED if now else STUCK)] += 1
    choose_pulls(x, t, u, p, mode)


@njit(cache=True, error_model="numpy")
def bristle_step(x, t, p, mode):
    """A third of the shortest time in which a bristle gets used to its speed."""
    fastest = 0.0
    for i in range(bodies(p)):
        if p[BRK, i] > 0.0:
            fastest = max(fastest, 3.0 * p[BRK, i] * abs(x[NOW, i]) / sliding(x[NOW, i], i, t, p, mode))
    return 1.0 / fastest if fastest > 0.0 else np.inf


@njit(cache=True, error_model="numpy")
def advance(x, t, length, longest, u, p, mode):
    """State `length` seconds on; False after too many events."""
    settle(x, t, u, p, mode)
    end, count = t + length, 0
    while True:
        which, new = violated(x, NOW, t, u, p, mode)
        if which >= 0:
            count += 1
            if count > MAX_EVENTS_PER_SAMPLE:
                return False
            leave(which, new, x, t, u, p, mode)
            continue
        left = end - t
        if left <= 1e-16:
            return True
        most = longest if p[LINE, BRI] == 0.0 else min(longest, bristle_step(x, t, p, mode))
        h = most if left > 1.000001 * most else left
        step_ahead(x, t, h, u, p, mode)
        if violated(x, NEXT, t + h, u, p, mode)[0] >= 0:
            low = 0.0
            for _ in range(64):
                middle = 0.5 * (low + h)
                if middle <= low or middle >= h or h - low < 1e-17:
                    break
                step_ahead(x, t, middle, u, p, mode)
                if violated(x, NEXT, t + middle, u, p, mode)[0] >= 0:
                    h = middle
                else:
                    low = middle
            step_ahead(x, t, h, u, p, mode)
        for j in range(x.shape[1]):
            x[NOW, j] = x[NEXT, j]
        t = t + h if h < left else end


@njit(cache=True, error_model="numpy")
def begin(x, p, mode):
    """Choose the contact states that belong to the state."""
    for k in range(bodies(p) - 1):
        mode[CONTACT, k] = 0
        if p[GAP, k] > 0.0:
            b = x[NOW, place(k, p)] if has_place(k, p) else 0.0
            if one_side(x, NOW, k, 1, p) > 0.0 and not (has_place(k, p) and b < p[GAP, k]):
                mode[CONTACT, k] = 1
            elif one_side(x, NOW, k, -1, p) < 0.0 and not (has_place(k, p) and b > -p[GAP, k]):
                mode[CONTACT, k] = -1
        elif load_dependent(k, p):
            mode[CONTACT, k] = 1 if x[NOW, bodies(p) + k] >= 0.0 else -1


@njit(cache=True, error_model="numpy")
def whole_record(x, p, mode, signals, control, timing, kept, commands):
    """Every sample of a record.

    signals   (5, samples) torque, torque noise, load torque, sensor noise, speed reference
    control   gain, reset, integral at the start, limit, resolution of the torque, of the speed
    timing    step, longest step of the integrator, whole samples and rest of the dead time,
              command before the first sample
    kept      (samples, 5n) filled: speeds, twists, angle, shaft torques, applied, measured, contacts, stuck
    commands  (samples,) filled
    returns   sample at which there were too many events, or -1
    """
    n, samples = bodies(p), commands.size
    step, longest, whole, rest, before = timing
    integral = control[2]
    begin(x, p, mode)
    for i in range(samples):
        t = i * step
        seen = (x[NOW, 2 * n + 2] if p[LINE, FIL] > 0.0 else x[NOW, 0]) + signals[3, i]
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
        load, switch = signals[2, i], p[LINE, LTI]
        first = later if rest > 0.0 else late
        stepped = p[LINE, LST] if switch <= t else 0.0
        u = Input(first, signals[1, i], load + stepped)
        settle(x, t, u, p, mode)
        keep(kept[i], x, seen, u, p, mode)
        cuts = (rest, switch - t if t < switch < t + step and p[LINE, LST] != 0.0 else 0.0)
        piece_start = 0.0
        for cut in (min(cuts), max(cuts), step):
            if cut > piece_start:
                half = 0.5 * (piece_start + cut)
                u = Input(late if half > rest else later, signals[1, i],
                          load + (p[LINE, LST] if t + half > switch else 0.0))
                if not advance(x, t + piece_start, cut - piece_start, longest, u, p, mode):
                    return i
                piece_start = cut
    return -1


@njit(cache=True, error_model="numpy")
def keep(row, x, seen, u, p, mode):
    """All that is kept of one instant."""
    n = bodies(p)
    row[: 2 * n] = x[NOW, : 2 * n]
    for k in range(n - 1):
        torque = shaft_torque(x, NOW, k, p, mode)
        row[2 * n + k] = torque
        row[3 * n + 1 + k] = mode[CONTACT, k] if p[GAP, k] > 0.0 else np.sign(torque)
    row[3 * n - 1] = (x[NOW, 2 * n] if p[LINE, W0] > 0.0 else u.command) + u.noise
    row[3 * n] = seen
    for i in range(n):
        row[4 * n + i] = 1.0 if p[ROU, i] > 0.0 and mode[SLIP, i] == 0 else 0.0
