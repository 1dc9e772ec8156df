"""The matrices of one mode: the flow, the exact step over a part of a sample, as jets."""

from __future__ import annotations

import numpy as np
from numba import njit

from drivetool.drive.arrays import LOOKS, WIDE
from drivetool.drive.compile import CACHE, COMPILE, HOT, REAL, SYSTEM, WHOLE, WHOLES, unit

# The Taylor terms after which exp is exact to rounding for a norm of one half.
TERMS = 14
# Rate times length above which events are not located any more: what moves that much faster than
# the record is sampled leaves no trace in it, and a trial value of a fit must not take for ever.
STIFF = 100.0

@njit(**COMPILE)
def lookup(s, c, mode, part):
    """The slot of a mode, worked out first if it is new."""
    number = part
    for digit in mode:
        number = 3 * number + digit
    k = c.slot[number]
    if k < 0:
        last = c.slot.size - 1
        if c.slot[last] == c.rate.size - 1:
            for m in range(last):
                c.slot[m] = -1
            c.slot[last] = 0
        k = c.slot[last]
        c.slot[last] += 1
        c.slot[number] = k
        work_out(c.work_out, s, c, mode, part, k, 0.0)
    return k


@unit(SYSTEM, CACHE, WHOLES[1], WHOLE, WHOLE, REAL)
def work_out(s, c, mode, part, k, h):
    """Fill slot k; with h > 0 only the last slot, with the step of mode k over h seconds."""
    if h > 0.0:
        step_matrix(s, c, mode, k, c.rate.size - 1, h)
        return
    stamp_mode(s, c, mode, k)
    c.rate[k] = balanced_norm(c.flow[k], c.square, s.nx)
    step_matrix(s, c, mode, k, k, s.spans[part])
    look_ahead(s, c, mode, k, s.spans[part])
    if c.mid.shape[0] > 0:
        exponential(c.flow[k], 0.5 * s.spans[part], c.rate[k], c.jets, c.mid[k], c.dmid[k])
        let_rest(s, c.mid[k], mode)
        laws_by_torques(s, c, k, s.spans[part])
        in_blocks(c.dmid[k], c.wide_mid[k])
    in_blocks(c.dleap[k], c.wide[k])


@njit(**COMPILE)
def in_blocks(d, wide):
    """d (nx, nz, nq) in blocks of WIDE columns, all rows of a block one behind the other."""
    nx, nz, nq = d.shape
    for r in range(nx):
        for j in range(nz):
            for q in range(nq):
                wide[q // WIDE, WIDE * (r * nz + j) + q % WIDE] = d[r, j, q]


@njit(**HOT)
def laws_by_torques(s, c, k, h):
    """Columns of the smooth laws over their torques at start, middle and end, not over value, slope and bend.

    h  length of the part of a sample that slot k steps over [s]
    """
    for at in range(s.plain, s.nx, 3):
        for r in range(s.plain):
            by_torques(c.leap[k, r], at, h)
            by_torques(c.mid[k, r], at, h)
            derivatives_by_torques(c.dleap[k, r], at, h)
            derivatives_by_torques(c.dmid[k, r], at, h)
        for e in range(s.ng + s.nf):
            for m in range(c.looks[k] + 1):
                by_torques(c.watch[k, e, m], at, h)


@njit(**COMPILE)
def by_torques(row, at, h):
    """The same for row[at:at + 3]."""
    value, slope, bend = row[at], row[at + 1] / h, 4.0 * row[at + 2] / (h * h)
    row[at], row[at + 1], row[at + 2] = value - 3.0 * slope + bend, 4.0 * slope - 2.0 * bend, bend - slope


@njit(**COMPILE)
def derivatives_by_torques(rows, at, h):
    """The same for rows[at:at + 3, q]."""
    for q in range(rows.shape[1]):
        value, slope, bend = rows[at, q], rows[at + 1, q] / h, 4.0 * rows[at + 2, q] / (h * h)
        rows[at, q], rows[at + 1, q] = value - 3.0 * slope + bend, 4.0 * slope - 2.0 * bend
        rows[at + 2, q] = bend - slope


@njit(**HOT)
def stamp_mode(s, c, mode, k):
    """The flow of slot k: stamp the switching elements, divide by the mass."""
    nx, const, jet = s.nx, s.nx + s.nu, s.nq + 1
    a = c.flow[k]
    for r in range(nx):
        for j in range(const + 1):
            for q in range(jet):
                a[r, j, q] = s.rows[r, j, q]
    for g in range(s.ng):
        if mode[g] != 1:
            for e in range(2):
                stamp_contact(s, a, g, e, 1.0 - mode[g])
    for f in range(s.nf):
        row = s.slip_rows[f]
        for j in range(const + 1):
            c.net[k, f, j] = a[row, j, 0]
        for q in range(jet):
            a[row, const, q] -= (1.0 - mode[s.ng + f]) * s.level[f, q]
    for r in range(nx):
        for j in range(const + 1):
            a[r, j, 0] /= s.mass[r, 0]
            for q in range(1, jet):
                a[r, j, q] = (a[r, j, q] - a[r, j, 0] * s.mass[r, q]) / s.mass[r, 0]
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            hold(a, s.slip_rows[f])


@njit(**HOT)
def hold(a, row):
    """A body that sticks has no acceleration, and its speed, which is zero, moves nothing."""
    for j in range(a.shape[1]):
        for q in range(a.shape[2]):
            a[row, j, q] = 0.0
    for r in range(a.shape[0]):
        for q in range(a.shape[2]):
            a[r, row, q] = 0.0


@njit(**COMPILE)
def step_matrix(s, c, mode, k, to, h):
    """The exact step of mode k over h seconds, into slot `to`."""
    exponential(c.flow[k], h, c.rate[k], c.jets, c.leap[to], c.dleap[to])
    let_rest(s, c.leap[to], mode)


@njit(**COMPILE)
def let_rest(s, leap, mode):
    """A start speed that was zero counts no more once the body sticks."""
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            leap[s.slip_rows[f], s.slip_rows[f]] = 0.0


@njit(**HOT)
def look_ahead(s, c, mode, k, h):
    """Rows that give every guard at the start of a part of h seconds and equally spaced inside."""
    a, rate, row = c.flow[k], c.rate[k], c.lines[0]
    count = 0 if not rate * h < STIFF else min(max(int(np.ceil(rate * h)) - 1, 1), LOOKS)
    c.looks[k] = count
    gap = h / (count + 1)
    pieces = max(int(np.ceil(2.0 * rate * gap)), 1) if count > 0 else 1
    for e in range(s.ng + s.nf):
        f, watch = e - s.ng, c.watch[k, e]
        for j in range(row.size):
            row[j] = c.net[k, f, j] if f >= 0 and mode[e] == 1 else 0.0
        if f < 0:
            for j in range(s.nx):
                row[j] = s.spring[e, j, 0]
        elif mode[e] != 1:
            row[s.slip_rows[f]] = 1.0
        for j in range(row.size):
            watch[0, j] = row[j]
        for m in range(count):
            for _ in range(pieces):
                advance_row(a, row, c.lines[1], c.lines[2], gap / pieces)
            for j in range(row.size):
                watch[m + 1, j] = row[j]


@njit(**HOT)
def advance_row(a, row, term, new, h):
    """row (nz,) becomes the row that gives its value h seconds later; term, new (nz,) are scratch."""
    for j in range(row.size):
        term[j] = row[j]
    for k in range(1, TERMS + 1):
        for j in range(row.size):
            v = 0.0
            for r in range(a.shape[0]):
                v += term[r] * a[r, j, 0]
            new[j] = v * h / k
        for j in range(row.size):
            term[j] = new[j]
            row[j] += new[j]


@njit(**COMPILE)
def stamp_contact(s, a, g, e, side):
    """Shaft torque (spring x - side reach) on one of its two bodies."""
    row, const = s.gap_rows[g, e], s.nx + s.nu
    gain, spring, reach = s.gap_gain[g, e], s.spring[g], s.reach[g]
    for j in range(s.nx):
        a[row, j, 0] += gain[0] * spring[j, 0]
        for q in range(1, s.nq + 1):
            a[row, j, q] += gain[0] * spring[j, q] + gain[q] * spring[j, 0]
    a[row, const, 0] -= side * gain[0] * reach[0]
    for q in range(1, s.nq + 1):
        a[row, const, q] -= side * (gain[0] * reach[q] + gain[q] * reach[0])


@njit(**HOT)
def balanced_norm(a, b, nx):
    """Infinity norm of the state part after diagonal balancing (Osborne 1960), in 1/s.

    Without it a stiff shaft counts with ks/J instead of sqrt(ks/J): angles and speeds have
    different units. b (nx, nx) is scratch.
    """
    for i in range(nx):
        for j in range(nx):
            b[i, j] = abs(a[i, j, 0])
    for _ in range(6):
        for i in range(nx):
            row, col = 0.0, 0.0
            for j in range(nx):
                if j != i:
                    row += b[i, j]
                    col += b[j, i]
            # A state that drives nothing, or is driven by nothing, may be scaled at will.
            down = np.sqrt(row / col) if row > 0.0 and col > 0.0 else (1e3 if row > 0.0 else 1e-3)
            for j in range(nx):
                if j != i:
                    b[i, j] /= down
                    b[j, i] *= down
    worst = 0.0
    for i in range(nx):
        total = 0.0
        for j in range(nx):
            total += b[i, j]
        worst = max(worst, total)
    return worst


@njit(**COMPILE)
def multiply(a, b, factor, out):
    """out = factor a[:, :nx] b for jets a, b, out (nx, nz, 1 + nq)."""
    nx, nz, jet = a.shape
    for r in range(nx):
        for j in range(nz):
            for q in range(jet):
                v = 0.0
                for m in range(nx):
                    v += a[r, m, 0] * b[m, j, q]
                    if q > 0:
                        v += a[r, m, q] * b[m, j, 0]
                out[r, j, q] = v * factor


@njit(**COMPILE)
def exponential(a, h, rate, scratch, leap, dleap):
    """Rows of exp([[A B]; [0 0]] h) and their derivatives: Taylor, then repeated squaring."""
    nx, nz, jet = a.shape
    halvings = 0
    while rate * h > 0.5:
        h *= 0.5
        halvings += 1
    e, t, n = scratch[0], scratch[1], scratch[2]
    for r in range(nx):
        for j in range(nz):
            for q in range(jet):
                t[r, j, q] = a[r, j, q] * h
                e[r, j, q] = t[r, j, q]
    for k in range(2, TERMS + 1):
        multiply(a, t, h / k, n)
        for r in range(nx):
            for j in range(nz):
                for q in range(jet):
                    e[r, j, q] += n[r, j, q]
        t, n = n, t
    for _ in range(halvings):
        # (1 + e)(1 + e) - 1 = 2 e + e e keeps the small part apart from the identity.
        multiply(e, e, 1.0, n)
        for r in range(nx):
            for j in range(nz):
                for q in range(jet):
                    e[r, j, q] = 2.0 * e[r, j, q] + n[r, j, q]
    for r in range(nx):
        e[r, r, 0] += 1.0
        for j in range(nz):
            leap[r, j] = e[r, j, 0]
            for q in range(1, jet):
                dleap[r, j, q - 1] = e[r, j, q]
