"""Free runs of two and three masses between events: the state stays in registers from sample to sample.

What is done at a sample is what run.py does there. A sample in which an event may lie is not begun, or begun
and left to run.py, which does it from its start.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import njit

from drivetool.drive.compiled import HOT
from drivetool.drive.kernel import propagate_five, propagate_three, value_five, value_three


@njit(**HOT)
def next_three(e, x, u):
    """The state a sample later."""
    return value_three(e, 0, x, u), value_three(e, 1, x, u), value_three(e, 2, x, u)


@njit(**HOT)
def next_five(e, x, u):
    """The same for five states."""
    return (value_five(e, 0, x, u), value_five(e, 1, x, u), value_five(e, 2, x, u), value_five(e, 3, x, u),
            value_five(e, 4, x, u))


@njit(**HOT)
def three_of(x):
    """The state as numbers by themselves."""
    return x[0], x[1], x[2]


@njit(**HOT)
def five_of(x):
    """The same for five states."""
    return x[0], x[1], x[2], x[3], x[4]


def glider(state_of: Callable, value: Callable, following: Callable, propagate: Callable) -> Callable:
    """glide(s, c, p, k, i): samples from i on in the mode of slot k; returns the first that was not done.

    s, c, p  system, cache and pass, of one input; all outputs are states, and there is no observer
    """
    @njit(**HOT)
    def glide(s, c, p, k, i):
        e, d, rows, looks, mode, x = c.leap[k], c.dleap[k], c.watch[k], c.looks[k], p.mode, state_of(p.x)
        reach, level, picks = s.reach, c.hold, s.picks
        u, y, weight, big, out, jac = p.u, p.y, p.weight, p.big, p.out, p.jac
        n, gaps, weighed, columns, smooth = u.shape[0], reach.shape[0], weight.shape[0] > 0, jac.shape[2], True
        while i < n:
            for m in range(out.shape[1]):
                pick = picks[m]
                out[i, m] = x[pick]
                if jac.shape[0] > 0:
                    g = weight[i, m] if weighed else 1.0
                    g = g if y[i, m] == y[i, m] else 0.0
                    for q in range(columns - 1):
                        jac[i, m, q] = g * big[pick, q]
                    jac[i, m, columns - 1] = -g * (y[i, m] - x[pick]) if g != 0.0 else 0.0
            torque = u[i, 0]
            b = following(e, x, torque)
            for element in range(mode.size):
                digit = mode[element]
                first, last = value(rows[element], 0, x, torque), value(rows[element], 0, b, torque)
                low, high, bend = min(first, last), max(first, last), 0.0
                before, now = first, first
                for m in range(1, looks + 1):
                    v = value(rows[element], m, x, torque)
                    low, high = min(low, v), max(high, v)
                    bend = max(bend, abs(v - 2.0 * now + before) if m > 1 else 0.0)
                    before, now = now, v
                bend = max(bend, abs(last - 2.0 * now + before))
                bound = reach[element, 0] if element < gaps else level[element - gaps, 0] if digit == 1 else 0.0
                room = bound - max(high, -low) if digit == 1 else (low if digit == 0 else -high) - bound
                smooth = smooth and room >= 0.25 * bend
            if not smooth:
                break
            if big.shape[1] > 0:
                propagate(e, d, x, torque, big)
            x = b
            i += 1
        for r in range(len(x)):
            p.x[r] = x[r]
        return i

    return glide


glide_three = glider(three_of, value_three, next_three, propagate_three)
glide_five = glider(five_of, value_five, next_five, propagate_five)
