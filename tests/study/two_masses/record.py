"""A record of a random two-mass drive, and the truth about it, by situation, size and number.

Everything is drawn from the seed; the same seed gives the same machine in every situation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import bilinear, lfilter

from tests.study.missing_laws.excitation import EXCITATIONS, Excitation, draw_excitation
from tests.study.missing_laws.laws import SIZES
from tests.study.missing_laws.record import (
    LEAST_PARTS,
    LEAST_SLIDING,
    PARTS_PER_RATE,
    load_steps,
    moving,
    nearest_line,
    searched,
    torque_noise,
    visits,
)
from tests.study.two_masses import kernel
from tests.study.two_masses.laws import MOST, Placed, draw_law, half_gap_of, strength_of
from tests.study.two_masses.machine import HALF_GAPS, NAMES, Machine, draw_machine

# Situations in which the model is right, by the torque noise, on the motor but for two; quiet: noise of the sensors
# alone; noise-free: none at all. With a gap its half gap is in the model.
GAP = "gap+"
RIGHT = ("noise-free", "quiet", "white", "slow", "fast", "heavy", "load-white", "load-slow",
         *(f"{GAP}{noise}" for noise in ("quiet", "white", "slow")))
# Laws that are missing besides from a model with a gap.
BEHIND_GAP = tuple(GAP + law for law in ("motor.asymmetry", "motor.stribeck", "load.dry", "load.cogging",
                                         "load.load-steps", "motor.log-noise"))
SECONDS, STEP = 8.0, 1e-3
# Beside the motor's speed or angle; half of all records have no second sensor.
SECOND = (None, None, "load_speed", "shaft_torque")
SHAFT_NOISE = 2e-3  # of rated torque
# Excitations without steps of the torque get sines about the resonance, as one shakes a drive to identify it.
SMOOTH = ("point-to-point", "chirp", "sines", "multisine", "random-speeds")
MULTISINE_BAND, MULTISINE_LINES = (0.4, 1.8), 6  # in resonances


@dataclass(frozen=True)
class Setup:
    """Everything that a run needs but the law: what does not change while a law's strength is sought.

    start: (STATES,)
    disturbance (n, 2) [N m] on motor and load, behind the log; load (n,) [N m] steps against a body
    log_noise   (n,) [N m] on the log
    noise (n,) of the motor's sensor, quantum its step (0: none); second, second_noise: role and (n,) of another
    """

    machine: Machine
    excitation: Excitation
    start: np.ndarray
    disturbance: np.ndarray
    load: np.ndarray
    log_noise: np.ndarray
    noise: np.ndarray
    quantum: float
    is_angle: bool
    second: str | None
    second_noise: np.ndarray


@dataclass(frozen=True)
class Run:
    """(n,) torque [N m] as logged, (n,) motor sensor, (n + 1, STATES) states, (n, 2) [N m] held on both bodies."""

    torque: np.ndarray
    measured: np.ndarray
    states: np.ndarray
    held: np.ndarray


@dataclass(frozen=True)
class Truth:
    """What an estimate is held against.

    motor_inertia, load_inertia [kg m^2] means; stiffness [N m/rad]; half_gap [rad]
    idle      [N m] sum, with the mean of what friction differs by direction and of the load
    speeds    (SPEEDS,) [rad/s] quantiles of the motor's absolute speed while it moves
    curve     (SPEEDS,) [N m] friction of both bodies at these speeds, mean of both directions
    line      viscous [N m s/rad] and coulomb [N m] of the line nearest to the curve at these speeds
    marks     (3,) [rad/s] speeds not exceeded in 25, 50, 90 % of the time
    rated     [N m] torque
    share     of rated torque that the law has in this record, root mean square
    crossings of the gap per second
    """

    motor_inertia: float
    load_inertia: float
    stiffness: float
    half_gap: float
    idle: float
    speeds: np.ndarray
    curve: np.ndarray
    line: tuple[float, float]
    marks: np.ndarray
    rated: float
    share: float
    crossings: float


@dataclass(frozen=True)
class Record:
    """channels: role -> (n,) values, every STEP; gap: whether the half gap is in the model."""

    machine: Machine
    excitation: str
    closed: bool
    channels: Mapping[str, np.ndarray]
    gap: bool
    truth: Truth


def parts_of(setup: Setup, law: Placed) -> int:
    """Steps of the integrator in a sample."""
    return max(LEAST_PARTS, int(np.ceil(PARTS_PER_RATE * STEP * law.fastest(setup.machine))))


def simulate(setup: Setup, law: Placed) -> Run:
    """The machine under its law."""
    machine, e = setup.machine, setup.excitation
    extra = setup.disturbance.copy()
    extra[:, law.body] -= setup.load
    torque, measured, states = kernel.run(
        STEP, parts_of(setup, law), setup.start, e.mode, e.command, e.speeds, e.angles, e.controller, law.code,
        law.body, machine.numbers(), law.numbers(machine), extra, setup.noise, setup.quantum, setup.is_angle)
    if not np.all(np.isfinite(states)):
        raise ArithmeticError(f"the integrator did not finish a sample under {law}")
    extra[:, 0] += torque
    return Run(torque + setup.log_noise, measured, states, extra)


def observed(setup: Setup, law: Placed, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """((n,) torque [N m] of the shaft, (n,) [N m] that the model lacks), see `kernel.observed`.

    What it lacks acts on the body of the law; for a gap on both, for the motor's sensor on the motor.
    """
    machine, y, name = setup.machine, run.states[:-1], law.law.name
    shaft, missing = kernel.observed(run.states, STEP, run.held, law.code, law.body, machine.numbers(),
                                     law.numbers(machine)).T
    if name in ("load-steps", "log-noise"):
        missing = setup.load + setup.log_noise
    elif name == "eccentricity":
        error = law.law.strength * y[:, kernel.VM] * np.cos(y[:, kernel.QM] + law.law.constants["phase"])
        missing = torque_behind(machine, error)
    elif name == "gap":
        stiffness, damping = (machine.values[f"shaft.{part}"] for part in ("stiffness", "damping"))
        missing = stiffness * y[:, kernel.TWIST] + damping * (y[:, kernel.VM] - y[:, kernel.VL]) - shaft
    return shaft, missing


def torque_behind(machine: Machine, speed: np.ndarray) -> np.ndarray:
    """(n,) [N m] that the motor would need for a speed, by its own inertia and the load's on the shaft."""
    v = machine.values
    load = [v["load.inertia"], v["load.viscous"]]
    passing = [v["shaft.damping"], v["shaft.stiffness"]]
    through = np.polymul(load, passing)
    along = np.polyadd([v["load.inertia"], v["load.viscous"], 0.0], passing)
    behind = lfilter(*bilinear(through, along, 1.0 / STEP), speed)
    return v["motor.inertia"] * np.gradient(speed, STEP) + v["motor.viscous"] * speed + behind


def root_mean_square(values: np.ndarray) -> float:
    """Of (n,) values."""
    return float(np.sqrt(np.mean(values**2)))


def sized(setup: Setup, law: Placed, size: str) -> Placed:
    """The law with the strength of a size."""
    machine, name = setup.machine, law.law.name
    rated = machine.rated_torque
    if name not in MOST or size == "":
        return law.at(strength_of(name, size, machine))

    def share_of(strength: float) -> float:
        trial = law.at(strength)
        run = simulate(setup, trial)
        moves = np.abs(run.states[:, kernel.VM]) > 0.02 * machine.rated_speed
        return root_mean_square(observed(setup, trial, run)[1]) / rated if moves.mean() > LEAST_SLIDING else np.inf

    unit = rated / machine.rated_speed**2 if name == "drag" else 1.0
    return law.at(searched(MOST[name] * unit, SIZES[size], share_of)[0])


def with_multisine(excitation: Excitation, machine: Machine, rng: np.random.Generator) -> Excitation:
    """The excitation with sines about the resonance on its torque."""
    n = len(excitation.command)
    friction = machine.rigid.coulomb + 0.4 * machine.rated_speed * machine.rigid.viscous
    frequency = machine.resonance * rng.uniform(*MULTISINE_BAND, MULTISINE_LINES)
    phase = 2.0 * np.pi * rng.uniform(size=MULTISINE_LINES)
    waves = np.sin(2.0 * np.pi * STEP * np.arange(n)[:, None] * frequency + phase).sum(axis=1)
    return replace(excitation, command=excitation.command + friction * rng.uniform(0.15, 0.4) * waves)


def prepare(noise: str, machine: Machine, number: int, n: int, rng: np.random.Generator) -> Setup:
    """Excitation, sensors and noise of a record of n samples."""
    start = np.zeros(kernel.STATES)
    if rng.uniform() < 0.5:
        start[[kernel.VM, kernel.VL, kernel.V3]] = machine.rated_speed * rng.uniform(-0.4, 0.4)
    name = EXCITATIONS[number % len(EXCITATIONS)]
    excitation = draw_excitation(name, machine.rigid, STEP, n, start[kernel.VM], machine.antiresonance, rng)
    if name in SMOOTH:
        excitation = with_multisine(excitation, machine, rng)
    is_angle = bool(rng.uniform() < 0.5)
    quantum = 2.0 * np.pi / 2.0 ** rng.integers(12, 19) if is_angle else (
        machine.rated_speed * 10.0 ** rng.uniform(-3.3, -2.4))
    sensor = quantum * rng.uniform(0.2, 0.8) * rng.standard_normal(n)
    quantum *= float(rng.uniform() < 0.5)
    second = SECOND[rng.integers(len(SECOND))]
    unit = SHAFT_NOISE * machine.rated_torque if second == "shaft_torque" else (
        machine.rated_speed * 10.0 ** rng.uniform(-3.3, -2.4))
    second_noise = unit * rng.standard_normal(n)
    disturbance = np.zeros((n, 2))
    at_load = noise.startswith("load-")
    kind = noise.removeprefix("load-") if at_load else noise
    disturbance[:, int(at_load)] = torque_noise(kind, rng, n, STEP, machine.rated_torque)
    if noise == "noise-free":
        sensor, quantum, second_noise = 0.0 * sensor, 0.0, 0.0 * second_noise
    nothing = np.zeros(n)
    return Setup(machine, excitation, start, disturbance, nothing, nothing, sensor, quantum, is_angle, second,
                 second_noise)


def arrange(situation: str, size: str, number: int, seed: int, seconds: float = SECONDS) -> tuple[Setup, Placed]:
    """(all but the law, the law at its strength); see `draw`."""
    rng = np.random.default_rng([seed, 2971215073])
    machine = draw_machine(rng)
    drawn = machine.rated_twist * np.exp(rng.uniform(*np.log([HALF_GAPS["S"], HALF_GAPS["L"]])))
    plain = situation.removeprefix(GAP)
    gap = drawn if situation.startswith(GAP) else half_gap_of(size, machine) if plain == "shaft.gap" else 0.0
    machine = replace(machine, values={**machine.values, "shaft.half_gap": float(gap)})
    law = draw_law(plain, machine, seconds, rng)
    setup = prepare(plain, machine, number, int(seconds / STEP), rng)
    n, torque = len(setup.noise), SIZES.get(size, 0.0) * machine.rated_torque
    if law.law.name == "load-steps":
        setup = replace(setup, load=torque * load_steps(rng, n))
    if law.law.name == "log-noise":
        setup = replace(setup, log_noise=torque * rng.standard_normal(n))
    first = law if law.law.name in MOST else sized(setup, law, size)
    setup = moving(setup, lambda trial: simulate(trial, first).states[:, kernel.VM])
    return setup, sized(setup, law, size)


def draw(situation: str, size: str, number: int, seed: int, seconds: float = SECONDS) -> Record:
    """A record and the truth over the speeds that it visits.

    situation  of RIGHT, LAWS or BEHIND_GAP; size: of SIZES, "" where the model is right
    number     counts the excitations through; seed draws all else
    """
    setup, law = arrange(situation, size, number, seed, seconds)
    machine, run = setup.machine, simulate(setup, law)
    channels = {"motor_torque": run.torque, "motor_angle" if setup.is_angle else "motor_speed": run.measured}
    if setup.second == "load_speed":
        channels["load_speed"] = run.states[:-1, kernel.VL] + setup.second_noise
    elif setup.second == "shaft_torque":
        channels["shaft_torque"] = observed(setup, law, run)[0] + setup.second_noise
    return Record(machine, EXCITATIONS[number % len(EXCITATIONS)], setup.excitation.mode != kernel.OPEN, channels,
                  situation.startswith(GAP), truth_of(setup, law, run))


def truth_of(setup: Setup, law: Placed, run: Run) -> Truth:
    """The truth about a run."""
    machine, values = setup.machine, setup.machine.values
    visited = visits(run.states[:-1, kernel.VM])
    curve, uneven = law.curves(machine, visited.speeds, STEP * np.flatnonzero(visited.moves))
    share = root_mean_square(observed(setup, law, run)[1]) / machine.rated_torque
    return Truth(*(values[name] for name in (*NAMES[:3], "shaft.half_gap")),
                 machine.rigid.idle + float(np.mean(uneven) + np.mean(setup.load)), visited.speeds, curve,
                 nearest_line(visited.speeds, curve), visited.marks, machine.rated_torque, share,
                 gap_crossings(machine, run.states) / (STEP * len(run.torque)))


def gap_crossings(machine: Machine, states: np.ndarray) -> int:
    """How often the gap's contact changed its side."""
    v = machine.values
    z = states[:, kernel.TWIST] + v["shaft.damping"] / v["shaft.stiffness"] * (
        states[:, kernel.VM] - states[:, kernel.VL])
    sides = np.sign(z[np.abs(z) > v["shaft.half_gap"]])
    return int(np.sum(sides[1:] != sides[:-1])) if v["shaft.half_gap"] > 0.0 else 0
