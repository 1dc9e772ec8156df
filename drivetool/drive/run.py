"""The two passes over a record: simulation with sensitivities, and the Kalman filter."""

from __future__ import annotations

from numba import njit

from drivetool.drive.compiled import COMPILE, HOT
from drivetool.drive.events import rough_step, switch_late
from drivetool.drive.kernel import classify, forget, guard_values, predict, propagate, stays
from drivetool.drive.modes import lookup


@njit(**HOT)
def output_row(outputs, spring, reach, output_gap, picks, mode, m, x, row):
    """Output m at x; row (nx,) gets its derivative over the state."""
    v = 0.0
    for j in range(x.size):
        row[j] = outputs[m, j, 0]
    if picks[m] >= 0:
        return x[picks[m]]
    gap = output_gap[m]
    if gap >= 0 and mode[gap] != 1:
        for j in range(x.size):
            row[j] += spring[gap, j, 0]
        v -= (1.0 - mode[gap]) * reach[gap, 0]
    for j in range(x.size):
        v += row[j] * x[j]
    return v


@njit(**HOT)
def output_gradient(outputs, spring, reach, output_gap, picks, mode, m, x, row, big, col):
    """Derivative of output m over the ns columns."""
    if picks[m] >= 0:
        for q in range(col.size):
            col[q] = big[picks[m], q]
        return
    for q in range(col.size):
        v = 0.0
        for j in range(x.size):
            v += row[j] * big[j, q]
        col[q] = v
    gap = output_gap[m]
    for q in range(outputs.shape[2] - 1):
        v = 0.0
        for j in range(x.size):
            v += outputs[m, j, q + 1] * x[j]
        if gap >= 0 and mode[gap] != 1:
            for j in range(x.size):
                v += spring[gap, j, q + 1] * x[j]
            v -= (1.0 - mode[gap]) * reach[gap, q + 1]
        col[q] += v


@njit(**HOT)
def use_measurement(gain, i, m, e, x, big, col, sens):
    """Correct the state by gain times the innovation e, and its sensitivities."""
    for j in range(x.size):
        k = gain[i, m, j]
        x[j] += k * e
        if sens:
            for q in range(col.size):
                big[j, q] -= k * col[q]


@njit(**HOT)
def write_row(jac, i, m, col, g, e):
    """Row of the weighted Jacobian, the weighted residual in its last column."""
    last = col.size - 1
    for q in range(last):
        jac[i, m, q] = g * col[q]
    jac[i, m, last] = -g * e


@njit(**HOT)
def reclassify(spring, slip_rows, reach, x, mode, old):
    """Set the mode from the state, after a jump; returns whether it changed."""
    guard_values(spring, slip_rows, x, old)
    return classify(reach, old, mode)


@njit(**COMPILE)
def varies(delay):
    """Whether the dead time depends on a free parameter."""
    found = False
    for d in delay:
        found = found or d != 0.0
    return found


@njit(**COMPILE)
def slots(s, c, mode):
    """Where the mode lies for the first and the last part of a sample."""
    part = s.spans.size - 1
    last = lookup(s, c, mode, part)
    if part == 0:
        return last, last
    first = lookup(s, c, mode, part - 1)
    return first, lookup(s, c, mode, part)  # once more: working out the first may have emptied the cache


@njit(**HOT)
def smooth_step(leap, dleap, net, watch, looks, spring, slip_rows, reach, level, k, x, u, i, big, mode,
                b, t, new, old):
    """Carry x and big over a part of a sample; False, and nothing moved, if an event may lie in it."""
    predict(leap, k, x, u, i, b)
    if mode.size > 0:
        guard_values(spring, slip_rows, b, new)
        if not stays(reach, level, net, watch, looks, k, mode, x, b, u, i, old, new):
            return False
    if big.shape[1] > 0:
        propagate(leap, dleap, k, x, u, i, big, t)
    for r in range(x.size):
        x[r] = b[r]
    return True


@njit(**COMPILE)
def run(s, c, u, late, y, gain, weight, x, big, mode, fresh, out, jac, states):
    """Simulate n samples; everything may be continued in the next call.

    u, late  (n, nu)         inputs, and those before the dead time switches inside the sample
    y        (n, ny)         measured outputs, NaN where there is none
    gain     (n, ny, nx)     observer gains, or (0, ny, nx) for a free run
    weight   (n, ny)         1/std of the innovations relative to the sensor's, or (0, ny)
    x, big   (nx,), (nx, ns) state and sensitivities, carried on
    mode     (elements,)     carried on; worked out first if `fresh`
    out      (n, ny)         predicted outputs
    jac      (n, ny, ns)     weighted sensitivities, the weighted residual out - y in the last
                             column; or (0, ny, ns)
    states   (n, nx)         state before the sample's measurement is used, or (0, nx)
    returns  samples in which events were located
    """
    leap, dleap, net, watch, looks = c.leap, c.dleap, c.net, c.watch, c.looks
    spring, slip_rows, picks = s.spring, s.slip_rows, s.picks
    reach, level, outputs, output_gap, memory = s.reach, s.level, s.outputs, s.output_gap, s.memory
    n, parts = mode.size, s.spans.size
    row, b, col, t = c.vectors[0], c.vectors[1], c.gradient, c.columns[0]
    new, old = c.guards[0], c.guards[1]
    guard_values(spring, slip_rows, x, old)
    if fresh:
        classify(reach, old, mode)
    observed, sens, located, first, last = gain.shape[0] > 0, jac.shape[0] > 0, 0, -1, -1
    moves = parts > 1 and varies(s.delay)
    for i in range(u.shape[0]):
        if states.shape[0] > 0:
            for j in range(x.size):
                states[i, j] = x[j]
        for m in range(out.shape[1]):
            v = output_row(outputs, spring, reach, output_gap, picks, mode, m, x, row)
            out[i, m] = v
            known = y[i, m] == y[i, m]
            e = y[i, m] - v if known else 0.0
            if sens:
                output_gradient(outputs, spring, reach, output_gap, picks, mode, m, x, row, big, col)
                g = weight[i, m] if weight.shape[0] > 0 else 1.0
                write_row(jac, i, m, col, g if known else 0.0, e)
            if observed and known:
                use_measurement(gain, i, m, e, x, big, col, sens)
        if observed and n > 0 and reclassify(spring, slip_rows, reach, x, mode, old):
            first = -1
        for part in range(parts):
            held = late if part + 1 < parts else u
            if first < 0:
                first, last = slots(s, c, mode)
            k = first if part == 0 else last
            if not smooth_step(leap, dleap, net, watch, looks, spring, slip_rows, reach, level, k, x,
                               held, i, big, mode, b, t, new, old):
                rough_step(s, c, x, held, i, big, mode, part, new)
                located += 1
                first = -1
            for e in range(n):
                old[e] = new[e]
            if moves and part == 0 and switch_late(s, c, x, u[i], late[i], big, mode, first):
                first = -1
        forget(memory, x, big)
    return located


@njit(**HOT)
def add_noise(leap, k, row, b):
    """Carry the effect of a torque held over the sample through a part of it, by the mode at its end.

    Noise thus does not move a body that sticks. b (nx,) is scratch.
    """
    nx = row.size
    for j in range(nx):
        b[j] = leap[k, j, nx]
        for m in range(nx):
            b[j] += leap[k, j, m] * row[m]
    for j in range(nx):
        row[j] = b[j]


@njit(**HOT)
def update(p, row, r, gain):
    """Measurement update of the covariance p; returns the variance of the innovation."""
    nx = row.size
    var = r
    for j in range(nx):
        v = 0.0
        for k in range(nx):
            v += p[j, k] * row[k]
        gain[j] = v
        var += row[j] * v
    for j in range(nx):
        for k in range(j + 1):
            p[j, k] -= gain[j] * gain[k] / var
            p[k, j] = p[j, k]
    for j in range(nx):
        gain[j] /= var
    return var


@njit(**HOT)
def advance_covariance(p, f, noise, q, extra, t):
    """p = f p f' + q noise noise' + diag(extra), through the scratch t."""
    nx = noise.size
    for j in range(nx):
        for k in range(nx):
            v = 0.0
            for m in range(nx):
                v += f[j, m] * p[m, k]
            t[j, k] = v
    for j in range(nx):
        for k in range(j + 1):
            v = q * noise[j] * noise[k]
            for m in range(nx):
                v += t[j, m] * f[k, m]
            p[j, k] = v
            p[k, j] = v
        p[j, j] += extra[j]


@njit(**COMPILE)
def kalman(s, c, u, late, y, r, q, extra, p, x, mode, gain, var, innov, states):
    """Extended Kalman filter: exact mode-wise transitions, sensitivities across events.

    s must have no free parameters, and ns = nx columns.
    r        (ny,)        sensor variances relative to that of the first output
    q        torque noise variance, entering with the first input; extra (nx,) on the states
    p        (nx, nx)     covariance of the start state, changed
    gain     (n, ny, nx)  or (0, ny, nx); var (n, ny); innov (n, ny), NaN where unmeasured
    states   (n, nx)      filtered states, or (0, nx)
    """
    nx = s.nx
    leap, dleap, net, watch, looks = c.leap, c.dleap, c.net, c.watch, c.looks
    spring, slip_rows, picks = s.spring, s.slip_rows, s.picks
    reach, level, outputs, output_gap, memory = s.reach, s.level, s.outputs, s.output_gap, s.memory
    n, parts, number = mode.size, s.spans.size, -1
    row, b, k = c.vectors[0], c.vectors[1], c.vectors[2]
    f, t, new, old = c.transition, c.columns[0], c.guards[0], c.guards[1]
    reclassify(spring, slip_rows, reach, x, mode, old)
    for i in range(u.shape[0]):
        for m in range(innov.shape[1]):
            e = y[i, m] - output_row(outputs, spring, reach, output_gap, picks, mode, m, x, row)
            innov[i, m] = e
            var[i, m] = 1.0
            known = e == e
            if known:
                var[i, m] = update(p, row, r[m], k)
            for j in range(nx):
                if gain.shape[0] > 0:
                    gain[i, m, j] = k[j] if known else 0.0
                if known:
                    x[j] += k[j] * e
        if n > 0 and reclassify(spring, slip_rows, reach, x, mode, old):
            number = -1
        for j in range(nx):
            for m in range(nx):
                f[j, m] = 1.0 if j == m else 0.0
            if states.shape[0] > 0:
                states[i, j] = x[j]
            row[j] = 0.0
        for part in range(parts):
            held = late if part + 1 < parts else u
            if number < 0 or parts > 1:
                number = lookup(s, c, mode, part)
            if not smooth_step(leap, dleap, net, watch, looks, spring, slip_rows, reach, level, number,
                               x, held, i, f, mode, b, t, new, old):
                rough_step(s, c, x, held, i, f, mode, part, new)
                number = lookup(s, c, mode, part)
            for e in range(n):
                old[e] = new[e]
            add_noise(leap, number, row, b)
        forget(memory, x, f)
        advance_covariance(p, f, row, q, extra, t)
