"""Gains on a record: the simulated response of the tuned loop to the measured load step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivetool.errors import BadRecording, NotEnoughData
from drivetool.identify.estimate import fit_percent
from drivetool.logs import Experiment
from drivetool.tune.simulation.nonlinear import closed_loop, simulate_loop, steady_state
from drivetool.tune.speed_loop import Loop, Settings

# Of steady running before the first step. A choice: fewer give no mean speed and no noise level of the load torque.
MIN_SAMPLES_BEFORE_STEP = 20
COMPARED_ROLES = ("motor_speed", "load_speed", "motor_torque")


@dataclass(frozen=True)
class LoopReplay:
    """Measured and simulated signals of one stretch.

    time                 (n,) [s]
    measured, simulated  role -> (n,)
    fits                 role -> simulation fit [%]; rmse: role -> root mean square error
    load                 (n,) load torque
    """

    time: np.ndarray
    measured: dict[str, np.ndarray]
    simulated: dict[str, np.ndarray]
    fits: dict[str, float]
    rmse: dict[str, float]
    load: np.ndarray


def replay_load_step(loop: Loop, settings: Settings, experiment: Experiment) -> LoopReplay:
    """Simulate the closed loop under the load torque of a record.

    loop        linearised again at the speed of the record
    experiment  load_torque that steps, and motor_speed; other measured roles are compared too. The
                speed reference is assumed constant: the mean motor speed before the first step
    raises      BadRecording: a role is missing; NotEnoughData: no step after steady running
    """
    load = experiment.signal("load_torque", "the replay of a load step")
    speed = experiment.signal("motor_speed", "the replay of a load step")
    first, last = max(experiment.segments, key=lambda s: s[1] - s[0])
    load, speed = load[first:last], speed[first:last]
    begin = _first_load_step(load)
    if begin is None or begin < MIN_SAMPLES_BEFORE_STEP:
        raise NotEnoughData(
            f"a load torque that steps after at least {MIN_SAMPLES_BEFORE_STEP * experiment.step:g} s of steady "
            "running",
            f"none in {experiment.name}" if begin is None else
            f"a step {begin * experiment.step:g} s after the start of {experiment.name}",
            "Record a load step at constant speed reference, with some time before it.")
    reference = float(np.nanmean(speed[:begin]))
    before = float(np.mean(load[:begin]))
    loop = loop.at(reference)
    simulated = _simulate_signals(loop, settings, np.column_stack([np.full(len(load), reference), load]),
                          steady_state(loop, settings, reference, before), experiment)
    measured = {role: experiment.signals[role][first:last] for role in COMPARED_ROLES
                if role in experiment.signals and role in simulated}
    fits, rmse = {}, {}
    for role, y in measured.items():
        known = np.isfinite(y)
        fits[role] = fit_percent(y[known], simulated[role][known])
        rmse[role] = float(np.sqrt(np.mean((y - simulated[role])[known] ** 2)))
    return LoopReplay(experiment.time[first:last], measured,
                      {role: simulated[role] for role in measured}, fits, rmse, load)


def _first_load_step(load: np.ndarray) -> int | None:
    """Sample at which the load torque first leaves its initial level; None if it never does."""
    if len(load) < 2 * MIN_SAMPLES_BEFORE_STEP:
        return None
    centre, noise = np.median(load[:MIN_SAMPLES_BEFORE_STEP]), np.ptp(load[:MIN_SAMPLES_BEFORE_STEP])
    stepped = np.abs(load - centre) > max(3.0 * noise, 0.1 * np.max(np.abs(load - centre)), 1e-12)
    return int(np.argmax(stepped)) if stepped.any() else None


def _simulate_signals(loop: Loop, settings: Settings, inputs: np.ndarray, start: np.ndarray,
                      experiment: Experiment) -> dict[str, np.ndarray]:
    """Signals at the samples; between them the step follows from the fastest pole."""
    step = experiment.step
    fastest = np.abs(np.linalg.eigvals(loop.matrix(settings))).max()
    parts = max(1, int(np.ceil(step * fastest / 0.3)))
    plant = closed_loop(loop, settings, step / parts)
    _, states = simulate_loop(plant, np.repeat(inputs, parts, axis=0), start, step / parts)
    states = states[::parts, :len(start)]
    if experiment.torque_is == "command":
        command = loop.command_rows(loop.wiring.motors[0], *settings.columns)[0]
        torque = states @ command + settings.gain * inputs[:, 0]
    else:
        torque = states @ loop.torque_rows(settings)[0] + loop.direct * settings.gain * inputs[:, 0]
    if not all(np.isfinite(states[-1])):
        raise BadRecording("a stable loop", "an unstable one with these gains",
                           "Check that the gains belong to this drive.")
    n = len(loop.drive.bodies)
    return {"motor_speed": states @ loop.rows["logged_speed"], "load_speed": states[:, n - 1],
            "motor_torque": torque}
