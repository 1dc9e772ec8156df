"""Write the fixtures: python -m tests.make_fixtures fixtures

Records of simulated machines as .parquet and .mcap, and what is true of them beside.
The same bytes on every run. A `_holdout` twin is the same experiment with other seeds and levels.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests import coast_fixtures, light_rigs
from tests.light_rigs import TABLE
from tests.simulator import experiments
from tests.simulator.controllers import PositionPD, SpeedPI
from tests.simulator.machine import Machine, State, running
from tests.simulator.papers import (
    BUS_STEP,
    ROBOT,
    ROBOT_GAP,
    ROBOT_STEP,
    bus_acceleration,
    bus_held,
    bus_run,
    robot_record,
)
from tests.simulator.records import Channels, quantise, white_noise, write_mcap, write_parquet
from tests.simulator.simulate import Sensor, Trajectory, simulate

STEP = 1e-3
# The logger's and the command's resolution: far below the noise, and it keeps the files small.
TORQUE_RESOLUTION, SPEED_RESOLUTION = 1e-3, 1e-5

RIG = Machine(
    inertia=(0.587, 5.179), viscous=(0.000176, 0.0017), idle_torque=(0.0, 15.14), stiffness=(3310.0,),
    damping=(3.115,), half_gap=(0.07505,), rated_torque=200.0)
REVERSING = Machine(
    inertia=(0.6, 5.2), viscous=(0.8, 0.0), coulomb=(5.0, 0.0), idle_torque=(0.0, 8.0), stiffness=(3300.0,),
    damping=(3.1,), half_gap=(0.010,), rated_torque=60.0)
AXIS = Machine(inertia=(95.0,), viscous=(203.0,), coulomb=(20.4,), idle_torque=(-3.2,))


@dataclass(frozen=True)
class Noise:
    """Standard deviations per sample: torque between command and motor, and of the sensor."""

    torque: float
    sensor: float
    resolution: float


DRIVE_NOISE = Noise(0.3, 0.02, SPEED_RESOLUTION)
AXIS_NOISE = Noise(0.2, 0.0, 1e-6)


def drive_record(machine: Machine, torque: np.ndarray, start: State, seed: int,
                 controller: SpeedPI | None = None) -> Trajectory:
    """A record of motor torque and motor speed; two noises from one seed."""
    torque_seed, speed_seed = np.random.SeedSequence(seed).spawn(2)
    sensor = Sensor("speed", white_noise(len(torque), DRIVE_NOISE.sensor, speed_seed), SPEED_RESOLUTION)
    return simulate(machine, torque, STEP, start, controller,
                    white_noise(len(torque), DRIVE_NOISE.torque, torque_seed), sensor=sensor)


def rig_steady(seed: int, levels: tuple[float, ...]) -> Trajectory:
    """Speed controller on, set points of one sign; viscous friction is tiny, so it takes long."""
    reference = experiments.staircase(levels, dwell=8.0, ramp=1.5, step=STEP)
    start = running(RIG, levels[0])
    controller = SpeedPI(reference, 60.0, 200.0, STEP, start=start.torque, limit=200.0,
                         resolution=TORQUE_RESOLUTION)
    return drive_record(RIG, np.zeros_like(reference), start, seed, controller)


def rig_steps(seed: int, speed: float, sizes: tuple[float, ...]) -> Trajectory:
    """Open loop from constant speed, torque only ever upwards: the gap stays closed."""
    start = running(RIG, speed)
    torque = experiments.steps(round(start.torque, 3), sizes, (0.5, 1.0), 0.5, STEP, seed)
    return drive_record(RIG, torque, start, seed)


def rig_gap(seed: int, speed: float, amplitude: tuple[float, float]) -> Trajectory:
    """Open loop, torque steps about the idle torque that reverse the shaft torque."""
    start = running(RIG, speed)
    torque = experiments.alternating(start.torque, amplitude, (0.25, 0.5), 11, 0.4, STEP, seed)
    return drive_record(RIG, np.round(torque, 3), start, seed)


def reversing_moves(seed: int, largest: float) -> Trajectory:
    """Closed speed loop on trapezoids of both directions with a torque multisine on top."""
    duration = 12.0
    reference = experiments.trapezoids(largest, 0.75, 0.35, duration, STEP, seed)
    ahead = experiments.multisine(np.arange(2.0, 26.0), 0.7, duration, STEP, seed)
    start = running(REVERSING, 0.0)
    controller = SpeedPI(reference, 20.0, 40.0, STEP, ahead, start.torque, 60.0, TORQUE_RESOLUTION)
    return drive_record(REVERSING, np.zeros_like(reference), start, seed, controller)


def reversing_steady(seed: int, levels: tuple[float, ...]) -> Trajectory:
    """Set points of both directions, which distinguish Coulomb friction from idle torque."""
    reference = experiments.staircase(levels, dwell=3.0, ramp=1.0, step=STEP)
    start = running(REVERSING, levels[0])
    controller = SpeedPI(reference, 60.0, 200.0, STEP, None, start.torque, 60.0, TORQUE_RESOLUTION)
    return drive_record(REVERSING, np.zeros_like(reference), start, seed, controller)


def axis_moves(seed: int, distance: float) -> Trajectory:
    """Linear axis under a position controller, out and back."""
    reference = experiments.moves(distance, 0.4, 3.0, 0.25, 12.0, STEP, seed)
    controller = PositionPD(reference, 9.0e4, 4.5e3, STEP, 600.0, limit=800.0, resolution=TORQUE_RESOLUTION)
    noise = white_noise(len(reference), AXIS_NOISE.torque, seed)
    return simulate(AXIS, np.zeros_like(reference), STEP, None, controller, noise,
                    sensor=Sensor("angle", None, AXIS_NOISE.resolution))


RECORDS = {
    "rig": {
        "steady": lambda: rig_steady(101, (20.0, 60.0, 100.0, 140.0, 120.0, 80.0, 40.0)),
        "steps": lambda: rig_steps(102, 30.0, (12.0, 15.0, 10.0, 18.0, 14.0, 20.0, 12.0, 16.0)),
        "steps_holdout": lambda: rig_steps(103, 45.0, (16.0, 11.0, 14.0, 10.0, 19.0, 13.0, 17.0, 12.0)),
        "gap": lambda: rig_gap(104, 60.0, (45.0, 75.0)),
        "gap_holdout": lambda: rig_gap(105, 80.0, (40.0, 85.0)),
    },
    "reversing": {
        "steady": lambda: reversing_steady(201, (2.0, 6.0, 10.0, 4.0, -4.0, -10.0, -6.0, -2.0)),
        "moves": lambda: reversing_moves(202, 6.0),
        "moves_holdout": lambda: reversing_moves(203, 5.0),
    },
    "axis": {
        "moves": lambda: axis_moves(301, 0.30),
        "moves_holdout": lambda: axis_moves(302, 0.25),
    },
}


# The light rig of Table 6.2 with its gap, damped in the gap too, and with a shaft-torque sensor.
LIGHT_RIG = replace(TABLE, half_gap=(0.156,), damping=(0.863,), law="always")
LIGHT_RESOLUTION = {"Nm": 1e-3, "rad/s": 1e-4}


def light_channels(torque: np.ndarray, speed: float, seed: int) -> Channels:
    """Open loop from a constant speed, rounded as a logger does."""
    return logged(light_rigs.channels(LIGHT_RIG, np.round(torque, 3), speed, seed, light_rigs.Sensors()))


def logged(record: Channels) -> Channels:
    """The channels in steps of the logger's resolution."""
    return {name: (quantise(values, LIGHT_RESOLUTION[unit]), unit) for name, (values, unit) in record.items()}


def light_steps(seed: int, speed: float, sizes: tuple[float, ...]) -> Channels:
    """Torque only ever upwards: the gap stays closed."""
    base = running(LIGHT_RIG, speed).torque
    return light_channels(experiments.steps(round(base, 3), sizes, (0.3, 0.6), 0.5, STEP, seed), speed, seed)


def light_gap(seed: int, speed: float, amplitude: tuple[float, float]) -> Channels:
    """Torque steps of both signs: the shaft crosses its gap."""
    base = running(LIGHT_RIG, speed).torque
    return light_channels(experiments.alternating(base, amplitude, (0.25, 0.5), 11, 0.4, STEP, seed), speed, seed)


LIGHT_RECORDS = {
    "steady": lambda: logged(light_rigs.steady_record(LIGHT_RIG, 601)),
    "steps": lambda: light_steps(602, 105.0, (30.0, 40.0, 25.0, 35.0, 30.0, 45.0, 25.0, 30.0)),
    "gap": lambda: light_gap(603, 110.0, (40.0, 80.0)),
    "gap_holdout": lambda: light_gap(604, 110.0, (30.0, 90.0)),
}

# Records of the literature, as Parquet only: (channels, sample interval).
PAPERS = {
    "robot": {
        f"{name}_{kind}": (lambda m=machine, k=wave, s=size, n=seed: (robot_record(m, k, s, n), ROBOT_STEP))
        for kind, machine, shift in (("gap", ROBOT_GAP, 0), ("linear", ROBOT, 10))
        for name, wave, size, seed in (
            ("chirp", "chirp", 15.5, 401 + shift), ("low", "multisine", 7.7, 402 + shift),
            ("high", "multisine", 16.5, 403 + shift))},
    "bus": {
        **{f"{kind}{i}": (lambda k=kind, n=seed: (bus_run(k, n), BUS_STEP))
           for kind, seeds in (("prbs", (501, 502)), ("chirp", (503, 504)), ("sines", (505, 506)))
           for i, seed in enumerate(seeds, 1)},
        "held": lambda: (bus_held(507), BUS_STEP),
        "acceleration": lambda: (bus_acceleration(508), BUS_STEP),
        "uphill": lambda: (bus_acceleration(509, 0.005), BUS_STEP),
        "downhill": lambda: (bus_acceleration(510, -0.005), BUS_STEP)},
}


def channels(room: str, run: Trajectory) -> Channels:
    """What the logger wrote: the command, and the sensor."""
    if room == "axis":
        return {"motor_torque": (run.command, "N"), "motor_angle": (run.measured, "m")}
    return {"motor_torque": (run.command, "Nm"), "motor_speed": (run.measured, "rad/s")}


def truth(machine: Machine, noise: Noise, torque_unit: str, motion_unit: str, sensor: str) -> str:
    """YAML text of the true values under drivetool's parameter names."""
    t, q = torque_unit, motion_unit
    bodies, rows = ("motor", "load")[:machine.bodies], []
    units = {"inertia": f"{t} s^2/{q}", "viscous": f"{t} s/{q}", "coulomb": t, "idle_torque": t}
    for i, body in enumerate(bodies):
        rows += [(f"{body}.{name}", getattr(machine, name)[i], unit) for name, unit in units.items()]
    shaft = {"stiffness": f"{t}/{q}", "damping": f"{t} s/{q}", "half_gap": q}
    for _ in machine.stiffness:
        rows += [(f"shaft.{name}", getattr(machine, name)[0], unit) for name, unit in shaft.items()]
    sensor_unit = f"{q}/s" if sensor == "motor_speed" else q
    lines = [f"# True values of the simulated machine; damping law: {machine.law}", "parameters:"]
    lines += [f"  {name}: {{value: {value!r}, unit: {unit}}}" for name, value, unit in rows]
    lines += [
        "noise:  # standard deviation per sample; the logged torque is the command",
        f"  motor_torque: {{std: {noise.torque!r}, unit: {t}}}",
        f"  {sensor}: {{std: {noise.sensor!r}, resolution: {noise.resolution:.6f}, unit: {sensor_unit}}}",
        f"sampling: {{value: {STEP!r}, unit: s}}", ""]
    return "\n".join(lines)


BOTH_FORMATS = ("held", "acceleration", "uphill", "downhill")
TRUTHS = {
    "rig": (RIG, DRIVE_NOISE, "Nm", "rad", "motor_speed"),
    "reversing": (REVERSING, DRIVE_NOISE, "Nm", "rad", "motor_speed"),
    "axis": (AXIS, AXIS_NOISE, "N", "m", "motor_angle"),
}


def make(folder: Path) -> None:
    """Write every record and truth.yaml of every machine below `folder`."""
    for room, records in RECORDS.items():
        (folder / room).mkdir(parents=True, exist_ok=True)
        (folder / room / "truth.yaml").write_text(truth(*TRUTHS[room]))
        for name, run in records.items():
            values = channels(room, run())
            write_parquet(folder / room / f"{name}.parquet", values, STEP)
            write_mcap(folder / room / f"{name}.mcap", values, STEP)
            print(f"{room}/{name}: {len(values['motor_torque'][0]) * STEP:g} s", file=sys.stderr)
    (folder / "light").mkdir(parents=True, exist_ok=True)
    (folder / "light" / "truth.yaml").write_text(truth(LIGHT_RIG, DRIVE_NOISE, "Nm", "rad", "motor_speed"))
    for name, record in LIGHT_RECORDS.items():
        values = record()
        write_parquet(folder / "light" / f"{name}.parquet", values, STEP)
        write_mcap(folder / "light" / f"{name}.mcap", values, STEP)
        print(f"light/{name}: {len(values['motor_torque'][0]) * STEP:g} s", file=sys.stderr)
    for room, records in PAPERS.items():
        (folder / room).mkdir(parents=True, exist_ok=True)
        for name, record in records.items():
            values, step = record()
            write_parquet(folder / room / f"{name}.parquet", values, step)
            if name in BOTH_FORMATS:
                write_mcap(folder / room / f"{name}.mcap", values, step)
            print(f"{room}/{name}: {len(values['motor_torque'][0]) * step:g} s", file=sys.stderr)
    coast_fixtures.make(folder / "coast")


if __name__ == "__main__":
    make(Path(sys.argv[1] if len(sys.argv) > 1 else "fixtures"))
