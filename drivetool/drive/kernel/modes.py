"""The matrices of one mode as jets: the state matrix and the exact step over a part of a sample."""

from __future__ import annotations

import numpy as np
from numba import njit

from drivetool.drive.arrays import MAX_GUARD_INSTANTS, WIDE_BLOCK
from drivetool.drive.compile import CACHE, COMPILE, INLINED, REAL, SYSTEM, WHOLE, WHOLES, as_unit

# The Taylor terms after which exp is exact to rounding for a norm of one half.
TAYLOR_TERMS = 14
# Rate times length above which events are not located any more. Motion that much faster than the sampling leaves no
# trace in the record, and the step would take unbounded time at an extreme trial value of a fit.
MAX_LOCATED_RATE = 100.0

@njit(**COMPILE)
def lookup(s, c, mode, part):
    """The slot of a mode, filled first if it is new."""
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
        compute_mode(c.compute_mode, s, c, mode, part, k, 0.0)
    return k


@as_unit(SYSTEM, CACHE, WHOLES[1], WHOLE, WHOLE, REAL)
def compute_mode(s, c, mode, part, k, h):
    """Fill slot k; with h > 0 only the last slot, with the step of mode k over h seconds."""
    if h > 0.0:
        step_matrix(s, c, mode, k, c.rate.size - 1, h)
        return
    stamp_mode(s, c, mode, k)
    c.rate[k] = balanced_norm(c.a_matrix[k], c.square, s.nx)
    step_matrix(s, c, mode, k, k, s.part_lengths[part])
    fill_guard_rows(s, c, mode, k, s.part_lengths[part])
    if c.phi_mid.shape[0] > 0:
        exponential(c.a_matrix[k], 0.5 * s.part_lengths[part], c.rate[k], c.jets, c.phi_mid[k], c.dphi_mid[k])
        zero_resting_speed(s, c.phi_mid[k], mode)
        law_columns_over_torques(s, c, k, s.part_lengths[part])
        fill_blocks(c.dphi_mid[k], c.dphi_mid_blocks[k])
    fill_blocks(c.dphi[k], c.dphi_blocks[k])


@njit(**COMPILE)
def fill_blocks(d, wide):
    """d (nx, nz, nq) in blocks of WIDE columns, all rows of a block one behind the other."""
    nx, nz, nq = d.shape
    for r in range(nx):
        for j in range(nz):
            for q in range(nq):
                wide[q // WIDE_BLOCK, WIDE_BLOCK * (r * nz + j) + q % WIDE_BLOCK] = d[r, j, q]


@njit(**INLINED)
def law_columns_over_torques(s, c, k, h):
    """Change columns of the smooth laws from value, slope and curvature to torques at start, middle and end.

    h  length of the part of a sample that slot k steps over [s]
    """
    for at in range(s.plain, s.nx, 3):
        for r in range(s.plain):
            row_over_torques(c.phi[k, r], at, h)
            row_over_torques(c.phi_mid[k, r], at, h)
            derivative_rows_over_torques(c.dphi[k, r], at, h)
            derivative_rows_over_torques(c.dphi_mid[k, r], at, h)
        for e in range(s.ng + s.nf + s.nt):
            for m in range(c.guard_instants[k] + 1):
                row_over_torques(c.guard_rows[k, e, m], at, h)


@njit(**COMPILE)
def row_over_torques(row, at, h):
    """The same for row[at:at + 3]."""
    value, slope, curvature = row[at], row[at + 1] / h, 4.0 * row[at + 2] / (h * h)
    row[at], row[at + 1], row[at + 2] = (
        value - 3.0 * slope + curvature, 4.0 * slope - 2.0 * curvature, curvature - slope)


@njit(**COMPILE)
def derivative_rows_over_torques(rows, at, h):
    """The same for rows[at:at + 3, q]."""
    for q in range(rows.shape[1]):
        value, slope, curvature = rows[at, q], rows[at + 1, q] / h, 4.0 * rows[at + 2, q] / (h * h)
        rows[at, q], rows[at + 1, q] = value - 3.0 * slope + curvature, 4.0 * slope - 2.0 * curvature
        rows[at + 2, q] = curvature - slope


@njit(**INLINED)
def stamp_mode(s, c, mode, k):
    """The state matrix of slot k: stamp the switching elements, divide by the mass."""
    nx, const, jet = s.nx, s.nx + s.nu, s.nq + 1
    a = c.a_matrix[k]
    for r in range(nx):
        for j in range(const + 1):
            for q in range(jet):
                a[r, j, q] = s.rows[r, j, q]
    for g in range(s.ng):
        if mode[g] != 1:
            for e in range(2):
                stamp_contact(s, a, g, e, 1.0 - mode[g])
            if s.relaxing[g, 0] >= 0:  # in contact the elastic twist follows the twist
                for j in range(const + 1):
                    for q in range(jet):
                        a[s.relaxing[g, 0], j, q] = s.rows[s.relaxing[g, 1], j, q]
    for f in range(s.nf):
        row = s.slip_rows[f]
        for j in range(const + 1):
            c.net_torque[k, f, j] = a[row, j, 0]
        for q in range(jet):
            a[row, const, q] -= (1.0 - mode[s.ng + f]) * s.level[f, q]
        if s.loss_of[f] >= 0:
            stamp_loss(s, c, mode, k, f, c.jets[0, 0])
    for r in range(nx):
        for j in range(const + 1):
            a[r, j, 0] /= s.mass[r, 0]
            for q in range(1, jet):
                a[r, j, q] = (a[r, j, q] - a[r, j, 0] * s.mass[r, q]) / s.mass[r, 0]
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            hold_body(a, s.slip_rows[f])


@njit(**COMPILE)
def stamp_loss(s, c, mode, k, f, through):
    """The loss of the transmission in front of the body of friction f; through (nz, 1 + nq) is scratch.

    What accelerates a rotor in front of it is not transmitted: then the loss acts on the mass too.
    """
    t, row, const, way = s.loss_of[f], s.slip_rows[f], s.nx + s.nu, 1.0 - mode[s.ng + f]
    a, rotor = c.a_matrix[k, row], s.rotor_share[t]
    factor = way * (1.0 - mode[s.ng + s.nf + t])
    loss = s.loss[t, 0 if factor > 0.0 else 1]
    g = s.loss_gap[t]
    for j in range(const + 1):
        for q in range(s.nq + 1):
            through[j, q] = s.transmitted[t, j, q]
            if g >= 0 and mode[g] != 1:
                if j < s.nx:
                    through[j, q] += s.spring[g, j, q]
                elif j == const:
                    through[j, q] -= (1.0 - mode[g]) * s.reach[g, q]
        c.net_torque[k, s.nf + t, j] = through[j, 0] - (rotor[0] * a[j, 0] if way != 0.0 else 0.0)
    scale = 1.0 / (1.0 - factor * loss[0] * rotor[0])
    for j in range(const + 1):
        a[j, 0] = scale * (a[j, 0] - factor * loss[0] * through[j, 0])
        for q in range(1, s.nq + 1):
            a[j, q] = scale * (a[j, q] - factor * (loss[0] * through[j, q] + loss[q] * through[j, 0])
                               + factor * (loss[0] * rotor[q] + loss[q] * rotor[0]) * a[j, 0])


@njit(**COMPILE)
def torque_to_start(s, net, mode, f, way, row):
    """row (nz,) = torque that a sticking body would start with in direction `way`, but for its Coulomb friction.

    net  (nf + nt, nz) of the mode
    """
    t = s.loss_of[f]
    for j in range(row.size):
        row[j] = net[f, j]
    if t >= 0:
        factor = way * (1.0 - mode[s.ng + s.nf + t])
        factor *= s.loss[t, 0 if factor > 0.0 else 1, 0]
        for j in range(row.size):
            row[j] -= factor * net[s.nf + t, j]


@njit(**INLINED)
def hold_body(a, row):
    """A sticking body has no acceleration, and its speed of zero has no effect."""
    for j in range(a.shape[1]):
        for q in range(a.shape[2]):
            a[row, j, q] = 0.0
    for r in range(a.shape[0]):
        for q in range(a.shape[2]):
            a[r, row, q] = 0.0


@njit(**COMPILE)
def step_matrix(s, c, mode, k, to, h):
    """The exact step of mode k over h seconds, into slot `to`."""
    exponential(c.a_matrix[k], h, c.rate[k], c.jets, c.phi[to], c.dphi[to])
    zero_resting_speed(s, c.phi[to], mode)


@njit(**COMPILE)
def zero_resting_speed(s, phi, mode):
    """Clear the effect of the start speed of a body that sticks: that speed is zero."""
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            phi[s.slip_rows[f], s.slip_rows[f]] = 0.0


@njit(**INLINED)
def fill_guard_rows(s, c, mode, k, h):
    """Rows that give every guard at the start of a part of h seconds and equally spaced inside."""
    a, rate, row = c.a_matrix[k], c.rate[k], c.row_scratch[0]
    count = 0 if not rate * h < MAX_LOCATED_RATE else min(max(int(np.ceil(rate * h)) - 1, 1), MAX_GUARD_INSTANTS)
    c.guard_instants[k] = count
    gap = h / (count + 1)
    pieces = max(int(np.ceil(2.0 * rate * gap)), 1) if count > 0 else 1
    for e in range(s.ng + s.nf + s.nt):
        f, guard_rows = e - s.ng, c.guard_rows[k, e]
        for j in range(row.size):
            row[j] = c.net_torque[k, f, j] if f >= s.nf or (f >= 0 and mode[e] == 1) else 0.0
        if f < 0:
            for j in range(s.nx):
                row[j] = s.open_guard[e, j, 0] if mode[e] == 1 else s.spring[e, j, 0]
        elif f < s.nf and mode[e] == 1 and s.loss_of[f] >= 0:
            # Towards the torque transmitted: as that way starts first, one level then bounds both.
            way = 1.0 - mode[s.ng + s.nf + s.loss_of[f]]
            torque_to_start(s, c.net_torque[k], mode, f, way, row)
        elif f < s.nf and mode[e] != 1:
            row[s.slip_rows[f]] = 1.0
        for j in range(row.size):
            guard_rows[0, j] = row[j]
        for m in range(count):
            for _ in range(pieces):
                advance_row(a, row, c.row_scratch[1], c.row_scratch[2], gap / pieces)
            for j in range(row.size):
                guard_rows[m + 1, j] = row[j]


@njit(**INLINED)
def advance_row(a, row, term, new, h):
    """row (nz,) becomes the row that gives its value h seconds later; term, new (nz,) are scratch."""
    for j in range(row.size):
        term[j] = row[j]
    for k in range(1, TAYLOR_TERMS + 1):
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


@njit(**INLINED)
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
            # A state that affects no other, or that no other affects, may be scaled freely.
            scale = np.sqrt(row / col) if row > 0.0 and col > 0.0 else (1e3 if row > 0.0 else 1e-3)
            for j in range(nx):
                if j != i:
                    b[i, j] /= scale
                    b[j, i] *= scale
    worst = 0.0
    for i in range(nx):
        total = 0.0
        for j in range(nx):
            total += b[i, j]
        worst = max(worst, total)
    return worst


@njit(**COMPILE)
def multiply_jets(a, b, factor, out):
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
def exponential(a, h, rate, scratch, phi, dphi):
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
    for k in range(2, TAYLOR_TERMS + 1):
        multiply_jets(a, t, h / k, n)
        for r in range(nx):
            for j in range(nz):
                for q in range(jet):
                    e[r, j, q] += n[r, j, q]
        t, n = n, t
    for _ in range(halvings):
        # (1 + e)(1 + e) - 1 = 2 e + e e keeps the small part separate from the identity.
        multiply_jets(e, e, 1.0, n)
        for r in range(nx):
            for j in range(nz):
                for q in range(jet):
                    e[r, j, q] = 2.0 * e[r, j, q] + n[r, j, q]
    for r in range(nx):
        e[r, r, 0] += 1.0
        for j in range(nz):
            phi[r, j] = e[r, j, 0]
            for q in range(1, jet):
                dphi[r, j, q - 1] = e[r, j, q]
