"""Speed of the tuner against the plain way: simulate every trial on a time grid with `control`.

`make bench` prints the figures; nothing is asserted about them, since machines differ.
"""

from __future__ import annotations

import time
import warnings

import control
import numpy as np
import pytest

from drivetool.drive import state_space
from drivetool.tune.optimisation import TuneLimits, criterion, optimum, tuning_problem
from drivetool.tune.optimisation.criteria import criterion_value
from drivetool.tune.speed_loop import Settings, Wiring, build
from tests.tallfors import MOTORS, TABLES_4, tandem, two_mass_plant

pytestmark = pytest.mark.bench
GRID = 2e-4


def timed(work):
    """(result, seconds) of the quickest of three runs."""
    best = None
    for _ in range(3):
        began = time.perf_counter()
        result = work()
        took = time.perf_counter() - began
        best = took if best is None else min(best, took)
    return result, best


class PlainScript:
    """What one writes in an afternoon: closed loop by `control`, |error| summed on a grid, Ms on another."""

    def __init__(self, drive):
        a, b, c, d = state_space(drive.with_values({"converter.bandwidth": 1e9, "converter.dead_time": 0.0}),
                                 ("motor_torque", "load_torque"), ("motor_speed", "load_speed"))
        keep = 3  # without the converter's own two states
        b = np.column_stack([[1 / drive.value("motor.inertia"), 0, 0], b[:keep, 1]])
        a, c = a[:keep, :keep], c[:, :keep]
        self.plant = control.ss(a, b, c, d)
        w, z, td = (drive.value(f"converter.{k}") for k in ("bandwidth", "damping", "dead_time"))
        self.path = control.ss(control.tf(np.array([-td / 2, 1]) * w**2, [1, 2 * z * w, w**2]))
        self.time, self.w = np.arange(0.0, 1.2, GRID), np.geomspace(1.0, 3e3, 2000)
        self.trials = 0

    def loop(self, gain, integral_time):
        """(closed loop from load torque to load speed, loop gain)."""
        pi = control.ss(control.tf([gain, gain / integral_time], [1, 0]))
        command = control.series(pi, self.path)
        open_loop = control.series(command, self.plant[0, 0])
        whole = control.append(self.plant, command)
        closed = control.connect(whole, [[1, 3], [3, -1]], [2], [2])
        return closed, open_loop

    def cost(self, x):
        """IAE with a penalty for Ms above 2."""
        self.trials += 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            closed, open_loop = self.loop(*np.exp(x))
            ms = 1.0 / np.abs(1.0 + open_loop(1j * self.w)).min()
            if closed.poles().real.max() >= 0.0:
                return 1e3
            e = control.forced_response(closed, self.time, np.ones_like(self.time)).outputs
        return float(np.abs(e).sum() * GRID * (1.0 + 1e3 * max(0.0, ms - 2.0)))

    def design(self):
        """The same search as the tuner's first look, a grid, then a simplex from the best point."""
        from scipy.optimize import minimize

        times, gains = np.geomspace(0.005, 0.3, 20), np.geomspace(300.0, 6000.0, 20)
        costs = [(self.cost(np.log([kp, ti])), kp, ti) for ti in times for kp in gains]
        _, kp, ti = min(costs)
        found = minimize(self.cost, np.log([kp, ti]), method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-9})
        return Settings(*map(float, np.exp(found.x)))


def test_one_design_against_a_plain_script():
    drive = two_mass_plant("heavy")
    loop = build(drive, Wiring(dead_time="zero"))
    iae = criterion("IAE")
    optimum(tuning_problem(loop, iae, TuneLimits()))  # compiles, once per installation
    mine, mine_took = timed(lambda: optimum(tuning_problem(loop, iae, TuneLimits())))
    script = PlainScript(drive)
    began = time.perf_counter()
    theirs = script.design()
    theirs_took = time.perf_counter() - began
    print(f"\nconstrained IAE design, two masses: {mine_took:.2f} s, Kp {mine.settings.gain:.1f} "
          f"Ti {mine.settings.integral_time:.5f}, IAE {mine.value:.5g}")
    print(f"plain script, control.forced_response on a {1e3 * GRID:g} ms grid, {script.trials} trials: "
          f"{theirs_took:.1f} s, Kp {theirs.gain:.1f} Ti {theirs.integral_time:.5f}, "
          f"IAE {criterion_value(loop, iae, theirs):.5g}")
    print(f"ratio for one design: {theirs_took / mine_took:.0f}")
    # Measured were 60 to 90 times; the script may end a grid step beside the optimum.
    assert theirs_took > 20 * mine_took and mine.value <= criterion_value(loop, iae, theirs) * (1 + 1e-3)
    at = mine.settings
    _, one = timed(lambda: [criterion_value(loop, iae, at) for _ in range(200)])
    _, other = timed(lambda: [script.cost(np.log([at.gain, at.integral_time])) for _ in range(20)])
    print(f"one trial: {1e6 * one / 200:.0f} us against {1e6 * other / 20:.0f} us, ratio {10 * other / one:.0f}")


def test_the_nine_tandem_cases():
    total, busy = 0.0, time.process_time()
    for column in TABLES_4:
        loop = build(tandem(column.plant), Wiring(column.configuration, MOTORS, dead_time="zero"))
        began = time.perf_counter()
        found = optimum(tuning_problem(loop, criterion("IAE"), TuneLimits()))
        took = time.perf_counter() - began
        total += took
        print(f"\n{column.plant} {column.configuration}: {took:.1f} s, IAE {found.value:.4g}", end="")
    print(f"\nnine tandem designs: {total:.1f} s, of which one processor {time.process_time() - busy:.1f} s")
    assert time.process_time() - busy < 30.0  # s; measured were 11
