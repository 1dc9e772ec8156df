"""Loops over samples without events: the state stays in registers from sample to sample.

A sample is processed as in run.py and filter.py. A loop ends before a sample in which an event may occur; run.py or
filter.py then processes that sample from its start.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import njit

from drivetool.drive.arrays import NARROW_BLOCK, WIDE_BLOCK
from drivetool.drive.compile import INLINED, NO_OVERLAP
from drivetool.drive.kernel.exact_step import decaying_state
from drivetool.drive.kernel.outputs import output_gradient, output_row
from drivetool.drive.kernel.simd_intrinsics import (
    corrected,
    covariance_column,
    covariance_times_row,
    elementwise_product,
    lower_half,
    measurement_updated,
    next_state,
    row_times,
    row_times_state,
    row_times_with_sources,
    scaled,
    time_updated,
    tuple_reader,
    write,
    write_symmetric,
)


@njit(**NO_OVERLAP)
def correct_columns(b, k, col):
    """Sensitivities of a state after the correction by the gain k: b (ns,) -= k col."""
    for q in range(b.size):
        b[q] -= k * col[q]


@njit(**NO_OVERLAP)
def weighted_row(col, g, e, copy, row):
    """Copy the columns col (ns,) of an output, and write its row of the Jacobian, weighted residual last."""
    last = col.size - 1
    for q in range(last):
        copy[q] = col[q]
        row[q] = g * col[q]
    copy[last], row[last] = 0.0, -g * e


@njit(**NO_OVERLAP)
def write_row(jac, i, m, col, g, e):
    """Row of the weighted Jacobian, the weighted residual in its last column."""
    last = col.size - 1
    for q in range(last):
        jac[i, m, q] = g * col[q]
    jac[i, m, last] = -g * e


@njit(**INLINED)
def output_of(s, mode, m, z, x, row):
    """Output m at the state z; if it is no single state, x is set to z and row to the derivative over x."""
    measured = s.output_state[m]
    if measured >= 0:
        return z[measured]
    write(x, 0, z)
    return output_row(s.outputs, s.spring, s.reach, s.output_gap, s.output_state, mode, m, x, row)


@njit(**INLINED)
def mode_holds_sized(rows, guard_instants, mode, reach, level, z, b, torque, observed):
    """Whether the mode holds from z to b, see exact_step.mode_holds; observed: z has been corrected."""
    gaps, smooth, width = reach.shape[0], True, rows.shape[2]
    for element in range(mode.size):
        digit, row = mode[element], rows[element]
        first, last = row_times_state(row, 0, z, torque), row_times_state(row, 0, b, torque)
        low, high, second_difference = min(first, last), max(first, last), 0.0
        before, now = first, first
        for m in range(1, guard_instants + 1):
            v = row_times_state(row, m * width, z, torque)
            low, high = min(low, v), max(high, v)
            second_difference = max(second_difference, abs(v - 2.0 * now + before) if m > 1 else 0.0)
            before, now = now, v
        second_difference = max(second_difference, abs(last - 2.0 * now + before))
        bound = reach[element, 0] if element < gaps else level[element - gaps, 0] if digit == 1 else 0.0
        margin = bound - max(high, -low) if digit == 1 else (low if digit == 0 else -high) - bound
        # A correction may move a body that sticks.
        smooth = smooth and margin >= 0.25 * second_difference and not (observed and digit == 1 and element >= gaps)
    return smooth


def sized_propagate(n: int) -> Callable:
    """propagate(e, d, x, u, sens): sensitivities of n states a sample later, in place; d as Cache.dphi_blocks."""
    wide, narrow, width = tuple_reader(n, WIDE_BLOCK), tuple_reader(n, NARROW_BLOCK), n + 2

    @njit(**INLINED)
    def propagate(e, d, x, u, sens):
        ns = sens.shape[1]
        for c in range(d.shape[0]):
            q, block = WIDE_BLOCK * c, d[c]
            v = wide(sens, q, ns)
            for r in range(n):
                write(sens, q + r * ns, row_times_with_sources(e, r * width, v, block, x, u))
        for q in range(WIDE_BLOCK * d.shape[0], ns, NARROW_BLOCK):
            w = narrow(sens, q, ns)
            for r in range(n):
                write(sens, q + r * ns, row_times(e, r * width, w))

    return propagate


def sized_step(n: int) -> Callable:
    """step(s, c, k, x, u, i, sens, mode): run.event_free_step for n states and one input."""
    state, propagate = tuple_reader(n), sized_propagate(n)

    @njit(**INLINED)
    def step(s, c, k, x, u, i, sens, mode):
        z, torque = state(x, 0, 1), u[i, 0]
        b = next_state(c.phi[k], z, torque)
        if not mode_holds_sized(c.guard_rows[k], c.guard_instants[k], mode, s.reach, c.holding_torque, z, b, torque,
                                False):
            return False
        if sens.shape[1] > 0:
            propagate(c.phi[k], c.dphi_blocks[k], z, torque, sens)
        write(x, 0, b)
        return True

    return step


def sized_covariance_step(n: int) -> Callable:
    """carry(p, f, noise, q, extra): filter.advance_covariance for n states."""
    state = tuple_reader(n)

    @njit(**INLINED)
    def carry(p, f, noise, q, extra):
        noise_input = state(noise, 0, 1)
        write_symmetric(p, time_updated(lower_half(p, noise_input), f, noise_input, q, extra), noise_input)

    return carry


def sized_run_loop(n: int) -> Callable:
    """loop(s, c, p, k, i): samples from i on in the mode of slot k; returns the first that was not processed.

    s, c, p  system, cache and pass, of n states and one input that does not switch inside a sample
    """
    state, propagate = tuple_reader(n), sized_propagate(n)

    @njit(**INLINED)
    def loop(s, c, p, k, i):
        e, d, rows, guard_instants, mode, x = (
            c.phi[k], c.dphi_blocks[k], c.guard_rows[k], c.guard_instants[k], p.mode, state(p.x, 0, 1))
        reach, level, output_state, memory, decaying = (
            s.reach, c.holding_torque, s.output_state, s.memory, decaying_state(s.memory))
        u, y, gain, weight, sens, out, jac, states = p.u, p.y, p.gain, p.weight, p.sens, p.out, p.jac, p.states
        count, weighed, observed, row, col = len(u), len(weight) > 0, len(gain) > 0, c.vectors[0], c.gradient
        while i < count:
            z = x
            for m in range(out.shape[1]):
                out[i, m] = output_of(s, mode, m, z, p.x, row)
                if observed and y[i, m] == y[i, m]:
                    z = corrected(z, gain[i, m], y[i, m] - out[i, m])
            torque = u[i, 0]
            b = next_state(e, z, torque)
            if not mode_holds_sized(rows, guard_instants, mode, reach, level, z, b, torque, observed):
                break
            if states.shape[0] > 0:
                write(states[i], 0, x)
            z = x
            for m in range(out.shape[1] if jac.shape[0] > 0 else 0):
                known = y[i, m] == y[i, m]
                g = (weight[i, m] if weighed else 1.0) if known else 0.0
                e_m = y[i, m] - out[i, m] if known else 0.0
                if output_state[m] >= 0:
                    weighted_row(sens[output_state[m]], g, e_m, col, jac[i, m])
                else:
                    output_of(s, mode, m, z, p.x, row)
                    output_gradient(s.outputs, s.spring, reach, s.output_gap, output_state, mode, m, p.x, row, sens,
                                    col)
                    write_row(jac, i, m, col, g, e_m)
                if observed and known:
                    z = corrected(z, gain[i, m], e_m)
                    for r in range(n):
                        correct_columns(sens[r], gain[i, m, r], col)
            if sens.shape[1] > 0:
                propagate(e, d, z, torque, sens)
            x = b
            if decaying >= 0:
                x = elementwise_product(x, memory)
                for q in range(sens.shape[1]):
                    sens[decaying, q] *= memory[decaying]
            i += 1
        write(p.x, 0, x)
        return i

    return loop


def sized_filter_loop(n: int) -> Callable:
    """loop(s, c, f, k, q, i): samples of a Kalman pass from i on in slot k; returns the first not processed.

    s, c, f  system, cache and filtering, of n states and one input that does not switch inside a sample
    """
    state = tuple_reader(n)

    @njit(**INLINED)
    def loop(s, c, f, k, q, i):
        e, rows, guard_instants, mode, x = c.phi[k], c.guard_rows[k], c.guard_instants[k], f.mode, state(f.x, 0, 1)
        for d in range(s.ng, s.ng + s.nf):
            if mode[d] == 1:  # noise may end the sticking
                return i
        p, noise_input = lower_half(f.p, x), state(f.noise_input, 0, 1)
        u, y, variance, extra, gain, var, innov, states = (
            f.u, f.y, f.r, f.added_variance, f.gain, f.var, f.innov, f.states)
        noise = corrected(state(e, n, n + 2), noise_input, 1.0)
        reach, level, output_state, memory, decaying = (
            s.reach, c.holding_torque, s.output_state, s.memory, decaying_state(s.memory))
        row, transition = c.vectors[0], c.transition
        for r in range(n):
            for j in range(n):
                transition[r, j] = memory[r] * e[r, j]
        while i < u.shape[0]:
            z, w = x, p
            for m in range(innov.shape[1]):
                measured = output_state[m]
                innov[i, m], var[i, m] = y[i, m] - output_of(s, mode, m, z, f.x, row), 1.0
                if y[i, m] == y[i, m]:
                    v = covariance_column(w, x, measured) if measured >= 0 else covariance_times_row(w, row, x)
                    var[i, m] = variance[m] + (v[measured] if measured >= 0 else row_times(row, 0, v))
                    g = scaled(v, 1.0 / var[i, m])
                    w, z = measurement_updated(w, v, g), corrected(z, g, innov[i, m])
                    if gain.shape[0] > 0:
                        write(gain[i, m], 0, g)
                elif gain.shape[0] > 0:
                    gain[i, m, :] = 0.0
            torque = u[i, 0]
            b = next_state(e, z, torque)
            if not mode_holds_sized(rows, guard_instants, mode, reach, level, z, b, torque, True):
                break
            if states.shape[0] > 0:
                write(states[i], 0, z)
            x, p = (elementwise_product(b, memory) if decaying >= 0 else b,
                    time_updated(w, transition, noise, q, extra))
            i += 1
        write(f.x, 0, x)
        write_symmetric(f.p, p, x)
        return i

    return loop
