"""Experiments for a machine whose plain parameters are roughly known, as a careful engineer makes them.

Every profile is as long as the rig's records are, at 1 kHz; random levels come from the seed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.hidden.rigs import Rig
from tests.simulator.experiments import multisine, trapezoids
from tests.simulator.fast import PI
from tests.simulator.machine import State, running

STEP = 1e-3
KINDS = ("reversing", "one-directional", "closed-loop", "moves", "cruise", "chirp", "binary", "steps")


@dataclass(frozen=True)
class Profile:
    """The commands of the drive.

    torque      (n,) [Nm]; with a controller what is added to its output
    controller  PI or None
    start       where the machine is at the first sample
    """

    torque: np.ndarray
    controller: PI | None
    start: State


def profile(kind: str, rig: Rig, seed: int) -> Profile:
    """One experiment.

    kind    "reversing": open loop, fast and slow reversals, a preload sweep, broadband torque;
            "one-directional": open loop, levels of one sign; "closed-loop": speed controller.
            Less careful: "moves" from stop to stop and "cruise" between speeds of one sign, under a speed
            controller, with nothing added; a slow sine of the speed with a "chirp" or with "binary" torque;
            "steps" of torque
    raises  ValueError: another kind
    """
    if kind not in KINDS:
        raise ValueError(f"record: wanted one of {', '.join(KINDS)}, found {kind!r}")
    rng = np.random.default_rng([seed, KINDS.index(kind), 104729])
    size = round(rig.duration / STEP)
    if kind == "closed-loop":
        return _closed_loop(rig, rng, size)
    if kind in ("moves", "cruise"):
        return _speed_controlled(rig, _moves_or_levels(rig, rng, size, kind == "cruise"), np.zeros(size), rng)
    if kind == "steps":
        return Profile(_rounded(rig, _steps(rig, rng, size)), None, running(rig.machine, 0.0))
    if kind in ("chirp", "binary"):
        speed = _slow_sine(rig, rng, size)
        extra = _chirp(rig, size) if kind == "chirp" else _binary(rig, rng, size)
        torque = _rigid_body_torque(rig, speed) + 0.08 * rig.rated * extra
        return Profile(_rounded(rig, torque), None, running(rig.machine, float(speed[0])))
    speed, strength = (_reversing if kind == "reversing" else _one_directional)(rig, rng, size)
    torque = _rigid_body_torque(rig, speed) + strength * rig.rated * _broadband(rig, rng, size)
    return Profile(_rounded(rig, torque), None, running(rig.machine, float(speed[0])))


def _rounded(rig: Rig, torque: np.ndarray) -> np.ndarray:
    """The command as a drive has it, in counts of a hundred-thousandth of the rated torque."""
    count = 10.0 ** np.floor(np.log10(rig.rated * 1e-5))
    return np.round(torque / count) * count


def _rigid_body_torque(rig: Rig, speed: np.ndarray) -> np.ndarray:
    """(n,) torque that takes the rigid machine along a speed."""
    m = rig.machine
    rate = np.diff(speed, append=speed[-1]) / STEP
    coulomb = sum(m.coulomb) * np.clip(speed / (0.01 * rig.top), -1.0, 1.0)
    return sum(m.inertia) * rate + sum(m.viscous) * speed + sum(m.idle_torque) + coulomb


def _broadband(rig: Rig, rng, size: int) -> np.ndarray:
    """(n,) about one in size: binary steps as long as an eighth of a period, sines, single samples."""
    hold = max(2, round(1.0 / (8.0 * rig.resonance * STEP)))
    steps = np.repeat(rng.choice([-1.0, 1.0], size // hold + 1), hold)[:size]
    lines = np.unique(np.round(np.geomspace(0.3, 2.5, 12) * rig.resonance, 1))
    sines = multisine(lines, 0.25, size * STEP, STEP, int(rng.integers(2**31)))[:size]
    return 0.8 * steps + sines + 0.3 * rng.choice([-1.0, 1.0], size)


def _reversing(rig: Rig, rng, size: int):
    """(speed, strength of the broadband part): fast moves, slow reversals, a preload sweep."""
    top, knots, values = rig.top, [0.0, 0.1], [0.0, 0.0]
    strengths = [(0.0, 0.05)]

    def go(target, share, pause, strength):
        length = max(abs(target - values[-1]) / (share * 2.0 * top), 0.05)
        strengths.append((knots[-1], strength))
        knots.extend([knots[-1] + length, knots[-1] + length + pause])
        values.extend([target, target])

    end = size * STEP
    while knots[-1] < end:
        levels = rng.permutation([0.15, 0.3, 0.55, 0.8])
        for level, strength in zip(levels, (0.04, 0.1, 0.15, 0.07), strict=True):
            direction = -1.0 if values[-1] > 0.0 else 1.0
            go(direction * level * top, rng.uniform(0.15, 0.6), rng.uniform(0.1, 0.3), strength)
        for direction in (1, -1, 1, -1):
            slow = direction * rng.uniform(0.04, 0.1) * top
            go(slow, rng.uniform(0.1, 0.2), rng.uniform(0.1, 0.3), 0.015)
        for preload in rng.permutation([0.1, 0.25, 0.45]):
            direction = -1.0 if values[-1] > 0.0 else 1.0
            go(direction * min(0.9, 1.2 * preload) * top, preload, 0.05, 0.05)
    return _interpolated(knots, values, strengths, size)


def _one_directional(rig: Rig, rng, size: int):
    """(speed, strength): levels of one direction."""
    top, knots, values = rig.top, [0.0, 0.3], [1.0 * rig.top, 1.0 * rig.top]
    strengths = [(0.0, 0.05)]
    while knots[-1] < size * STEP:
        target = rng.uniform(0.6, 2.5) * top
        length = max(abs(target - values[-1]) / (rng.uniform(0.1, 0.35) * 2.0 * top), 0.05)
        strengths.append((knots[-1], float(rng.choice([0.03, 0.06, 0.12]))))
        knots += [knots[-1] + length, knots[-1] + length + rng.uniform(0.3, 0.8)]
        values += [target, target]
    return _interpolated(knots, values, strengths, size)


def _interpolated(knots, values, strengths, size):
    time = np.arange(size) * STEP
    times, strength = np.array(strengths).T
    return np.interp(time, knots, values), strength[np.searchsorted(times, time, side="right") - 1]


def _closed_loop(rig: Rig, rng, size: int) -> Profile:
    """Trapezoids of both directions under a speed controller, with a torque dither."""
    total, seed = sum(rig.machine.inertia), int(rng.integers(2**31))
    reference = trapezoids(0.6 * rig.top, 0.8, rng.uniform(0.25, 0.4), size * STEP, STEP, seed, 5)[:size]
    gain = rng.uniform(4.0, 10.0) * total
    dither = 0.03 * rig.rated * _broadband(rig, rng, size)
    start = running(rig.machine, 0.0)
    pi = PI(reference, gain, rng.uniform(1.0, 4.0) * gain, start.torque, rig.rated)
    return Profile(_rounded(rig, dither), pi, start)


def _speed_controlled(rig: Rig, reference: np.ndarray, extra: np.ndarray, rng) -> Profile:
    """A reference under a speed controller."""
    gain = rng.uniform(4.0, 10.0) * sum(rig.machine.inertia)
    start = running(rig.machine, float(reference[0]))
    return Profile(_rounded(rig, extra), PI(reference, gain, rng.uniform(1.0, 4.0) * gain, start.torque, rig.rated),
                   start)


def _moves_or_levels(rig: Rig, rng, size: int, cruise: bool) -> np.ndarray:
    """(n,) speed with limited jerk: levels and stops between them, or levels of one sign."""
    level = rig.top if cruise else 0.0
    knots, values = [0.0, 0.2], [level, level]

    def go(target, pause):
        length = max(abs(target - values[-1]) / (rng.uniform(0.4, 1.2) * 1.2 * rig.top), 0.05)
        knots.extend([knots[-1] + length, knots[-1] + length + pause])
        values.extend([target, target])

    while knots[-1] < size * STEP:
        share = rng.choice([0.2, 0.5, 0.8, 1.0])
        go(level + share * rig.top * (1.0 if cruise else rng.choice([-1.0, 1.0])), rng.uniform(0.1, 0.6))
        if not cruise:
            go(0.0, rng.uniform(0.2, 0.6))
    speed = np.interp(np.arange(size) * STEP, knots, values)
    jerk = round(0.02 / STEP)
    return np.convolve(np.concatenate((np.full(jerk, speed[0]), speed)), np.ones(jerk) / jerk)[jerk:jerk + size]


def _steps(rig: Rig, rng, size: int) -> np.ndarray:
    """(n,) torque in steps that turn the machine back and forth."""
    m, torque, speed, done = rig.machine, np.zeros(size), 0.0, 0
    while done < size:
        count = round(rng.uniform(0.05, 0.5) / STEP)
        level = rng.choice([0.0, 0.1, 0.2, 0.4, 0.7]) * rig.rated * (-1.0 if speed > 0.0 else 1.0)
        torque[done:done + count] = level + sum(m.idle_torque) + sum(m.coulomb) * np.sign(speed)
        speed += level * count * STEP / sum(m.inertia)
        done += count
    return torque


def _slow_sine(rig: Rig, rng, size: int) -> np.ndarray:
    """(n,) a slow sine of the speed, at times beside a level."""
    phase = 2.0 * np.pi * rng.uniform(0.1, 0.3) * np.arange(size) * STEP + rng.uniform(0.0, 2.0 * np.pi)
    return rig.top * (0.7 * np.sin(phase) + (1.0 if rng.uniform() < 0.3 else 0.0))


def _chirp(rig: Rig, size: int) -> np.ndarray:
    """(n,) sines from a fifth of the resonance to four times that, every four seconds."""
    low, high, period = 0.2 * rig.resonance, min(4.0 * rig.resonance, 0.4 / STEP), 4.0
    time = np.mod(np.arange(size) * STEP, period)
    return np.sin(2.0 * np.pi * low * period / np.log(high / low) * ((high / low) ** (time / period) - 1.0))


def _binary(rig: Rig, rng, size: int) -> np.ndarray:
    """(n,) plus or minus one, held for a sixth of the resonance's period."""
    hold = max(1, round(1.0 / (6.0 * rig.resonance * STEP)))
    return np.repeat(rng.choice([-1.0, 1.0], size // hold + 1), hold)[:size]
