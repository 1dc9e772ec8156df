"""Simulate a machine with known values, as an experiment the estimators take."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from scipy.stats import chi2

from drivetool.check.causes import CAUSES
from drivetool.check.fit import Model, all_samples, fit_from_start
from drivetool.check.search.candidate_fit import CandidateFit, attempt, screen
from drivetool.check.search.prepared_start import reference_model
from drivetool.drive import Drive, one_body, two_mass
from drivetool.identify.estimate import Estimate
from drivetool.identify.setup import Task, roles_of
from drivetool.logs import Experiment
from tests.simulator.experiments import alternating, multisine, steps, trapezoids
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine, at_rest, machine_by_seed, running
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

STEP = 1e-3


def truth(machine: Machine) -> dict[str, float]:
    """The machine's values under the tool's parameter names."""
    bodies = ("motor", "load")[: machine.bodies]
    found = {}
    for field in ("inertia", "viscous", "coulomb", "idle_torque"):
        found |= {f"{b}.{field}": v for b, v in zip(bodies, getattr(machine, field), strict=True)}
    if machine.bodies > 1:
        found |= {f"shaft.{f}": getattr(machine, f)[0] for f in ("stiffness", "damping", "half_gap")}
        for field in ("viscous", "idle_torque"):
            found[f"total.{field}"] = sum(getattr(machine, field))
    return found


def drive_like(machine: Machine, names: list[str], off: float = 0.0, seed: int = 0) -> Drive:
    """A drive whose start values lie +-off (relative) from the truth, signs drawn."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(names))
    values = truth(machine)
    drive = two_mass() if machine.bodies == 2 else one_body()
    return drive.with_values({n: values[n] * (1.0 + off * s) for n, s in zip(names, signs, strict=True)})


def experiment(torque: np.ndarray, speed: np.ndarray, name: str = "simulated", step: float = STEP,
               **more: np.ndarray) -> Experiment:
    """Signals as an experiment with a known torque command."""
    signals = {"motor_torque": np.asarray(torque, float), "motor_speed": np.asarray(speed, float), **more}
    return Experiment(name, "0" * 64, step, 0.0, signals, ((0, len(torque)),), torque_is="command")


def resonance(machine: Machine) -> float:
    """Undamped resonance in Hz; of a longer chain as if all behind its first shaft were stiff."""
    jm, jl = machine.inertia[0], sum(machine.inertia[1:])
    return float(np.sqrt(machine.stiffness[0] * (jm + jl) / (jm * jl)) / 2.0 / np.pi)


def linear_record(machine: Machine, seed: int, duration: float = 6.0, torque_noise: float = 0.003,
                  speed_noise: float = 0.002) -> Experiment:
    """Upward torque steps plus a weak multisine about the resonance, from steady running.

    torque_noise  std per sample over the rated torque; speed_noise: std over the speed that the
                  rated torque gives in a quarter of a second
    """
    rated = machine.rated_torque
    start = running(machine, 20.0)
    f = resonance(machine)
    count = round(duration / 0.8)
    torque = steps(start.torque, [0.08 * rated] * count, (0.6, 1.0), 0.5, STEP, seed)
    torque = torque[: round(duration / STEP)]
    size = len(torque)
    torque = torque + multisine(np.linspace(0.3, 2.0, 9) * f, 0.01 * rated, size * STEP, STEP, seed)[:size]
    noise = white_noise(size, torque_noise * rated, 7 * seed + 1)
    run = simulate_linear(machine, torque, STEP, start, noise)
    scale = rated * 0.25 / sum(machine.inertia)
    return experiment(torque, run.speeds[:, 0] + white_noise(size, speed_noise * scale, 7 * seed + 2))


def reversing_record(machine: Machine, seed: int, duration: float = 10.0, torque_noise: float = 0.002,
                     speed_noise: float = 0.02) -> tuple[Experiment, object]:
    """A drive under a speed controller through many reversals, with a multisine on the torque."""
    rated, total = machine.rated_torque, sum(machine.inertia)
    size = round(duration / STEP)
    top = 0.15 * rated / total
    reference = trapezoids(top, 0.75, 0.35, duration, STEP, seed)[:size]
    f = resonance(machine) if machine.bodies > 1 else 10.0
    excite = multisine(np.linspace(0.2, 2.0, 15) * f, 0.012 * rated, duration, STEP, seed)[:size]
    gain = 6.0 * total
    run = simulate_fast(machine, excite, STEP, at_rest(machine), PI(reference, gain, 2.0 * gain, limit=rated),
                        white_noise(size, torque_noise * rated, 7 * seed + 3),
                        sensor_noise=white_noise(size, speed_noise * top / 10.0, 7 * seed + 4))
    return experiment(run.command, run.measured), run


def joint_error(estimate: Estimate, values: dict[str, float]) -> tuple[float, float]:
    """(normalised squared error of all fitted parameters, its 99.9 % quantile)."""
    names = estimate.covariance.names
    error = np.array([estimate.drive.values[n] - values[n] for n in names])
    square = float(error @ np.linalg.solve(estimate.covariance.matrix, error))
    return square, float(chi2.ppf(0.999, len(names)))


def gap_record(machine: Machine, seed: int, torque_noise: float = 0.002, speed_noise: float = 0.002):
    """Alternating torque steps about steady running: (experiment, trajectory)."""
    rated = machine.rated_torque
    start = running(machine, 40.0)
    period = 4.0 / resonance(machine)
    half = (max(0.15, period), max(0.3, 2.0 * period))
    pairs = int(np.clip(6.0 / (2.0 * np.mean(half)), 4, 12))
    torque = alternating(start.torque, (0.35 * rated, 0.5 * rated), half, pairs, 0.4, STEP, seed)
    size = len(torque)
    run = simulate_fast(machine, torque, STEP, start, None, white_noise(size, torque_noise * rated, 7 * seed + 5))
    scale = rated * 0.25 / sum(machine.inertia)
    speed = run.speeds[:, 0] + white_noise(size, speed_noise * scale, 7 * seed + 6)
    return experiment(torque, speed, "gap"), run


def one_sensor(seed: int, torque_noise: float = 0.002, spikes: Mapping[int, float] = MappingProxyType({}),
               speed_steps: Mapping[int, float] = MappingProxyType({})) -> tuple[Model, float]:
    """(base of a diagnosis of the motor's speed alone, std of the torque noise over that of the sensor).

    torque_noise  std over the rated torque
    spikes        sample -> wrong value of the sensor, over its noise
    speed_steps   sample -> step of the motor's speed by a torque that is not logged, over the sensor's noise
    """
    machine, size = machine_by_seed(seed), 4000
    rated = machine.rated_torque
    torque = multisine(np.linspace(0.05, 2.0, 12) * resonance(machine), 0.1 * rated, size * STEP, STEP, seed)[:size]
    noise = white_noise(size, torque_noise * rated, 3 * seed)
    sensor = 1e-3 * np.abs(simulate_linear(machine, torque, STEP, None, noise).speeds).max()
    noise[list(speed_steps)] += machine.inertia[0] * sensor / STEP * np.array(list(speed_steps.values()))
    run = simulate_linear(machine, torque, STEP, None, noise)
    wrong = white_noise(size, sensor, 3 * seed + 1)
    wrong[list(spikes)] += sensor * np.array(list(spikes.values()))
    record = experiment(torque, run.speeds[:, 0] + wrong)
    free = ("motor.inertia", "load.inertia", "motor.viscous", "load.idle_torque", "shaft.stiffness",
            "shaft.damping")
    drive = drive_like(machine, list(free))
    task = Task(drive, free, roles_of([record], drive), (record,))
    return fit_from_start(task), torque_noise * rated / sensor


def tried(code: str, base: Model) -> CandidateFit:
    """A cause fitted on top of a base, from every start of its own that is worth it."""
    masks = all_samples(base.problem)
    return attempt(screen(CAUSES[code], [reference_model(base)], masks), base, masks)
