"""Five records that the fit must reach from distant starts, by the independent simulator.

The first is the main job: 24 000 samples at 1 kHz, eight parameters, gap and Coulomb friction. The
others are other machines: load over motor inertia from 0.2 to 8, closed and open loop, one chain of
three masses. The way in was worked out on these five. The one of low load inertia is without torque noise: with it,
rattling makes the filter's likelihood prefer a wrong gap, and no start can help that.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from drivetool.drive import Drive, two_mass
from drivetool.drive.chain import three_mass
from drivetool.logs import Experiment
from tests.recover import STEP, experiment
from tests.simulator import laws, machine, simulate, stepper
from tests.simulator.controllers import SpeedPI
from tests.simulator.experiments import alternating, multisine, trapezoids
from tests.simulator.machine import Machine, at_rest
from tests.simulator.records import white_noise
from tests.simulator.simulate import Sensor


@dataclass(frozen=True)
class Case:
    """A machine, how its record was made, and what is fitted to it.

    make  (size) -> (torque (n,), speed (n,)); free: names of what is fitted
    """

    name: str
    machine: Machine
    drive: Drive
    free: tuple[str, ...]
    make: Callable[[], tuple[np.ndarray, np.ndarray]]

    @property
    def truth(self) -> dict[str, float]:
        """All values under the tool's names."""
        m, d, found = self.machine, self.drive, {}
        for suffix in ("inertia", "viscous", "coulomb", "idle_torque"):
            found |= {f"{b}.{suffix}": v for b, v in zip(d.bodies, getattr(m, suffix), strict=True)}
        for suffix in ("stiffness", "damping", "half_gap"):
            found |= {f"{s}.{suffix}": v for s, v in zip(d.shafts, getattr(m, suffix), strict=True)}
        return found

    @property
    def hold(self) -> tuple[str, ...]:
        """Frictions that a grey-box fit would free by itself."""
        names = [f"{b}.{s}" for b in self.drive.bodies for s in ("viscous", "coulomb", "idle_torque")]
        return tuple(n for n in names if n not in self.free)

    def start(self, off: float = 0.0, seed: int = 0) -> Drive:
        """The drive with every free value +-off (relative) wrong, signs drawn."""
        signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(self.free))
        wrong = {n: self.truth[n] * (1.0 + off * s) for n, s in zip(self.free, signs, strict=True)}
        rest = {n: v for n, v in self.truth.items() if v and n not in wrong}
        return self.drive.with_values(rest | wrong)

    def record(self) -> Experiment:
        """The record, simulated once and then kept in the temporary folder."""
        return _record(self.name)


SHAPE = ("motor.inertia", "load.inertia", "motor.viscous", "motor.coulomb", "load.idle_torque",
         "shaft.stiffness", "shaft.damping", "shaft.half_gap")
CHAIN = ("motor.inertia", "gear.inertia", "arm.inertia", "motor.viscous", "motor.coulomb",
         "arm.idle_torque", "shaft.stiffness", "shaft2.stiffness", "shaft.damping", "shaft2.damping",
         "shaft.half_gap")


def _closed(machine: Machine, duration: float, top: float, gain: float, lines: np.ndarray, size: float,
            speed_noise: float, torque_noise: float, seed: int, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Trapezoids of speed under a PI controller, with a multisine on its torque."""
    n = round(duration / STEP)
    reference = trapezoids(top, 0.75, 0.35, duration, STEP, seed)[:n]
    controller = SpeedPI(reference, gain, 4.0 / 3.0 * gain, STEP, limit=limit)
    sensor = Sensor("speed", white_noise(n, speed_noise, seed + 1))
    run = simulate.simulate(machine, multisine(lines, size, duration, STEP, seed + 2)[:n], STEP, at_rest(machine),
                            controller, white_noise(n, torque_noise, seed + 3), sensor=sensor)
    return run.command, run.measured


def _open(machine: Machine, duration: float, base: float, steps: tuple[float, float],
          half: tuple[float, float], lines: np.ndarray, size: float, speed_noise: float, torque_noise: float,
          seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Torque steps of both signs about a base, with a multisine; no controller."""
    n = round(duration / STEP)
    torque = alternating(base, steps, half, round(duration / half[0]), 0.3, STEP, seed)[:n]
    torque = torque + multisine(lines, size, duration, STEP, seed + 2)[:n]
    run = simulate.simulate(machine, torque, STEP, at_rest(machine), None, white_noise(n, torque_noise, seed + 3),
                            sensor=Sensor("speed", white_noise(n, speed_noise, seed + 1)))
    return run.command, run.measured


MAIN = Machine((0.6, 5.2), (0.8, 0.0), (5.0, 0.0), (0.0, 8.0), (3300.0,), (3.1,), (0.03,))
LOW_INERTIA = Machine((2.0, 0.4), (0.5, 0.0), (4.0, 0.0), (0.0, 3.0), (4200.0,), (1.5,), (0.006,))
EVEN = Machine((0.05, 0.05), (0.02, 0.0), (0.3, 0.0), (0.0, 0.4), (90.0,), (0.05,), (0.02,))
HEAVY = Machine((20.0, 160.0), (15.0, 0.0), (60.0, 0.0), (0.0, 250.0), (30000.0,), (50.0,), (0.04,))
THREE = Machine((0.4, 0.25, 1.6), (0.5, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 4.0), (2500.0, 4000.0),
                (1.2, 1.5), (0.02, 0.0))

CASES = {case.name: case for case in (
    Case("main", MAIN, two_mass(), SHAPE, lambda: _closed(
        MAIN, 24.0, 6.0, 9.0, np.arange(2.0, 25.0), 0.7, 0.02, 0.0, 20261120, 60.0)),
    Case("low-inertia", LOW_INERTIA, two_mass(), SHAPE, lambda: _closed(
        LOW_INERTIA, 12.0, 8.0, 12.0, np.arange(3.0, 40.0, 2.0), 0.8, 0.01, 0.0, 31, 80.0)),
    Case("even", EVEN, two_mass(), SHAPE, lambda: _open(
        EVEN, 12.0, 0.4, (1.2, 2.5), (0.3, 0.6), np.arange(1.0, 20.0), 0.06, 0.05, 0.0, 41)),
    Case("heavy", HEAVY, two_mass(), SHAPE, lambda: _closed(
        HEAVY, 16.0, 2.5, 300.0, np.arange(0.5, 12.0, 0.5), 20.0, 0.004, 8.0, 51, 2000.0)),
    Case("three", THREE, three_mass(), CHAIN, lambda: _closed(
        THREE, 12.0, 6.0, 6.0, np.arange(2.0, 40.0, 2.0), 0.6, 0.01, 0.3, 61, 60.0)),
)}


@cache
def _record(name: str) -> Experiment:
    """Simulating takes half a minute; the cached copy is identified by a hash of the code that made it."""
    sources = [Path(m.__file__) for m in (laws, machine, simulate, stepper)] + [Path(__file__)]
    key = hashlib.sha256(b"".join(p.read_bytes() for p in sources)).hexdigest()[:12]
    path = Path(tempfile.gettempdir()) / f"drivetool-bench-{os.getuid()}" / f"{name}-{key}.npz"
    if path.exists():
        with np.load(path) as kept:
            return experiment(kept["torque"], kept["speed"], name)
    torque, speed = CASES[name].make()
    path.parent.mkdir(exist_ok=True)
    part = path.with_name(f"{os.getpid()}-{path.name}")
    np.savez(part, torque=torque, speed=speed)
    part.replace(path)
    return experiment(torque, speed, name)
