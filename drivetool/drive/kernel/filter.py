"""The extended Kalman filter: the pass over a record that gives observer gains and a likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable

from numba import njit

from drivetool.drive.arrays import NARROW_BLOCK, SIZED_STATE_COUNTS
from drivetool.drive.compile import CACHE, COMPILE, FILTERING, INLINED, LAWS, REAL, REALS, SYSTEM, WHOLE, as_unit
from drivetool.drive.kernel.event_free_steps import sized_covariance_step, sized_filter_loop, sized_step
from drivetool.drive.kernel.events import holding_margin, step_through_events
from drivetool.drive.kernel.exact_step import decay_state, decaying_state, mode_holds, predict
from drivetool.drive.kernel.laws import law_slope, set_holding_torque
from drivetool.drive.kernel.modes import lookup
from drivetool.drive.kernel.outputs import output_row
from drivetool.drive.kernel.run import (
    event_free_step,
    keep_sticking,
    law_step_or_events,
    reclassify_estimate,
    update_output_torques,
)
from drivetool.drive.kernel.simd_intrinsics import row_times, tuple_reader, write
from drivetool.drive.kernel.smooth import law_motion, law_transition
from drivetool.drive.kernel.smooth_events import step_through_law_events

# Margin of friction over the std of the torque, above which noise moves no resting body: once in 3e6 samples.
HOLDING_SIGMAS = 5.0


@njit(**COMPILE)
def substitute_law_slopes(laws, row):
    """Row of an output over the drive's state alone: torques of the laws are replaced by their linearisation."""
    if laws.in_output == 0:
        return
    for m in range(laws.code.size):
        at = laws.first + 3 * m
        if row[at] != 0.0:
            law_slope(laws.arguments, m, laws.torque_jets[0, m], laws.slopes[m], laws.first)
            for j in range(laws.first):
                row[j] += row[at] * laws.slopes[m, j]
            row[at] = 0.0


@njit(**INLINED)
def propagate_noise(phi, k, row, b):
    """Effect row (n,) of a torque held over the sample after a part of it, by the mode at its end; b scratch."""
    n, first = row.size, phi.shape[1]
    for j in range(n):
        b[j] = phi[k, j, first]
        for m in range(n):
            b[j] += phi[k, j, m] * row[m]
    for j in range(n):
        row[j] = b[j]


@njit(**INLINED)
def update_covariance(p, row, measured, r, gain):
    """Update of the covariance p (n, n); measured: a state, or -1 for row (n,); returns the innovation variance."""
    nx, var = p.shape[0], r
    if measured >= 0:
        for j in range(nx):
            gain[j] = p[j, measured]
        var += gain[measured]
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


@njit(**INLINED)
def matrix_product(a, b, n, out):
    """out = a b, of n rows and columns."""
    for j in range(n):
        for k in range(n):
            v = 0.0
            for m in range(n):
                v += a[j, m] * b[m, k]
            out[j, k] = v


@njit(**INLINED)
def advance_covariance(p, f, noise, q, extra, t):
    """p = f p f' + q noise noise' + diag(extra), through the scratch t."""
    nx = noise.size
    matrix_product(f, p, nx, t)
    for j in range(nx):
        for k in range(j + 1):
            v = q * noise[j] * noise[k]
            for m in range(nx):
                v += t[j, m] * f[k, m]
            p[j, k] = v
            p[k, j] = v
        p[j, j] += extra[j]


@njit(**COMPILE)
def tail_second_moment(a):
    """E[(z - a)^2; z > a] = (1 + a^2) Q(a) - a f(a) of a normal z, Q and f its tail and density."""
    tail, density = 0.5 * math.erfc(a / math.sqrt(2.0)), math.exp(-0.5 * a * a) / math.sqrt(2.0 * math.pi)
    return (1.0 + a * a) * tail - a * density


@njit(**COMPILE)
def add_sticking_uncertainty(s, c, k, mode, x, u, p, before, q, h):
    """Let noise move sticking bodies: covariance p of a sample of h seconds, at whose end bodies stick.

    Noise of std d beyond the margin m of friction: E[(d z - m)^2; d z > m] = d^2 tail_second_moment(m / d).
    A prior speed of variance v is braked as by the viscous friction m sqrt(2 / (pi v)) (Booton 1954).
    k  slot of the mode; u inputs of the sample; before (nf,) variances of the bodies' speeds before the sample
    """
    n = p.shape[0]
    for f in range(s.nf):
        if mode[s.ng + f] != 1:
            continue
        net, row = c.net_torque[k, f], s.slip_rows[f]
        variance = q * net[x.size] ** 2
        for j in range(n):
            for m in range(n):
                variance += net[j] * p[j, m] * net[m]
        d, pushed = math.sqrt(max(variance, 0.0)), 0.0
        margin, level = holding_margin(s, c.holding_torque, net, f, mode, x, u)
        if margin < HOLDING_SIGMAS * d:
            both = tail_second_moment(margin / d) + tail_second_moment((2.0 * level - margin) / d)
            pushed = variance * both * (h / s.mass[row, 0]) ** 2
        rest = 0.0
        if before[f] > 0.0:
            rest = math.exp(-margin * math.sqrt(2.0 / (math.pi * before[f])) * h / s.mass[row, 0])
        if pushed <= 0.0 and rest == 0.0:
            continue
        speed_distance = 0.5 * pushed + 0.5 * rest * (1.0 + rest) * before[f]
        distance_square = 0.25 * pushed + 0.25 * (1.0 + rest) ** 2 * before[f]
        for j in range(n):
            if j == row:
                p[row, row] += pushed + rest * rest * before[f]
                continue
            g = s.rows[j, row, 0] / s.mass[j, 0] * h
            if g == 0.0:
                continue
            p[j, row] += g * speed_distance
            p[row, j] = p[j, row]
            for m in range(n):
                if m != row:
                    p[j, m] += g * s.rows[m, row, 0] / s.mass[m, 0] * h * distance_square


@as_unit(REALS[2], REALS[2], REALS[1], REAL, REALS[1], REALS[2])
def covariance_step(p, f, noise, q, extra, t):
    """advance_covariance; a unit, as is premultiply, so that Laws can point to a sized version instead."""
    advance_covariance(p, f, noise, q, extra, t)


@as_unit(REALS[2], REALS[2], WHOLE, REALS[2])
def premultiply(f, transition, n, product):
    """transition = f transition, of n rows and columns, through a scratch."""
    matrix_product(f, transition, n, product)
    for j in range(n):
        for m in range(n):
            transition[j, m] = product[j, m]


@njit(**INLINED)
def step_with_transition(s, c, k, x, u, i, mode, transition, noise, b):
    """Carry x over a sample in the mode of slot k; False if an event may lie in it.

    transition, noise  are set: the transition, and the effect of a torque held over the sample on each state
    """
    predict(c.phi, k, x, u, i, b)
    if not mode_holds(c.guard_rows, c.guard_instants, s.reach, c.holding_torque, k, mode, x, b, u, i):
        return False
    n = noise.size
    for j in range(n):
        for m in range(n):
            transition[j, m] = c.phi[k, j, m]
        x[j] = b[j]
        noise[j] = c.phi[k, j, x.size]
    return True


@njit(**INLINED)
def law_step_with_transition(s, c, laws, k, x, u, late, i, clock, mode, transition, noise, b):
    """The same with smooth laws, part by part; k is -1 where it must be looked up. If False, x is unchanged."""
    n, parts, before, t, product = noise.size, s.part_lengths.size, c.vectors[2], c.columns[1], c.columns[2]
    if parts > 1:
        for j in range(x.size):
            before[j] = x[j]
    for part in range(parts):
        held = late if part < s.parts_before_switch else u
        if s.nf > 0:
            set_holding_torque(s, c, laws, clock)
        if k < 0 or parts > 1:
            k = lookup(s, c, mode, part)
        if not law_motion(laws.motion, s, c, laws, k, part, x, held, i, clock, mode, b, c.row_scratch[0]):
            if part > 0:
                for j in range(x.size):
                    x[j] = before[j]
            return False
        law_transition(laws.transition, c, laws, k, transition if part == 0 else t)
        for j in range(n):
            x[j] = b[j]
        if part == 0:
            for j in range(n):
                noise[j] = c.phi[k, j, x.size]
        else:
            premultiply(laws.premultiply, t, transition, n, product)
            propagate_noise(c.phi, k, noise, b)
        clock += s.part_lengths[part]
    return True


@njit(**INLINED)
def step_by_parts(s, c, laws, step, number, x, u, late, i, clock, mode, transition, noise, b, t):
    """The same if the torque switches, or an event occurs, inside the sample; returns the slot at its end."""
    n, parts = noise.size, s.part_lengths.size
    for j in range(n):
        for m in range(n):
            transition[j, m] = 1.0 if j == m else 0.0
        noise[j] = 0.0
    for part in range(parts):
        held = late if part < s.parts_before_switch else u
        if laws is None:
            number = lookup(s, c, mode, part)
            if parts == 1:
                free = False
            elif step is not None:
                free = step(s, c, number, x, held, i, transition, mode)
            else:
                free = event_free_step(c.phi, c.dphi, c.guard_rows, c.guard_instants, s.reach, c.holding_torque,
                                  number, x, held, i, transition, mode, b, t)
            if not free:
                step_through_events(c.event_step, s, c, x, held, i, transition, mode, part)
                number = lookup(s, c, mode, part)
        else:
            if parts == 1:
                step_through_law_events(laws.event_step, s, c, laws, x, held, i, clock, transition, mode, part)
                number = -1
            else:
                number, _ = law_step_or_events(s, c, laws, number, x, held, i, clock, transition, mode, part, b)
            number = lookup(s, c, mode, part) if number < 0 else number
            clock += s.part_lengths[part]
        propagate_noise(c.phi, number, noise, b)
    return number


@njit(**INLINED)
def correct_sample(laws, outputs, spring, reach, output_gap, output_state, mode, y, r, p, x, i, row, k, gain, var,
                   innov):
    """Measurement updates of sample i: state, covariance, gains and innovations."""
    for m in range(innov.shape[1]):
        measured = output_state[m]
        v = x[measured] if measured >= 0 else output_row(
            outputs, spring, reach, output_gap, output_state, mode, m, x, row)
        e = y[i, m] - v
        if laws is not None and measured < 0:
            substitute_law_slopes(laws, row)
        innov[i, m] = e
        var[i, m] = 1.0
        known = e == e
        if known:
            var[i, m] = update_covariance(p, row, measured, r[m], k)
        for j in range(p.shape[0]):
            if gain.shape[0] > 0:
                gain[i, m, j] = k[j] if known else 0.0
            if known:
                x[j] += k[j] * e


@njit(**COMPILE)
def filter_pass(s, c, laws, f, q, clock, event_free_loop, step, carry):
    """Extended Kalman filter: exact mode-wise transitions, sensitivities across events.

    f      a Filtering; the system has no free parameters, and ns = nx columns; laws: or None
    q      torque noise variance, entering with the first input
    clock  time of the first sample [s]
    event_free_loop, step, carry  sized versions of event_free_steps.py, for one input; None for any size
    """
    nx = s.plain
    u, late, y, r, extra, noise_input, p, x, mode = (
        f.u, f.late, f.y, f.r, f.added_variance, f.noise_input, f.p, f.x, f.mode)
    gain, var, innov, states = f.gain, f.var, f.innov, f.states
    guards, spring, output_state = c.guards, s.spring, s.output_state
    reach, outputs, output_gap, memory = s.reach, s.outputs, s.output_gap, s.memory
    n, whole, decaying, number, length = (
        mode.size, s.part_lengths.size == 1, decaying_state(memory), -1, s.part_lengths.sum())
    row, b, k, noise = c.vectors[0], c.vectors[1], c.vectors[2], c.vectors[4][:nx]
    transition, t = c.transition, c.columns[0]
    reclassify_estimate(s, x, mode, p, guards)
    i = 0
    while i < u.shape[0]:
        if event_free_loop is not None and whole:
            number = lookup(s, c, mode, 0) if number < 0 else number
            i = event_free_loop(s, c, f, number, q, i)
            if i == u.shape[0]:
                break
        if laws is not None:
            update_output_torques(s, laws, x, clock, mode, transition)
        correct_sample(laws, outputs, spring, reach, output_gap, output_state, mode, y, r, p, x, i, row, k, gain,
                       var, innov)
        if s.nf > 0:
            keep_sticking(s, c, number, mode, x, u[i], length, transition)
        if n > 0 and reclassify_estimate(s, x, mode, p, guards):
            number = -1
        if states.shape[0] > 0:
            for j in range(nx):
                states[i, j] = x[j]
        if whole:
            number = lookup(s, c, mode, 0) if number < 0 else number
        if laws is not None:
            free = law_step_with_transition(s, c, laws, number, x, u, late, i, clock, mode, transition, noise, b)
        else:
            free = whole and step_with_transition(s, c, number, x, u, i, mode, transition, noise, b)
        if not free:
            number = step_by_parts(s, c, laws, step, number, x, u, late, i, clock, mode, transition, noise, b, t)
        clock += length
        for j in range(nx):
            noise[j] += noise_input[j]
        decay_state(memory, decaying, x, transition)
        for m in range(s.nf):
            k[m] = p[s.slip_rows[m], s.slip_rows[m]]
        if laws is not None:
            covariance_step(laws.covariance_step, p, transition, noise, q, extra, t)
        elif carry is not None:
            carry(p, transition, noise, q, extra)
        else:
            advance_covariance(p, transition, noise, q, extra, t)
        if s.nf > 0:
            add_sticking_uncertainty(s, c, number, mode, x, u[i], p, k, q, length)
        i += 1


def covariance_step_for(n: int) -> Callable:
    """The unit `covariance_step` for n states."""
    carry = sized_covariance_step(n)

    @as_unit(REALS[2], REALS[2], REALS[1], REAL, REALS[1], REALS[2])
    def covariance_step(p, f, noise, q, extra, t):
        carry(p, f, noise, q, extra)

    return covariance_step


def premultiply_for(n: int) -> Callable:
    """The unit `premultiply` for n states."""
    columns = tuple_reader(n, NARROW_BLOCK)

    @as_unit(REALS[2], REALS[2], WHOLE, REALS[2])
    def premultiply(f, transition, _, product):
        width = transition.shape[1]
        for q in range(0, n, NARROW_BLOCK):
            block = columns(transition, q, width)
            for r in range(n):
                write(transition, q + r * width, row_times(f, r * f.shape[1], block))

    return premultiply


covariance_step_3, covariance_step_4, covariance_step_5, covariance_step_6, covariance_step_7 = (
    covariance_step_for(n) for n in SIZED_STATE_COUNTS)
premultiply_3, premultiply_4, premultiply_5, premultiply_6, premultiply_7 = map(premultiply_for, SIZED_STATE_COUNTS)


@as_unit(SYSTEM, CACHE, FILTERING, REAL, REAL)
def kalman(s, c, f, q, clock):
    """Filter a record; see filter_pass."""
    filter_pass(s, c, None, f, q, clock, None, None, None)


def sized_kalman(n: int) -> Callable:
    """The unit `kalman` for n states and one input: unrolled loops are much faster."""
    event_free_loop, step, carry = sized_filter_loop(n), sized_step(n), sized_covariance_step(n)

    @as_unit(SYSTEM, CACHE, FILTERING, REAL, REAL)
    def kalman(s, c, f, q, clock):
        filter_pass(s, c, None, f, q, clock, event_free_loop, step, carry)

    return kalman


kalman_3, kalman_4, kalman_5, kalman_6, kalman_7 = (sized_kalman(n) for n in SIZED_STATE_COUNTS)


@as_unit(SYSTEM, CACHE, LAWS, FILTERING, REAL, REAL)
def kalman_laws(s, c, laws, f, q, clock):
    """The same with smooth laws."""
    filter_pass(s, c, laws, f, q, clock, None, None, None)
