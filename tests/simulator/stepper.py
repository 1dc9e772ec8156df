"""Integration over one piece of constant input, stopping at every mode change on the way."""

from __future__ import annotations

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from tests.simulator.laws import Laws

# Fractions of a step at which guards are evaluated; near its ends too, for a dip in the first or last eighth.
FRACTIONS = np.sort([*np.arange(9) / 8.0, 1e-4, 1.0 - 1e-4])
MAX_EVENTS_PER_PIECE = 1000


class Stepper:
    """Advances state vectors of `laws` with SciPy's DOP853; keeps the last good step size."""

    def __init__(self, laws: Laws, rtol: float, atol: float):
        self.laws, self.rtol, self.atol = laws, rtol, atol
        self.guarded = bool(laws.exits())
        self.good_step = np.inf

    def advance(self, y: np.ndarray, length: float) -> np.ndarray:
        """State `length` seconds after y, with all mode changes between made in `laws`.

        y may be changed, by rounding errors of a speed that has just reached zero.
        """
        self.laws.settle(y)
        done = 0.0
        for _ in range(MAX_EVENTS_PER_PIECE):
            y, took, event = self._until_event(y, length - done)
            done += took
            if event is None:
                return y
            y = y.copy()
            self.laws.leave(y, *event)
            if done >= length:
                return y
        raise RuntimeError(f"more than {MAX_EVENTS_PER_PIECE} mode changes in {length} s, last {event}")

    def _solver(self, start: float, y: np.ndarray, end: float) -> DOP853:
        first = min(end - start, self.good_step)
        return DOP853(self.laws.derivative, start, y, end, rtol=self.rtol, atol=self.atol, first_step=first)

    def _until_event(self, y, length):
        """(state, time taken, event or None) at the first event or at the end."""
        solver = self._solver(0.0, y, length)
        while solver.status == "running":
            before = solver.y
            tried = min(solver.h_abs, length - solver.t)
            message = solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"integration failed: {message}")
            # A rejected step says how long a step may be; a full one may grow again.
            self.good_step = solver.step_size if solver.step_size < 0.999 * tried else max(
                self.good_step, solver.h_abs)
            if self.guarded:
                found = self._first_exit(solver)
                if found is not None:
                    when, event = found
                    return self._redo(solver.t_old, before, when), when, event
        return solver.y, length, None

    def _redo(self, start, y, end):
        """The step again, ending at the event: the dense output is an order less accurate."""
        if end - start <= 1e-18:
            return y
        solver = self._solver(start, y, end)
        while solver.status == "running":
            solver.step()
        return solver.y

    def _first_exit(self, solver):
        """(time, event) of the first guard that fails within the last step, or None.

        Guards are looked at in several points, and where one dips between them, at the bottom
        of the dip: a contact may open and close again within one step.
        """
        output = solver.dense_output()
        times = solver.t_old + FRACTIONS * (solver.t - solver.t_old)
        times[-1] = solver.t
        rows = [self.laws.guards(x) for x in output(times).T.tolist()]
        best = None
        for j, (values, way_out) in enumerate(zip(zip(*rows, strict=True), self.laws.exits(), strict=True)):
            kind, index, new, noise = way_out

            def guard(t, j=j):
                return self.laws.guards(output(t).tolist())[j]

            bracket = _bracket(times, values, noise, guard)
            if bracket is not None:
                when = _crossing(guard, *bracket)
                if best is None or when < best[0]:
                    best = when, (kind, index, new)
        return best


def _bracket(times, values, noise, guard):
    """(time where the guard holds, time where it fails), the first such, or None."""
    for k in range(1, len(values)):
        if values[k] < -noise:
            return times[k - 1], times[k]
        if k + 1 < len(values) and values[k - 1] > values[k] < values[k + 1]:
            before, after = times[k] - times[k - 1], times[k + 1] - times[k]
            fall, rise = (values[k] - values[k - 1]) / before, (values[k + 1] - values[k]) / after
            curve = 2.0 * (rise - fall) / (before + after)
            slope = (fall * after + rise * before) / (before + after)
            if values[k] < slope * slope / curve:  # twice the depth that a parabola predicts
                bottom = times[k] - slope / curve
                if guard(bottom) < -noise:
                    return times[k - 1], bottom
    return None


def _crossing(guard, low, high):
    """The first representable time at which the guard does not hold any more."""
    if guard(low) <= 0.0:
        # A mode that has just begun has its guard at zero: step off it, towards low.
        shares = 0.5 ** np.arange(1, 50)
        low = next((t for t in low + shares * (high - low) if guard(t) > 0.0), low)
        if guard(low) <= 0.0:
            return low
    when = brentq(guard, low, high, xtol=1e-18, rtol=1e-15)
    nudge = 1e-18
    while guard(when) > 0.0:
        when = min(when + nudge, high)
        nudge *= 2.0
    return when
