"""The pass over a record that simulates it, with sensitivities and with or without an observer."""

from __future__ import annotations

import math
from collections.abc import Callable

from numba import njit

from drivetool.drive.arrays import MADE_FOR
from drivetool.drive.compile import APART, CACHE, COMPILE, HOT, LAWS, PASS, REAL, SYSTEM, WHOLE, unit
from drivetool.drive.kernel.events import load_on, rough_step, switch_late
from drivetool.drive.kernel.exact_step import classify, fading, forget, guard_values, predict, propagate, stays
from drivetool.drive.kernel.glide import glider, stepper, write_row
from drivetool.drive.kernel.laws import set_hold
from drivetool.drive.kernel.modes import lookup
from drivetool.drive.kernel.outputs import output_gradient, output_row
from drivetool.drive.kernel.smooth import law_step
from drivetool.drive.kernel.smooth_events import law_rough_step, show

MOMENT = 0.1  # of a sample: what moves for that long goes a hundredth as far as what friction stops in a sample


@njit(**APART)
def use_measurement(gain, i, m, e, x, big, col, sens):
    """Correct the state by gain times the innovation e, and its sensitivities."""
    for j in range(x.size):
        k = gain[i, m, j]
        x[j] += k * e
        if sens:
            for q in range(col.size):
                big[j, q] -= k * col[q]


@njit(**HOT)
def reclassify(spring, slip_rows, reach, x, mode, old):
    """Set the mode from the state, after a jump; returns whether it changed."""
    guard_values(spring, slip_rows, x, old)
    return classify(reach, old, mode)


@njit(**COMPILE)
def hold_back(s, c, k, mode, x, u, h, big):
    """Let bodies go on sticking whose corrected speed friction takes back in a moment: that is no motion.

    k  slot of the mode before the correction, or -1; u inputs of the sample of h seconds; big sensitivities
    """
    for f in range(s.nf):
        row = s.slip_rows[f]
        if mode[s.ng + f] == 1 and x[row] != 0.0:
            k = lookup(s, c, mode, 0) if k < 0 else k
            left = c.hold[f, 0] - math.copysign(1.0, x[row]) * load_on(c.net[k, f], x, u)
            if abs(x[row]) * s.mass[row, 0] < MOMENT * h * left:
                way = 0.5 * x[row] * abs(x[row]) * s.mass[row, 0] / left  # until it stands
                for j in range(x.size):
                    if j != row:
                        x[j] += s.rows[j, row, 0] / s.mass[j, 0] * way
                x[row] = 0.0
                for q in range(big.shape[1]):
                    big[row, q] = 0.0


@njit(**HOT)
def law_part(s, c, laws, k, x, held, i, clock, big, mode, part, b):
    """Carry x and big over a part of a sample; (slot of the mode, whether it was free of events).

    k  slot of the mode, or -1 if it has to be looked up
    """
    if s.nf > 0:
        set_hold(s, c, laws, clock)
    if k < 0 or s.spans.size > 1:
        k = lookup(s, c, mode, part)
    if law_step(s, c, laws, k, part, x, held, i, clock, big, mode, b, c.lines[0]):
        return k, True
    law_rough_step(laws.rough, s, c, laws, x, held, i, clock, big, mode, part)
    return -1, False


@njit(**HOT)
def observe(outputs, spring, reach, output_gap, picks, mode, y, gain, weight, i, x, big, row, col, out, jac):
    """The outputs of sample i, their weighted sensitivities, and the correction by the observer."""
    for m in range(out.shape[1]):
        pick = picks[m]
        v = x[pick] if pick >= 0 else output_row(outputs, spring, reach, output_gap, picks, mode, m, x, row)
        out[i, m] = v
        known = y[i, m] == y[i, m]
        e = y[i, m] - v if known else 0.0
        if jac.shape[0] > 0:
            output_gradient(outputs, spring, reach, output_gap, picks, mode, m, x, row, big, col)
            g = weight[i, m] if weight.shape[0] > 0 else 1.0
            write_row(jac, i, m, col, g if known else 0.0, e)
        if gain.shape[0] > 0 and known:
            use_measurement(gain, i, m, e, x, big, col, jac.shape[0] > 0)


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
def plain_step(leap, dleap, watch, looks, reach, level, k, x, u, i, big, mode, b, t):
    """Carry x and big over a part of a sample; False, and nothing moved, if an event may lie in it."""
    predict(leap, k, x, u, i, b)
    if not stays(watch, looks, reach, level, k, mode, x, b, u, i):
        return False
    if big.shape[1] > 0:
        propagate(leap, dleap, k, x, u, i, big, t)
    for r in range(x.size):
        x[r] = b[r]
    return True


@njit(**COMPILE)
def go_through(s, c, laws, p, clock, glide, step):
    """Simulate the samples of a pass p; laws None where there are none, clock the time of the first [s].

    glide, step  of glide.py, for just so many states and one input; None for any
    returns  samples in which events were located
    """
    leap, dleap, watch, looks, guards = c.leap, c.dleap, c.watch, c.looks, c.guards
    spring, slip_rows, picks = s.spring, s.slip_rows, s.picks
    reach, level, outputs, output_gap, memory = s.reach, c.hold, s.outputs, s.output_gap, s.memory
    u, late, y, gain, weight, x, big, mode = p.u, p.late, p.y, p.gain, p.weight, p.x, p.big, p.mode
    out, jac, states = p.out, p.jac, p.states
    n, parts, early = mode.size, s.spans.size, s.early
    row, b, col, t = c.vectors[0], c.vectors[1], c.gradient, c.columns[0]
    if p.fresh != 0:
        reclassify(spring, slip_rows, reach, x, mode, guards)
    observed, fades, located, first, last = gain.shape[0] > 0, fading(memory), 0, -1, -1
    glides, i, length = parts == 1 and c.late == 0, 0, s.spans.sum()
    while i < u.shape[0]:
        if glide is not None and glides:
            first = slots(s, c, mode)[0] if first < 0 else first
            i = glide(s, c, p, first, i)
            if i == u.shape[0]:
                break
        if states.shape[0] > 0:
            for j in range(x.size):
                states[i, j] = x[j]
        if laws is not None:
            reveal(s, laws, x, clock, mode, big)
        observe(outputs, spring, reach, output_gap, picks, mode, y, gain, weight, i, x, big, row, col, out, jac)
        if observed and s.nf > 0:
            hold_back(s, c, first, mode, x, u[i], length, big)
        if observed and n > 0 and reclassify(spring, slip_rows, reach, x, mode, guards):
            first = -1
        for part in range(parts):
            held = late if part < early else u
            if laws is not None:
                first, free = law_part(s, c, laws, first, x, held, i, clock, big, mode, part, b)
                located += not free
                clock += s.spans[part]
            else:
                if first < 0:
                    first, last = slots(s, c, mode)
                k = first if part == 0 else last
                if step is not None:
                    free = step(s, c, k, x, held, i, big, mode)
                else:
                    free = plain_step(leap, dleap, watch, looks, reach, level, k, x, held, i, big, mode, b, t)
                if not free:
                    rough_step(c.rough, s, c, x, held, i, big, mode, part)
                    located += 1
                    first = -1
            if c.late != 0 and part + 1 == early:
                switch_late(c.late, s, c, x, u[i], late[i], big, mode, first)
                first = -1
        forget(memory, fades, x, big)
        i += 1
    return located


@njit(**HOT)
def reveal(s, laws, x, clock, mode, big):
    """Put the torques of the laws where an output can read them, if one does."""
    if laws.shown != 0:
        show(laws.show, s, laws, x, clock, mode, big)


@unit(SYSTEM, CACHE, PASS, REAL, gives=WHOLE)
def run(s, c, p, clock):
    """Simulate the samples of a pass; see go_through."""
    return go_through(s, c, None, p, clock, None, None)


def made_for(n: int) -> Callable:
    """The same for n states and one input only, which is much faster."""
    glide, step = glider(n), stepper(n)

    @unit(SYSTEM, CACHE, PASS, REAL, gives=WHOLE)
    def run(s, c, p, clock):
        return go_through(s, c, None, p, clock, glide, step)

    return run


# Two masses, two with an angle, three, three with an angle, and that with a torque noise that remembers.
run_3, run_4, run_5, run_6, run_7 = (made_for(n) for n in MADE_FOR)


@unit(SYSTEM, CACHE, LAWS, PASS, REAL, gives=WHOLE)
def run_laws(s, c, laws, p, clock):
    """The same with smooth laws."""
    return go_through(s, c, laws, p, clock, None, None)
