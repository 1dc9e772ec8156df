"""A record of a case's machine, or of a similar one, that no kind of hidden effect makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.hidden.case import Case
from tests.hidden.profiles import STEP, Profile
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine
from tests.simulator.records import write_parquet


def write_record(folder: Path, case: Case, commands: Profile, name: str = "record", machine: Machine | None = None,
        load: np.ndarray | None = None, seed: int | None = None) -> Path:
    """The file of a record of the case's noise and sensors along a profile.

    machine  instead of the case's; sensors of the load are on its last body
    load     (n,) torque on its last body
    """
    machine, rated = machine or case.rig.machine, case.rig.rated
    rng = np.random.default_rng(case.arguments["seed"] if seed is None else seed)
    size = len(commands.torque)
    noise = {role: std * rng.standard_normal(size) for role, std in case.noise.sensors.items()}
    speed_noise = noise.get("motor_speed", np.zeros(size))
    run = simulate_fast(machine, commands.torque, STEP, commands.start, commands.controller,
                        0.0015 * rated * rng.standard_normal(size), load_torque=load, sensor_noise=speed_noise)
    clean = {"motor_speed": run.measured - speed_noise, "load_speed": run.speeds[:, -1]}
    path = Path(folder) / f"{name}.parquet"
    write_parquet(path, {"motor_torque": (run.command, "Nm")} | {
        role: (clean[role] + own, "rad/s") for role, own in noise.items()}, STEP)
    return path
