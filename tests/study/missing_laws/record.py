"""A record of a random machine, and the truth about it, by situation, size and number.

Everything is drawn from the seed; the same seed gives the same machine in every situation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from tests.study.missing_laws import kernel
from tests.study.missing_laws.excitation import EXCITATIONS, Excitation, draw_excitation
from tests.study.missing_laws.laws import LAWS, MOST, SIZES, Law, draw_law
from tests.study.missing_laws.machine import Machine, draw_machine

# Situations in which the model is right, by the torque noise; quiet: of the sensor alone; noise-free: none at all.
RIGHT = ("noise-free", "quiet", "white", "slow", "fast", "heavy")
SECONDS = (6.0, 15.0)
RATES = (250.0, 400.0, 500.0, 800.0, 1000.0, 2000.0)  # [Hz]
SPEEDS = 25  # at which the friction curve is kept
# Steps of the integrator per sample and per inverse of the fastest rate. Halving them moves a record by less
# than 1e-4 of the inertia would (test_missing_laws.py); a step of a fifth of a radian costs about 3e-6.
LEAST_PARTS, PARTS_PER_RATE = 4, 5.0
LEAST_SLIDING = 0.3  # of the samples; a law that stops the machine is too strong
HALVINGS = 12  # of the logarithm of a strength, over three decades


@dataclass(frozen=True)
class Setup:
    """Everything that a run needs but the law: what does not change while a law's strength is sought.

    step [s]; start: (STATES,)
    disturbance (n,) [N m] added behind the log; load (n,) [N m] against the motor; log_noise (n,) [N m] on the log
    noise (n,) of the sensor, quantum its step (0: none)
    """

    machine: Machine
    excitation: Excitation
    step: float
    start: np.ndarray
    disturbance: np.ndarray
    load: np.ndarray
    log_noise: np.ndarray
    noise: np.ndarray
    quantum: float
    is_angle: bool


@dataclass(frozen=True)
class Run:
    """(n,) torque [N m] as logged, (n,) measured, (n + 1, STATES) states."""

    torque: np.ndarray
    measured: np.ndarray
    states: np.ndarray


@dataclass(frozen=True)
class Truth:
    """What an estimate is held against.

    inertia [kg m^2] mean; idle [N m] with the mean of what friction differs by direction and of the load
    speeds   (SPEEDS,) [rad/s] quantiles of the absolute speed while it moves, each standing for as much time
    curve    (SPEEDS,) [N m] friction at these speeds, mean of both directions
    line     viscous [N m s/rad] and coulomb [N m] of the line nearest to the curve at these speeds
    marks    (3,) [rad/s] speeds not exceeded in 25, 50, 90 % of the time
    rated    [N m] torque
    share    of rated torque that the law has in this record
    """

    inertia: float
    idle: float
    speeds: np.ndarray
    curve: np.ndarray
    line: tuple[float, float]
    marks: np.ndarray
    rated: float
    share: float


@dataclass(frozen=True)
class Record:
    """(n,) torque [N m] and (n,) measured, every `step` [s]; role: motor_speed or motor_angle."""

    machine: Machine
    excitation: str
    closed: bool
    step: float
    torque: np.ndarray
    measured: np.ndarray
    role: str
    truth: Truth


def parts_of(setup: Setup, law: Law) -> int:
    """Steps of the integrator in a sample, up to twice the rated speed."""
    fastest = law.fastest(setup.machine, 2.0 * setup.machine.rated_speed)
    return max(LEAST_PARTS, int(np.ceil(PARTS_PER_RATE * setup.step * fastest)))


def simulate(setup: Setup, law: Law) -> Run:
    """The machine under its law."""
    machine, e = setup.machine, setup.excitation
    torque, measured, states = kernel.run(
        setup.step, parts_of(setup, law), setup.start, e.mode, e.command, e.speeds, e.angles, e.controller,
        law.code, machine.numbers(), law.numbers(machine), setup.disturbance - setup.load, setup.noise,
        setup.quantum, setup.is_angle)
    if not np.all(np.isfinite(states)):
        raise ArithmeticError(f"the integrator did not finish a sample under {law}")
    return Run(torque + setup.log_noise, measured, states)


def missing_torque(setup: Setup, law: Law, run: Run) -> np.ndarray:
    """(k,) [N m] of the log that the plain machine does not explain, over samples in which it only slides.

    Without the torque noise and the sensor's noise, but with its eccentricity.
    """
    machine, speed, angle = setup.machine, run.states[:, kernel.V], run.states[:, kernel.Q]
    seen = speed
    if law.name == "eccentricity":
        seen = speed * (1.0 + law.strength * np.cos(angle + law.constants["phase"]))
    side = np.sign(speed)
    known = (machine.inertia * np.diff(seen) + machine.viscous * np.diff(angle)) / setup.step
    rest = run.torque + setup.disturbance - known - machine.coulomb * side[:-1] - machine.idle
    return rest[(side[:-1] == side[1:]) & (side[:-1] != 0.0)]


def sized(setup: Setup, law: Law, share: float) -> tuple[Law, float]:
    """(the law with the strength that gives it this share of rated torque, the share that it has)."""
    rated = setup.machine.rated_torque
    if law.name not in MOST:  # "none" has no torque whatever the share
        return replace(law, strength=share * rated), share
    if law.name == "saturation":
        law = replace(law, constants={"peak": float(np.max(np.abs(simulate(setup, Law("none")).torque)))})

    if share == 0.0:
        return law, 0.0

    def share_of(strength: float) -> float:
        trial = replace(law, strength=strength)
        missing = missing_torque(setup, trial, simulate(setup, trial))
        slides = len(missing) > LEAST_SLIDING * len(setup.noise)
        return float(np.sqrt(np.mean(missing**2))) / rated if slides else np.inf

    strength, found = searched(MOST[law.name], share, share_of)
    return replace(law, strength=strength), found


def searched(most: float, share: float, share_of: Callable[[float], float]) -> tuple[float, float]:
    """(the strength up to `most` that gives a share, the share that it gives)."""
    tried: list[tuple[float, float, float]] = []  # how far off; contacts are chaotic, the last may not be nearest
    low, high = most / 1000.0, most
    strength = high
    for _ in range(HALVINGS):
        found = share_of(strength)
        tried.append((abs(found - share), strength, found))
        low, high = (strength, high) if found < share else (low, strength)
        strength = np.sqrt(low * high)
    return min(tried, key=lambda each: each[0])[1:]


def memory_noise(rng: np.random.Generator, n: int, step: float, memory: float) -> np.ndarray:
    """(n,) first-order noise of standard deviation one, stationary; memory [s], 0: white."""
    white = rng.standard_normal(n)
    if memory == 0.0:
        return white
    pole = np.exp(-step / memory)
    before = pole * rng.standard_normal(1)
    return lfilter([np.sqrt(1.0 - pole * pole)], [1.0, -pole], white, zi=before)[0]


def torque_noise(situation: str, rng: np.random.Generator, n: int, step: float, rated: float) -> np.ndarray:
    """(n,) [N m] held over each sample; beside a missing law weak, and white or not."""
    std, memory = {
        "noise-free": (0.0, 0.0), "quiet": (0.0, 0.0),
        "white": (rng.uniform(0.01, 0.03), 0.0),
        "slow": (rng.uniform(0.005, 0.015), rng.uniform(0.2, 1.0)),
        "fast": (rng.uniform(0.01, 0.02), step * rng.uniform(2.0, 12.0)),
        "heavy": (rng.uniform(0.02, 0.04), rng.uniform(0.05, 0.5)),
    }.get(situation, (rng.uniform(0.001, 0.005), rng.choice([0.0, rng.uniform(0.01, 0.3)])))
    return std * rated * memory_noise(rng, n, step, memory)


def prepare(situation: str, law: Law, machine: Machine, number: int, seconds: float,
            rng: np.random.Generator) -> Setup:
    """Excitation, sensor and noise of a record."""
    step = 1.0 / rng.choice(RATES)
    n = int(seconds / step)
    start = np.zeros(kernel.STATES)
    if rng.uniform() < 0.5:
        start[kernel.V] = start[kernel.V2] = machine.rated_speed * rng.uniform(-0.4, 0.4)
    excitation = draw_excitation(EXCITATIONS[number % len(EXCITATIONS)], machine, step, n, start[kernel.V],
                                 law.constants.get("frequency", np.inf), rng)
    is_angle = bool(rng.uniform() < 0.5)
    quantum = 2.0 * np.pi / 2.0 ** rng.integers(12, 19) if is_angle else (
        machine.rated_speed * 10.0 ** rng.uniform(-3.3, -2.4))
    noise = quantum * rng.uniform(0.2, 0.8) * rng.standard_normal(n)
    disturbance = torque_noise(situation, rng, n, step, machine.rated_torque)
    quantum *= float(rng.uniform() < 0.5)
    if situation == "noise-free":
        noise, quantum = 0.0 * noise, 0.0
    nothing = np.zeros(n)
    return Setup(machine, excitation, step, start, disturbance, nothing, nothing, noise, quantum, is_angle)


def load_steps(rng: np.random.Generator, n: int) -> np.ndarray:
    """(n,) a load of one that comes and goes three to six times, of either sign."""
    times = np.sort(rng.integers(0, n, 2 * rng.integers(3, 7)))
    load = np.zeros(n)
    for begin, end in zip(times[::2], times[1::2], strict=True):
        load[begin:end] = rng.choice([-1.0, 1.0])
    return load


def moving(setup: Any, speed_of: Callable[[Any], np.ndarray]) -> Any:
    """The setup with as much torque as it takes to move for most of the time, as one records a drive.

    setup     of any study, with a machine and an excitation
    speed_of  (n,) [rad/s] speeds under a setup
    """
    for _ in range(8):
        speed = speed_of(setup)
        fast = np.abs(speed) > 0.02 * setup.machine.rated_speed
        reversals = np.sum(np.diff(np.sign(speed[fast])) != 0.0)
        if setup.excitation.mode != kernel.OPEN or (fast.mean() > 0.5 and reversals >= 4):
            break
        setup = replace(setup, excitation=setup.excitation.louder(1.4))
    return setup


def arrange(situation: str, share: float, number: int, seed: int,
            seconds: float | None = None) -> tuple[Setup, Law, float]:
    """(all but the law, the law at its strength, the share of rated torque that it has); see `draw`."""
    rng = np.random.default_rng([seed, 2654435769])
    machine, drawn = draw_machine(rng), float(rng.uniform(*SECONDS))
    seconds = drawn if seconds is None else seconds
    law = draw_law(situation if situation in LAWS else "none", machine, seconds, rng)
    setup = prepare(situation, law, machine, number, seconds, rng)
    n, torque = len(setup.noise), share * machine.rated_torque
    if law.name == "load-steps":
        setup = replace(setup, load=torque * load_steps(rng, n))
    if law.name == "log-noise":
        setup = replace(setup, log_noise=torque * rng.standard_normal(n))
    first = Law("none") if law.name in MOST else replace(law, strength=torque)
    setup = moving(setup, lambda trial: simulate(trial, first).states[:, kernel.V])
    return setup, *sized(setup, law, share)


def draw(situation: str, size: str, number: int, seed: int, seconds: float | None = None) -> Record:
    """A record and the truth over the speeds that it visits.

    situation  of RIGHT or LAWS; size: of SIZES, "" where the model is right
    number     counts the excitations through; seed draws all else
    seconds    of the record, instead of a draw from SECONDS
    """
    setup, law, share = arrange(situation, SIZES.get(size, 0.0), number, seed, seconds)
    machine, run = setup.machine, simulate(setup, law)
    visited = visits(run.states[:-1, kernel.V])
    curve, uneven = law.curves(machine, visited.speeds, setup.step * np.flatnonzero(visited.moves))
    idle = machine.idle + float(np.mean(uneven) + np.mean(setup.load))
    truth = Truth(machine.inertia, idle, visited.speeds, curve, nearest_line(visited.speeds, curve), visited.marks,
                  machine.rated_torque, share)
    return Record(machine, EXCITATIONS[number % len(EXCITATIONS)], setup.excitation.mode != kernel.OPEN, setup.step,
                  run.torque, run.measured, "motor_angle" if setup.is_angle else "motor_speed", truth)


@dataclass(frozen=True)
class Visits:
    """The speeds [rad/s] of a record: (n,) whether it moves; (SPEEDS,) and (3,) as in Truth."""

    moves: np.ndarray
    speeds: np.ndarray
    marks: np.ndarray


def visits(speed: np.ndarray) -> Visits:
    """Of (n,) speeds [rad/s]."""
    speed = np.abs(speed)
    moves = speed > 0.01 * np.quantile(speed, 0.995)
    return Visits(moves, np.quantile(speed[moves], (np.arange(SPEEDS) + 0.5) / SPEEDS),
                  np.quantile(speed[moves], [0.25, 0.5, 0.9]))


def nearest_line(speeds: np.ndarray, curve: np.ndarray) -> tuple[float, float]:
    """Viscous [N m s/rad] and coulomb [N m] of the line nearest to a friction curve."""
    viscous, coulomb = np.polyfit(speeds, curve, 1)
    return float(viscous), float(coulomb)
