"""The extended Kalman filter: the pass over a record that gives observer gains and a likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable

from numba import njit

from drivetool.drive.arrays import MADE_FOR, NARROW
from drivetool.drive.compile import CACHE, COMPILE, FILTERING, HOT, LAWS, REAL, REALS, SYSTEM, WHOLE, unit
from drivetool.drive.kernel.events import load_on, rough_step
from drivetool.drive.kernel.exact_step import fading, forget, predict, stays
from drivetool.drive.kernel.glide import carrier, filter_glider, stepper
from drivetool.drive.kernel.laws import set_hold, slope_of
from drivetool.drive.kernel.modes import lookup
from drivetool.drive.kernel.outputs import output_row
from drivetool.drive.kernel.registers import put, taker, turned
from drivetool.drive.kernel.run import hold_back, law_part, plain_step, reclassify, reveal
from drivetool.drive.kernel.smooth import law_motion, law_transition
from drivetool.drive.kernel.smooth_events import law_rough_step

FIRM = 5.0  # standard deviations of torque that hold a body for good: noise exceeds them once in 3e6 samples


@njit(**COMPILE)
def see_through(laws, row):
    """Row of an output over the state alone, the torques of the laws put through their slopes."""
    if laws.shown == 0:
        return
    for m in range(laws.code.size):
        at = laws.first + 3 * m
        if row[at] != 0.0:
            slope_of(laws.arguments, m, laws.found[0, m], laws.slopes[m], laws.first)
            for j in range(laws.first):
                row[j] += row[at] * laws.slopes[m, j]
            row[at] = 0.0


@njit(**HOT)
def add_noise(leap, k, row, b):
    """Carry the effect of a torque held over the sample through a part of it, by the mode at its end.

    Noise thus does not move a body that sticks. row (n,) is over the drive's own states, b is scratch.
    """
    n, first = row.size, leap.shape[1]
    for j in range(n):
        b[j] = leap[k, j, first]
        for m in range(n):
            b[j] += leap[k, j, m] * row[m]
    for j in range(n):
        row[j] = b[j]


@njit(**HOT)
def update(p, row, pick, r, gain):
    """Measurement update of the covariance p (n, n); returns the variance of the innovation.

    pick  state that is measured, or -1 where row (n,) tells what is
    """
    nx, var = p.shape[0], r
    if pick >= 0:
        for j in range(nx):
            gain[j] = p[j, pick]
        var += gain[pick]
    else:
        for j in range(nx):
            v = 0.0
            for k in range(nx):
                v += p[j, k] * row[k]
            gain[j] = v
            var += row[j] * v
    share = 1.0 / var
    for j in range(nx):
        g = gain[j] * share
        for k in range(j):
            p[j, k] -= g * gain[k]
            p[k, j] = p[j, k]
        p[j, j] -= g * gain[j]
    for j in range(nx):
        gain[j] *= share
    return var


@njit(**HOT)
def multiply(a, b, n, out):
    """out = a b, of n rows and columns."""
    for j in range(n):
        for k in range(n):
            v = 0.0
            for m in range(n):
                v += a[j, m] * b[m, k]
            out[j, k] = v


@njit(**HOT)
def advance_covariance(p, f, noise, q, extra, t):
    """p = f p f' + q noise noise' + diag(extra), through the scratch t."""
    nx = noise.size
    multiply(f, p, nx, t)
    for j in range(nx):
        for k in range(j + 1):
            v = q * noise[j] * noise[k]
            for m in range(nx):
                v += t[j, m] * f[k, m]
            p[j, k] = v
            p[k, j] = v
        p[j, j] += extra[j]


@njit(**COMPILE)
def excess(a):
    """E[(z - a)^2; z > a] = (1 + a^2) Q(a) - a f(a) of a normal z, Q and f its tail and density."""
    tail, density = 0.5 * math.erfc(a / math.sqrt(2.0)), math.exp(-0.5 * a * a) / math.sqrt(2.0 * math.pi)
    return (1.0 + a * a) * tail - a * density


@njit(**COMPILE)
def loosen(s, c, k, mode, x, u, p, before, q, h):
    """Let noise move what sticks: covariance p of a sample of h seconds, at whose end bodies stick.

    Of a torque of standard deviation d, friction takes away what it lacks, m, to the friction's level on each side.
    What is left accelerates the body: E[(d z - m)^2; d z > m] = d^2 excess(m / d), z normal.
    A speed of variance v that a body may have had is braked as by the viscous friction m sqrt(2 / (pi v)), its
    statistical linearisation (Booton 1954).

    k  slot of the mode; u inputs of the sample; before (bodies that may stick,) variances of their speeds before it
    """
    n = p.shape[0]
    for f in range(s.nf):
        if mode[s.ng + f] != 1:
            continue
        net, row, level = c.net[k, f], s.slip_rows[f], c.hold[f, 0]
        variance = q * net[x.size] ** 2
        for j in range(n):
            for m in range(n):
                variance += net[j] * p[j, m] * net[m]
        d, pushed = math.sqrt(max(variance, 0.0)), 0.0
        margin = max(level - abs(load_on(net, x, u)), 0.0)
        if margin < FIRM * d:
            both = excess(margin / d) + excess((2.0 * level - margin) / d)
            pushed = variance * both * (h / s.mass[row, 0]) ** 2
        rest = 0.0
        if before[f] > 0.0:
            rest = math.exp(-margin * math.sqrt(2.0 / (math.pi * before[f])) * h / s.mass[row, 0])
        if pushed <= 0.0 and rest == 0.0:
            continue
        went = 0.5 * pushed + 0.5 * rest * (1.0 + rest) * before[f]
        way = 0.25 * pushed + 0.25 * (1.0 + rest) ** 2 * before[f]
        for j in range(n):
            if j == row:
                p[row, row] += pushed + rest * rest * before[f]
                continue
            g = s.rows[j, row, 0] / s.mass[j, 0] * h
            if g == 0.0:
                continue
            p[j, row] += g * went
            p[row, j] = p[j, row]
            for m in range(n):
                if m != row:
                    p[j, m] += g * s.rows[m, row, 0] / s.mass[m, 0] * h * way


# Units for the sake of those that are made for so many states.
@unit(REALS[2], REALS[2], REALS[1], REAL, REALS[1], REALS[2])
def spread(p, f, noise, q, extra, t):
    """advance_covariance."""
    advance_covariance(p, f, noise, q, extra, t)


@unit(REALS[2], REALS[2], WHOLE, REALS[2])
def join(f, moved, n, product):
    """moved = f moved, of n rows and columns, through a scratch."""
    multiply(f, moved, n, product)
    for j in range(n):
        for m in range(n):
            moved[j, m] = product[j, m]


@njit(**HOT)
def glided(s, c, k, x, u, i, mode, moved, noise, b):
    """Carry x over a sample in the mode of slot k; False if an event may lie in it.

    moved  gets the transition, noise what a torque held over the sample leaves in each state
    """
    predict(c.leap, k, x, u, i, b)
    if not stays(c.watch, c.looks, s.reach, c.hold, k, mode, x, b, u, i):
        return False
    n = noise.size
    for j in range(n):
        for m in range(n):
            moved[j, m] = c.leap[k, j, m]
        x[j] = b[j]
        noise[j] = c.leap[k, j, x.size]
    return True


@njit(**HOT)
def law_glided(s, c, laws, k, x, u, late, i, clock, mode, moved, noise, b):
    """The same with smooth laws, part by part; k -1 where it has to be looked up. Nothing moves if it is False."""
    n, parts, before, t, product = noise.size, s.spans.size, c.vectors[2], c.columns[1], c.columns[2]
    if parts > 1:
        for j in range(x.size):
            before[j] = x[j]
    for part in range(parts):
        held = late if part < s.early else u
        if s.nf > 0:
            set_hold(s, c, laws, clock)
        if k < 0 or parts > 1:
            k = lookup(s, c, mode, part)
        if not law_motion(laws.motion, s, c, laws, k, part, x, held, i, clock, mode, b, c.lines[0]):
            if part > 0:
                for j in range(x.size):
                    x[j] = before[j]
            return False
        law_transition(laws.transition, c, laws, k, moved if part == 0 else t)
        for j in range(n):
            x[j] = b[j]
        if part == 0:
            for j in range(n):
                noise[j] = c.leap[k, j, x.size]
        else:
            join(laws.join, t, moved, n, product)
            add_noise(c.leap, k, noise, b)
        clock += s.spans[part]
    return True


@njit(**HOT)
def by_parts(s, c, laws, step, number, x, u, late, i, clock, mode, moved, noise, b, t):
    """The same where the torque switches inside the sample, or an event lies in it; returns the slot at its end."""
    n, parts = noise.size, s.spans.size
    for j in range(n):
        for m in range(n):
            moved[j, m] = 1.0 if j == m else 0.0
        noise[j] = 0.0
    for part in range(parts):
        held = late if part < s.early else u
        if laws is None:
            number = lookup(s, c, mode, part)
            if parts == 1:
                free = False
            elif step is not None:
                free = step(s, c, number, x, held, i, moved, mode)
            else:
                free = plain_step(c.leap, c.dleap, c.watch, c.looks, s.reach, c.hold, number, x, held, i, moved,
                                  mode, b, t)
            if not free:
                rough_step(c.rough, s, c, x, held, i, moved, mode, part)
                number = lookup(s, c, mode, part)
        else:
            if parts == 1:
                law_rough_step(laws.rough, s, c, laws, x, held, i, clock, moved, mode, part)
                number = -1
            else:
                number, _ = law_part(s, c, laws, number, x, held, i, clock, moved, mode, part, b)
            number = lookup(s, c, mode, part) if number < 0 else number
            clock += s.spans[part]
        add_noise(c.leap, number, noise, b)
    return number


@njit(**HOT)
def correct(laws, outputs, spring, reach, output_gap, picks, mode, y, r, p, x, i, row, k, gain, var, innov):
    """Measurement updates of sample i: state, covariance, gains and innovations."""
    for m in range(innov.shape[1]):
        pick = picks[m]
        v = x[pick] if pick >= 0 else output_row(outputs, spring, reach, output_gap, picks, mode, m, x, row)
        e = y[i, m] - v
        if laws is not None and pick < 0:
            see_through(laws, row)
        innov[i, m] = e
        var[i, m] = 1.0
        known = e == e
        if known:
            var[i, m] = update(p, row, pick, r[m], k)
        for j in range(p.shape[0]):
            if gain.shape[0] > 0:
                gain[i, m, j] = k[j] if known else 0.0
            if known:
                x[j] += k[j] * e


@njit(**COMPILE)
def filter_through(s, c, laws, f, q, clock, glide, step, carry):
    """Extended Kalman filter: exact mode-wise transitions, sensitivities across events.

    f      a Filtering; the system has no free parameters, and ns = nx columns
    laws   None where there are none
    q      torque noise variance, entering with the first input
    clock  time of the first sample [s]
    glide, step, carry  of glide.py, for just so many states and one input; None for any
    """
    nx = s.plain
    u, late, y, r, extra, kick, p, x, mode = f.u, f.late, f.y, f.r, f.extra, f.kick, f.p, f.x, f.mode
    gain, var, innov, states = f.gain, f.var, f.innov, f.states
    guards, spring, slip_rows, picks = c.guards, s.spring, s.slip_rows, s.picks
    reach, outputs, output_gap, memory = s.reach, s.outputs, s.output_gap, s.memory
    n, whole, fades, number, length = mode.size, s.spans.size == 1, fading(memory), -1, s.spans.sum()
    row, b, k, noise = c.vectors[0], c.vectors[1], c.vectors[2], c.vectors[4][:nx]
    moved, t = c.transition, c.columns[0]
    reclassify(spring, slip_rows, reach, x, mode, guards)
    i = 0
    while i < u.shape[0]:
        if glide is not None and whole:
            number = lookup(s, c, mode, 0) if number < 0 else number
            i = glide(s, c, f, number, q, i)
            if i == u.shape[0]:
                break
        if laws is not None:
            reveal(s, laws, x, clock, mode, moved)
        correct(laws, outputs, spring, reach, output_gap, picks, mode, y, r, p, x, i, row, k, gain, var, innov)
        if s.nf > 0:
            hold_back(s, c, number, mode, x, u[i], length, moved)
        if n > 0 and reclassify(spring, slip_rows, reach, x, mode, guards):
            number = -1
        if states.shape[0] > 0:
            for j in range(nx):
                states[i, j] = x[j]
        if whole:
            number = lookup(s, c, mode, 0) if number < 0 else number
        if laws is not None:
            free = law_glided(s, c, laws, number, x, u, late, i, clock, mode, moved, noise, b)
        else:
            free = whole and glided(s, c, number, x, u, i, mode, moved, noise, b)
        if not free:
            number = by_parts(s, c, laws, step, number, x, u, late, i, clock, mode, moved, noise, b, t)
        clock += length
        for j in range(nx):
            noise[j] += kick[j]
        forget(memory, fades, x, moved)
        for m in range(s.nf):
            k[m] = p[s.slip_rows[m], s.slip_rows[m]]
        if laws is not None:
            spread(laws.spread, p, moved, noise, q, extra, t)
        elif carry is not None:
            carry(p, moved, noise, q, extra)
        else:
            advance_covariance(p, moved, noise, q, extra, t)
        if s.nf > 0:
            loosen(s, c, number, mode, x, u[i], p, k, q, length)
        i += 1


def spread_for(n: int) -> Callable:
    """The unit `spread` for n states."""
    carry = carrier(n)

    @unit(REALS[2], REALS[2], REALS[1], REAL, REALS[1], REALS[2])
    def spread(p, f, noise, q, extra, t):
        carry(p, f, noise, q, extra)

    return spread


def join_for(n: int) -> Callable:
    """The unit `join` for n states."""
    columns = taker(n, NARROW)

    @unit(REALS[2], REALS[2], WHOLE, REALS[2])
    def join(f, moved, _, product):
        width = moved.shape[1]
        for q in range(0, n, NARROW):
            block = columns(moved, q, width)
            for r in range(n):
                put(moved, q + r * width, turned(f, r * f.shape[1], block))

    return join


spread_3, spread_4, spread_5, spread_6, spread_7 = (spread_for(n) for n in MADE_FOR)
join_3, join_4, join_5, join_6, join_7 = (join_for(n) for n in MADE_FOR)


@unit(SYSTEM, CACHE, FILTERING, REAL, REAL)
def kalman(s, c, f, q, clock):
    """Filter a record; see filter_through."""
    filter_through(s, c, None, f, q, clock, None, None, None)


def made_for(n: int) -> Callable:
    """The same for n states and one input only, which is much faster."""
    glide, step, carry = filter_glider(n), stepper(n), carrier(n)

    @unit(SYSTEM, CACHE, FILTERING, REAL, REAL)
    def kalman(s, c, f, q, clock):
        filter_through(s, c, None, f, q, clock, glide, step, carry)

    return kalman


kalman_3, kalman_4, kalman_5, kalman_6, kalman_7 = (made_for(n) for n in MADE_FOR)


@unit(SYSTEM, CACHE, LAWS, FILTERING, REAL, REAL)
def kalman_laws(s, c, laws, f, q, clock):
    """The same with smooth laws."""
    filter_through(s, c, laws, f, q, clock, None, None, None)
