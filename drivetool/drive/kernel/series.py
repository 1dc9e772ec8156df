"""Power series in time of the state and of its sensitivities within a mode.

All SERIES_ORDER terms are always taken: rate times length does not bound the terms that matter, for the nilpotent
part of an open gap, where motion is a parabola, has almost no rate.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.compile import INLINED, NO_OVERLAP


@njit(**NO_OVERLAP)
def series(a, x, u, w):
    """Power series of the state: w (ORDER + 1, nx)."""
    nx = x.size
    for r in range(nx):
        v = a[r, nx + u.size, 0]
        for j in range(nx):
            v += a[r, j, 0] * x[j]
        for j in range(u.size):
            v += a[r, nx + j, 0] * u[j]
        w[0, r] = x[r]
        w[1, r] = v
    for k in range(2, w.shape[0]):
        share = 1.0 / k
        for r in range(nx):
            v = 0.0
            for j in range(nx):
                v += a[r, j, 0] * w[k - 1, j]
            w[k, r] = v * share


@njit(**NO_OVERLAP)
def term_of_any(a, w, n, power, g, r, v, t):
    """Row r of the next term, but for the inputs."""
    (nx, ns), nq = v.shape, a.shape[2] - 1
    e = a[r, 0, 0] * g
    for q in range(ns):
        t[r, q] = e * v[0, q]
    for j in range(1, nx):
        e = a[r, j, 0] * g
        for q in range(ns):
            t[r, q] += e * v[j, q]
    for j in range(nx):
        e = w[n, j] * power * g
        for q in range(nq):
            t[r, q] += e * a[r, j, q + 1]


@njit(**NO_OVERLAP)
def term_of_three(a, w, n, power, g, r, v, t):
    """The same for three states: the two-mass drive."""
    e0, e1, e2 = a[r, 0, 0] * g, a[r, 1, 0] * g, a[r, 2, 0] * g
    f0, f1, f2 = w[n, 0] * power * g, w[n, 1] * power * g, w[n, 2] * power * g
    for q in range(v.shape[1]):
        t[r, q] = e0 * v[0, q] + e1 * v[1, q] + e2 * v[2, q]
    for q in range(1, a.shape[2]):
        t[r, q - 1] += f0 * a[r, 0, q] + f1 * a[r, 1, q] + f2 * a[r, 2, q]


@njit(**NO_OVERLAP)
def term_of_five(a, w, n, power, g, r, v, t):
    """The same for five states: three masses."""
    e0, e1, e2, e3, e4 = a[r, 0, 0] * g, a[r, 1, 0] * g, a[r, 2, 0] * g, a[r, 3, 0] * g, a[r, 4, 0] * g
    g *= power
    f0, f1, f2, f3, f4 = w[n, 0] * g, w[n, 1] * g, w[n, 2] * g, w[n, 3] * g, w[n, 4] * g
    for q in range(v.shape[1]):
        t[r, q] = (e0 * v[0, q] + e1 * v[1, q]) + (e2 * v[2, q] + e3 * v[3, q]) + e4 * v[4, q]
    for q in range(1, a.shape[2]):
        t[r, q - 1] += (f0 * a[r, 0, q] + f1 * a[r, 1, q]) + (f2 * a[r, 2, q] + f3 * a[r, 3, q]) + f4 * a[r, 4, q]


@njit(**NO_OVERLAP)
def next_term(a, u, w, n, power, g, v, t):
    """t = term n + 1 of the power series of dS/dt = A S + dA z, from term n in v; power = h^n, g = h/(n + 1).

    w  power series of the state. Columns are innermost, so that the compiler vectorises them
    """
    nx, nq = v.shape[0], a.shape[2] - 1
    for r in range(nx):
        if nx == 3:
            term_of_three(a, w, n, power, g, r, v, t)
        elif nx == 5:
            term_of_five(a, w, n, power, g, r, v, t)
        else:
            term_of_any(a, w, n, power, g, r, v, t)
        if n == 0:
            for q in range(nq):
                t[r, q] += g * a[r, nx + u.size, q + 1]
            for j in range(u.size):
                e = u[j] * g
                for q in range(nq):
                    t[r, q] += e * a[r, nx + j, q + 1]


@njit(**INLINED)
def propagate_sensitivities(a, u, sens, w, v, t, te):
    """Sensitivities across a stretch without event, as a power series."""
    nx, ns = sens.shape
    for r in range(nx):
        for q in range(ns):
            v[r, q] = sens[r, q]
    power = 1.0
    for n in range(w.shape[0] - 1):
        next_term(a, u, w, n, power, te / (n + 1), v, t)
        for r in range(nx):
            for q in range(ns):
                sens[r, q] += t[r, q]
        v, t = t, v
        power *= te
