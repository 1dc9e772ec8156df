"""The pass over a record that simulates it, with sensitivities and with or without an observer."""

from __future__ import annotations

import math
from collections.abc import Callable

from numba import njit

from drivetool.drive.arrays import SIZED_STATE_COUNTS
from drivetool.drive.compile import (
    CACHE,
    COMPILE,
    INLINED,
    LAWS,
    NO_OVERLAP,
    PASS,
    REAL,
    SYSTEM,
    WHOLE,
    as_unit,
)
from drivetool.drive.kernel.event_free_steps import sized_run_loop, sized_step, write_row
from drivetool.drive.kernel.events import (
    accelerating_torque,
    follow_contacts,
    net_load,
    step_through_events,
    switch_late,
    transmitted_torque,
)
from drivetool.drive.kernel.exact_step import (
    classify,
    decay_state,
    decaying_state,
    guard_values,
    mode_holds,
    predict,
    propagate,
)
from drivetool.drive.kernel.laws import set_holding_torque
from drivetool.drive.kernel.modes import lookup
from drivetool.drive.kernel.outputs import output_gradient, output_row
from drivetool.drive.kernel.smooth import law_step
from drivetool.drive.kernel.smooth_events import step_through_law_events, write_law_torques

# A corrected speed that friction stops within this fraction of a sample is no motion: at the same deceleration the
# travel is a hundredth of that of a body that needs the whole sample to stop.
RESTICK_FRACTION = 0.1


@njit(**NO_OVERLAP)
def use_measurement(gain, i, m, e, x, sens, col, with_sens):
    """Correct the state by gain times the innovation e, and its sensitivities."""
    for j in range(x.size):
        k = gain[i, m, j]
        x[j] += k * e
        if with_sens:
            for q in range(col.size):
                sens[j, q] -= k * col[q]


@njit(**INLINED)
def reclassify(s, x, mode, sens, old):
    """Set the mode from the state, after a jump; returns whether it changed."""
    guard_values(s, mode, x, old)
    changed = classify(s.reach, old, mode)
    follow_contacts(s, mode, x, sens)
    return changed


@njit(**INLINED)
def reclassify_estimate(s, x, mode, p, old):
    """The same of an estimate with a covariance p (n, n): in contact an elastic twist varies with the twist."""
    changed = reclassify(s, x, mode, p, old)
    for g in range(s.ng):
        e, twist = s.relaxing[g, 0], s.relaxing[g, 1]
        if e >= 0 and mode[g] != 1:
            for j in range(p.shape[0]):
                p[j, e] = p[j, twist]
    return changed


@njit(**COMPILE)
def keep_sticking(s, c, k, mode, x, u, h, sens):
    """Let a body keep sticking if friction stops its corrected speed within RESTICK_FRACTION of a sample.

    k  slot of the mode before the correction, or -1; u inputs of the sample of h seconds; sens sensitivities
    """
    for f in range(s.nf):
        row = s.slip_rows[f]
        if mode[s.ng + f] == 1 and x[row] != 0.0:
            k = lookup(s, c, mode, 0) if k < 0 else k
            way, through = math.copysign(1.0, x[row]), transmitted_torque(s, f, mode, x, u)
            margin = -way * accelerating_torque(s, f, net_load(c.net_torque[k, f], x, u), through, way,
                                                c.holding_torque[f, 0])
            if abs(x[row]) * s.mass[row, 0] < RESTICK_FRACTION * h * margin:
                stopping_distance = 0.5 * x[row] * abs(x[row]) * s.mass[row, 0] / margin  # until it stands
                for j in range(x.size):
                    if j != row:
                        x[j] += s.rows[j, row, 0] / s.mass[j, 0] * stopping_distance
                x[row] = 0.0
                for q in range(sens.shape[1]):
                    sens[row, q] = 0.0


@njit(**INLINED)
def law_step_or_events(s, c, laws, k, x, held, i, clock, sens, mode, part, b):
    """Carry x and sens over a part of a sample; (slot of the mode, whether it was free of events).

    k  slot of the mode, or -1 if it has to be looked up
    """
    if s.nf > 0:
        set_holding_torque(s, c, laws, clock)
    if k < 0 or s.part_lengths.size > 1:
        k = lookup(s, c, mode, part)
    if law_step(s, c, laws, k, part, x, held, i, clock, sens, mode, b, c.row_scratch[0]):
        return k, True
    step_through_law_events(laws.event_step, s, c, laws, x, held, i, clock, sens, mode, part)
    return -1, False


@njit(**INLINED)
def observe(outputs, spring, reach, output_gap, output_state, mode, y, gain, weight, i, x, sens, row, col, out,
            jac):
    """The outputs of sample i, their weighted sensitivities, and the correction by the observer."""
    for m in range(out.shape[1]):
        measured = output_state[m]
        v = x[measured] if measured >= 0 else output_row(
            outputs, spring, reach, output_gap, output_state, mode, m, x, row)
        out[i, m] = v
        known = y[i, m] == y[i, m]
        e = y[i, m] - v if known else 0.0
        if jac.shape[0] > 0:
            output_gradient(outputs, spring, reach, output_gap, output_state, mode, m, x, row, sens, col)
            g = weight[i, m] if weight.shape[0] > 0 else 1.0
            write_row(jac, i, m, col, g if known else 0.0, e)
        if gain.shape[0] > 0 and known:
            use_measurement(gain, i, m, e, x, sens, col, jac.shape[0] > 0)


@njit(**COMPILE)
def first_and_last_slot(s, c, mode):
    """Slots of the mode for the first and the last part of a sample."""
    part = s.part_lengths.size - 1
    last = lookup(s, c, mode, part)
    if part == 0:
        return last, last
    first = lookup(s, c, mode, part - 1)
    return first, lookup(s, c, mode, part)  # once more: working out the first may have emptied the cache


@njit(**INLINED)
def event_free_step(phi, dphi, guard_rows, guard_instants, reach, level, k, x, u, i, sens, mode, b, t):
    """Carry x and sens over a part of a sample; False, and both unchanged, if an event may occur in it."""
    predict(phi, k, x, u, i, b)
    if not mode_holds(guard_rows, guard_instants, reach, level, k, mode, x, b, u, i):
        return False
    if sens.shape[1] > 0:
        propagate(phi, dphi, k, x, u, i, sens, t)
    for r in range(x.size):
        x[r] = b[r]
    return True


@njit(**COMPILE)
def simulate_pass(s, c, laws, p, clock, event_free_loop, step):
    """Simulate the samples of a pass p; laws None where there are none, clock the time of the first [s].

    event_free_loop, step  sized versions of event_free_steps.py, for one input; None for any size
    returns  samples in which events were located
    """
    phi, dphi, guard_rows, guard_instants, guards = c.phi, c.dphi, c.guard_rows, c.guard_instants, c.guards
    spring, output_state = s.spring, s.output_state
    reach, level, outputs, output_gap, memory = s.reach, c.holding_torque, s.outputs, s.output_gap, s.memory
    u, late, y, gain, weight, x, sens, mode = p.u, p.late, p.y, p.gain, p.weight, p.x, p.sens, p.mode
    out, jac, states = p.out, p.jac, p.states
    n, parts, early = mode.size, s.part_lengths.size, s.parts_before_switch
    row, b, col, t = c.vectors[0], c.vectors[1], c.gradient, c.columns[0]
    if p.fresh != 0:
        reclassify(s, x, mode, sens, guards)
    observed, decaying, located, first, last = gain.shape[0] > 0, decaying_state(memory), 0, -1, -1
    may_loop, i, length = parts == 1 and c.dead_time_switch == 0, 0, s.part_lengths.sum()
    while i < u.shape[0]:
        if event_free_loop is not None and may_loop:
            first = first_and_last_slot(s, c, mode)[0] if first < 0 else first
            i = event_free_loop(s, c, p, first, i)
            if i == u.shape[0]:
                break
        if states.shape[0] > 0:
            for j in range(x.size):
                states[i, j] = x[j]
        if laws is not None:
            update_output_torques(s, laws, x, clock, mode, sens)
        observe(outputs, spring, reach, output_gap, output_state, mode, y, gain, weight, i, x, sens, row, col, out,
                jac)
        if observed and s.nf > 0:
            keep_sticking(s, c, first, mode, x, u[i], length, sens)
        if observed and n > 0 and reclassify(s, x, mode, sens, guards):
            first = -1
        for part in range(parts):
            held = late if part < early else u
            if laws is not None:
                first, free = law_step_or_events(s, c, laws, first, x, held, i, clock, sens, mode, part, b)
                located += not free
                clock += s.part_lengths[part]
            else:
                if first < 0:
                    first, last = first_and_last_slot(s, c, mode)
                k = first if part == 0 else last
                if step is not None:
                    free = step(s, c, k, x, held, i, sens, mode)
                else:
                    free = event_free_step(phi, dphi, guard_rows, guard_instants, reach, level, k, x, held, i, sens,
                                      mode, b, t)
                if not free:
                    step_through_events(c.event_step, s, c, x, held, i, sens, mode, part)
                    located += 1
                    first = -1
            if c.dead_time_switch != 0 and part + 1 == early:
                switch_late(c.dead_time_switch, s, c, x, u[i], late[i], sens, mode, first)
                first = -1
        decay_state(memory, decaying, x, sens)
        i += 1
    return located


@njit(**INLINED)
def update_output_torques(s, laws, x, clock, mode, sens):
    """Write the torques of the laws into the state, if an output reads them."""
    if laws.in_output != 0:
        write_law_torques(laws.write_law_torques, s, laws, x, clock, mode, sens)


@as_unit(SYSTEM, CACHE, PASS, REAL, gives=WHOLE)
def run(s, c, p, clock):
    """Simulate the samples of a pass; see simulate_pass."""
    return simulate_pass(s, c, None, p, clock, None, None)


def sized_run(n: int) -> Callable:
    """The unit `run` for n states and one input: unrolled loops are much faster."""
    event_free_loop, step = sized_run_loop(n), sized_step(n)

    @as_unit(SYSTEM, CACHE, PASS, REAL, gives=WHOLE)
    def run(s, c, p, clock):
        return simulate_pass(s, c, None, p, clock, event_free_loop, step)

    return run


# Two masses, two with an angle, three, three with an angle, and that with a correlated torque disturbance.
run_3, run_4, run_5, run_6, run_7 = (sized_run(n) for n in SIZED_STATE_COUNTS)


@as_unit(SYSTEM, CACHE, LAWS, PASS, REAL, gives=WHOLE)
def run_laws(s, c, laws, p, clock):
    """The same with smooth laws."""
    return simulate_pass(s, c, laws, p, clock, None, None)
