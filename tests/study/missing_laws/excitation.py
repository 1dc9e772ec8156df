"""What makes a drive move: four torque commands and four references of a loop; all reverse."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from tests.study.missing_laws import kernel
from tests.study.missing_laws.machine import Machine

# In this order over the numbers of the records, so that every other one is in closed loop.
EXCITATIONS = ("staircase", "speed-steps", "prbs", "point-to-point", "chirp", "sines", "multisine", "random-speeds")


@dataclass(frozen=True)
class Excitation:
    """A torque command, or a controller and its references.

    mode            of the kernel: OPEN, SPEED or POSITION
    command         (n,) [N m]; speeds [rad/s], angles [rad]: (n,) references
    controller      (6,) of the kernel
    """

    mode: int
    command: np.ndarray
    speeds: np.ndarray
    angles: np.ndarray
    controller: np.ndarray

    def louder(self, factor: float) -> Excitation:
        """The same with more torque."""
        return replace(self, command=factor * self.command)


def draw_excitation(name: str, machine: Machine, step: float, n: int, start: float, slowest: float,
                    rng: np.random.Generator) -> Excitation:
    """An excitation of n samples.

    step     [s] of the samples; start: [rad/s] speed at the beginning, from which references go on
    slowest  [Hz] resonance that the loop must keep away from; infinite without one
    """
    rest = np.zeros(n)
    speed = machine.rated_speed * rng.uniform(0.25, 0.7)
    bandwidth = 2.0 * np.pi * min(10.0 ** rng.uniform(0.4, 1.0), slowest / 4.0)
    gain = machine.inertia * bandwidth
    if name in OPEN:
        friction = machine.viscous * speed + machine.coulomb
        controller = np.array([gain, 0.0, 0.0, 0.0, 0.0, rng.uniform(0.9, 1.5) * machine.rated_speed])
        return Excitation(kernel.OPEN, OPEN[name](rng, step, n, friction), rest, rest, controller)
    controller = np.array([gain, gain * bandwidth * rng.uniform(0.1, 0.25), bandwidth * rng.uniform(0.15, 0.3),
                           min(8.0 * bandwidth * step, 1.0), machine.rated_torque * rng.uniform(0.8, 2.0), np.inf])
    seconds = max(machine.inertia * speed / (0.4 * machine.rated_torque), 4.0 / bandwidth)
    wanted = speed * CLOSED[name](rng, step, n, seconds) + start * np.exp(-step * np.arange(n) / seconds)
    return Excitation(kernel.POSITION if name == "point-to-point" else kernel.SPEED, rest, wanted,
                      step * np.cumsum(wanted), controller)


def _levels(rng: np.random.Generator, step: float, n: int, shortest: float, longest: float,
            draw) -> np.ndarray:
    """(n,) constant for random times [s] at what `draw` gives in turn."""
    found = []
    while len(found) < n:
        found += [draw()] * max(int(rng.uniform(shortest, longest) / step), 1)
    return np.array(found[:n])


def _staircase(rng: np.random.Generator, step: float, n: int, friction: float) -> np.ndarray:
    """Steps up and down, and coasting between, with both signs in turn."""
    signs = iter(np.resize([1.0, 1.0, -1.0, -1.0], 4 * n))
    return friction * _levels(rng, step, n, 0.3, 1.2, lambda: next(signs) * rng.choice([0.0, 0.9, 1.5, 2.4]))


def _prbs(rng: np.random.Generator, step: float, n: int, friction: float) -> np.ndarray:
    """Two levels at multiples of a clock, over a slow square wave that keeps it going."""
    clock = rng.uniform(0.02, 0.12)
    fast = _levels(rng, step, n, clock, 1.001 * clock, lambda: rng.choice([-1.0, 1.0]))
    slow = np.sign(np.sin(2.0 * np.pi * (rng.uniform(0.15, 0.4) * step * np.arange(n) + rng.uniform())))
    return friction * (rng.uniform(0.8, 1.8) * fast + 0.8 * slow)


def _chirp(rng: np.random.Generator, step: float, n: int, friction: float) -> np.ndarray:
    """From slow to fast, in proportion to time or its exponential."""
    share, first, last = np.arange(n) / n, rng.uniform(0.15, 0.4), rng.uniform(5.0, 20.0)
    grown = np.log(last / first)
    turns = first * (np.exp(grown * share) - 1.0) / grown if rng.uniform() < 0.5 else (
        first * share + 0.5 * (last - first) * share**2)
    return friction * rng.uniform(1.6, 3.5) * np.sin(2.0 * np.pi * step * n * turns)


def _multisine(rng: np.random.Generator, step: float, n: int, friction: float) -> np.ndarray:
    """Twelve lines up to 15 Hz of random phase, the slow ones stronger."""
    return friction * rng.uniform(1.0, 2.0) * _sines(rng, step, n, 12, 15.0) * np.sqrt(2.0)


def _sines(rng: np.random.Generator, step: float, n: int, lines: int, highest: float) -> np.ndarray:
    """(n,) root mean square 1/sqrt 2."""
    frequency = np.exp(rng.uniform(np.log(0.15), np.log(highest), lines))
    phase = 2.0 * np.pi * rng.uniform(size=lines)
    waves = np.sin(2.0 * np.pi * step * np.arange(n)[:, None] * frequency + phase) / np.sqrt(0.5 + frequency)
    total = waves.sum(axis=1)
    return total / total.std() / np.sqrt(2.0)


def _speed_steps(rng: np.random.Generator, step: float, n: int, seconds: float) -> np.ndarray:
    """Random speeds, standing now and then."""
    return _levels(rng, step, n, 2.0 * seconds, 6.0 * seconds,
                   lambda: 0.0 if rng.uniform() < 0.15 else rng.uniform(0.2, 1.0) * rng.choice([-1.0, 1.0]))


def _point_to_point(rng: np.random.Generator, step: float, n: int, seconds: float) -> np.ndarray:
    """Quintic moves to and fro with pauses, of random length and speed."""
    found = []
    while len(found) < n:
        share = np.linspace(0.0, 1.0, max(int(seconds * rng.uniform(2.0, 6.0) / step), 8))
        move = 16.0 * share**2 * (1.0 - share)**2 * rng.uniform(0.3, 1.0)
        found += [*(move * rng.choice([-1.0, 1.0])), *np.zeros(int(rng.uniform(0.0, 0.3) / step))]
    return np.array(found[:n])


def _speed_sines(rng: np.random.Generator, step: float, n: int, seconds: float) -> np.ndarray:
    """Six sines as fast as the torque allows."""
    return _sines(rng, step, n, 6, max(0.3, 0.25 / seconds))


def _random_speeds(rng: np.random.Generator, step: float, n: int, seconds: float) -> np.ndarray:
    """Random levels, changed often and rounded by a lag or a mean."""
    levels = _levels(rng, step, n, 0.5 * seconds, 3.0 * seconds, lambda: rng.normal(0.0, 0.6))
    width = max(int(0.2 * seconds / step), 1)
    if rng.uniform() < 0.5:
        return uniform_filter1d(levels, width)
    pole = np.exp(-1.0 / width)
    return lfilter([1.0 - pole], [1.0, -pole], levels)


OPEN = {"staircase": _staircase, "prbs": _prbs, "chirp": _chirp, "multisine": _multisine}
CLOSED = {"speed-steps": _speed_steps, "point-to-point": _point_to_point, "sines": _speed_sines,
          "random-speeds": _random_speeds}
