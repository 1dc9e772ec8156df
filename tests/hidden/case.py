"""A case: records of a machine with hidden effects, and the label that says which."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.hidden.effects import CODES, KINDS, HiddenEffect, Logger, hide, nominal_speed_noise
from tests.hidden.profiles import STEP, profile
from tests.hidden.rigs import Rig, rig_by_seed
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine
from tests.simulator.records import write_parquet
from tests.simulator.simulate import Trajectory

ROLES = ("motor_speed", "motor_angle", "shaft_torque", "load_speed", "load_angle")
# (torque, sensor) noise over nominal.
LEVELS = {"nominal": (1.0, 1.0), "loud": (10.0, 5.0), "quiet": (0.1, 0.1), "none": (0.0, 0.0)}


@dataclass(frozen=True)
class Noise:
    """Standard deviations per sample.

    torque    [Nm] white, enters the machine, is not logged
    coloured  [Nm] the same, with a memory of `memory` samples
    sensors   role -> in its unit
    """

    torque: float
    coloured: float
    memory: float
    sensors: Mapping[str, float]


@dataclass(frozen=True)
class Record:
    """One record of a case.

    name      of its file, without ending
    run       what happened
    logged    role -> (n,) what the logger wrote, motor_torque first
    noise     role -> (n,) sensor noise in it; "torque" -> what entered the machine
    seed      of everything random in it
    """

    name: str
    run: Trajectory
    logged: Mapping[str, np.ndarray]
    noise: Mapping[str, np.ndarray]
    seed: tuple[int, ...]


@dataclass(frozen=True)
class Case:
    """Everything about one case; only `write` says what a tool may see of it.

    rig       the machine without its hidden effects
    machine   with them, and what its logger does
    hidden    the effects, in the requested order
    records   to work on; holdout: of the same machine, for the gain
    arguments the arguments it was made with
    """

    rig: Rig
    machine: Machine
    logger: Logger
    hidden: tuple[HiddenEffect, ...]
    noise: Noise
    records: tuple[Record, ...]
    holdout: tuple[Record, ...]
    arguments: Mapping[str, object]

    def write(self, folder: Path, labels: Path, visibility: bool = True) -> tuple[list[Path], list[Path]]:
        """Record files into `folder`, and label.json into `labels`, which no tool reads.

        returns  (record files, held-out files)
        """
        labels = Path(labels)
        labels.mkdir(parents=True, exist_ok=True)
        (labels / "label.json").write_text(json.dumps(self.label(visibility), indent=1) + "\n")
        return self.write_records(folder)

    def write_records(self, folder: Path) -> tuple[list[Path], list[Path]]:
        """Record files into `folder` alone: (to work on, held out)."""
        folder, written = Path(folder), ([], [])
        folder.mkdir(parents=True, exist_ok=True)
        for records, found in zip((self.records, self.holdout), written, strict=True):
            for record in records:
                path = folder / f"{record.name}.parquet"
                write_parquet(path, self.channels(record), STEP)
                found.append(path)
        return written

    def channels(self, record: Record):
        """Role -> (values, unit)."""
        torque, motion = self.rig.units
        units = {"torque": torque, "speed": f"{motion}/s", "angle": motion}
        return {role: (values, units[role.rpartition("_")[2]]) for role, values in record.logged.items()}

    def label(self, visibility: bool = True) -> dict:
        """What is true, as plain values: codes, sizes, parameters, visibility, the machine."""
        from tests.hidden.start import plain_values
        from tests.hidden.visibility import visible

        label = {
            "causes": [CODES[h.code] for h in self.hidden],
            "effects": [{"code": CODES[h.code], "kind": h.code, "size": h.size,
                         "size_is": KINDS[h.code].size, "truth": dict(h.truth)} for h in self.hidden],
            "plain": plain_values(self.rig), "arguments": dict(self.arguments)}
        if visibility:
            label["visibility"] = {
                "all": visible(self, ()).number if self.hidden else 0.0,
                "each": [visible(self, tuple(g for g in self.hidden if g is not h)).number
                         for h in self.hidden] if len(self.hidden) > 1 else []}
        return label


def make_case(effects: str | Sequence[str], machine_seed: int, record: str = "reversing",
              sensors: Sequence[str] = ("motor_speed",), noise: str = "nominal",
              size: float | Mapping[str, float] | None = None, seed: int = 0, *, bodies: int = 2,
              linear: bool = False, records: int = 1, coloured: float = 0.0, duration: float = 12.0,
              coulomb: Mapping[int, float] | None = None) -> Case:
    """Records of a machine with hidden effects; the same arguments give the same bytes.

    effects       code or codes of `effects.KINDS`; empty or "none" for nothing
    machine_seed  which machine; effect values that are no sizes are drawn by it and `seed`
    record        kind of experiment, see `profiles`
    sensors       roles that are logged beside motor_torque; what an effect needs is added
    noise         level: nominal, loud, quiet, none
    size          of the one effect, or code -> size; None or missing for the usual
    seed          of experiment and noise
    records       how many to work on; there is one more, held out
    coloured      torque noise with memory, std over that of the white
    coulomb       body -> share of rated torque that the plain fit knows of; effects add their own
    raises        ValueError: an unknown word, or an effect that this machine cannot have
    """
    codes = [] if effects in ("none", "", (), []) else [effects] if isinstance(effects, str) else list(effects)
    for code in codes:
        if code not in KINDS:
            raise ValueError(f"effect: wanted one of {', '.join(KINDS)}, found {code!r}")
    known = dict(coulomb or {})
    for code in codes:
        known |= KINDS[code].coulomb
        sensors = [*sensors, *(options[0] for options in KINDS[code].needs)]
    sensors = tuple(role for role in ROLES if role in sensors)
    if bodies == 1 and set(sensors) - {"motor_speed", "motor_angle"}:
        raise ValueError(f"one body: wanted sensors of the motor, found {', '.join(sensors)}")
    rig = rig_by_seed(machine_seed, bodies, linear, known, duration)
    machine, logger, hidden = add_effects(codes, rig, size, machine_seed + 1000003 * seed)
    noise_levels = noise_of(rig, sensors, noise, coloured)
    working_records = [record_of(f"record{i + 1}", rig, machine, logger, noise_levels, record, [seed, i])
            for i in range(records)]
    holdout = record_of("holdout", rig, machine, logger, noise_levels, record, [seed, 10**6])
    arguments = {"effects": codes, "machine_seed": machine_seed, "record": record, "sensors": list(sensors),
                 "noise": noise, "seed": seed, "bodies": bodies, "linear": linear, "records": records,
                 "coloured": coloured, "duration": duration}
    return Case(rig, machine, logger, hidden, noise_levels, tuple(working_records), (holdout,), arguments)


def add_effects(codes: Sequence[str], rig: Rig, size, seed: int, start: Machine | None = None):
    """(machine, logger, (Hiding, ...)) with all the effects; a third mass comes last."""
    machine, logger, found = start or rig.machine, Logger(), {}
    for code in sorted(codes, key=lambda code: code == "third-mass"):
        each = size.get(code) if isinstance(size, Mapping) else size
        found[code] = hide(code, rig, machine, logger, each, seed)
        machine, logger = found[code].machine, found[code].logger
    return machine, logger, tuple(found[code] for code in codes)


def noise_of(rig: Rig, sensors: Sequence[str], level: str, coloured: float = 0.0) -> Noise:
    """Nominal is 0.02 rad/s and 0.3 Nm on a machine of 200 Nm and 5.766 kg m^2."""
    if level not in LEVELS:
        raise ValueError(f"noise: wanted one of {', '.join(LEVELS)}, found {level!r}")
    torque, sensor = LEVELS[level]
    speed, white = sensor * nominal_speed_noise(rig), torque * 0.0015 * rig.rated
    # An angle is about as good as a speed at the frequencies of 15 Hz; a torque sensor has 0.1 %.
    sizes = {"speed": speed, "angle": 0.01 * speed, "torque": sensor * 0.001 * rig.rated}
    return Noise(white, coloured * white, 20.0, {role: sizes[role.rpartition("_")[2]] for role in sensors})


def record_of(name: str, rig: Rig, machine: Machine, logger: Logger, noise: Noise, kind: str,
              seed: Sequence[int]) -> Record:
    """Make the experiment on the true machine and log it."""
    plan = profile(kind, rig, int(np.random.SeedSequence(seed).generate_state(1)[0]))
    streams = np.random.default_rng([*seed, 15485863]).spawn(3)
    size = len(plan.torque)
    disturbance = noise.torque * streams[0].standard_normal(size)
    disturbance += noise.coloured * _coloured_noise(streams[0].standard_normal(size), noise.memory)
    draws = {role: streams[1].standard_normal(size) for role in ROLES}
    noises = {role: std * draws[role] for role, std in noise.sensors.items()}
    start = plan.start
    if machine.bodies > rig.machine.bodies:
        start = replace(start, speeds=(*start.speeds, start.speeds[-1]), twists=(*start.twists, 0.0))
    speed_noise = noises.get("motor_speed", nominal_speed_noise(rig) * draws["motor_speed"])
    run = simulate_fast(machine, plan.torque, STEP, start, plan.controller, disturbance,
                        sensor_noise=speed_noise)
    clean = {"motor_speed": run.measured - speed_noise, **sensors_of(run, rig.machine.bodies)}
    logged = {"motor_torque": run.command} | {role: clean[role] + noises[role] for role in noises}
    logged = logged_values(logger, logged, streams[2])
    return Record(name, run, logged, {**noises, "torque": disturbance}, tuple(seed))


def sensors_of(run: Trajectory, bodies: int) -> dict[str, np.ndarray]:
    """Role -> (n,) true values; a mass beyond the known bodies has no sensor."""
    found = {"motor_angle": run.angles[:, 0]}
    if bodies > 1:
        found |= {"shaft_torque": run.shaft_torques[:, 0], "load_speed": run.speeds[:, bodies - 1],
                  "load_angle": run.angles[:, bodies - 1]}
    return found


def logged_values(logger: Logger, values: Mapping[str, np.ndarray], rng) -> dict[str, np.ndarray]:
    """What the logger makes of the sensors' values."""
    found = {}
    for role, signal in values.items():
        logged = logger.scale.get(role, 1.0) * (signal + logger.offset.get(role, 0.0))
        if role in logger.resolution:
            logged = np.rint(logged / logger.resolution[role]) * logger.resolution[role]
        if role in logger.spikes:
            count, height = logger.spikes[role]
            at = rng.choice(np.arange(200, len(signal) - 200), count, replace=False)
            logged = logged.copy()
            logged[at] += height * rng.choice([-1.0, 1.0], count) * rng.uniform(0.7, 1.3, count)
        found[role] = logged
    return found


def _coloured_noise(white: np.ndarray, memory: float) -> np.ndarray:
    """First-order noise of unit variance that forgets within `memory` samples."""
    pole = np.exp(-1.0 / memory)
    out, last = np.empty_like(white), white[0]
    for i, value in enumerate(white):
        last = pole * last + np.sqrt(1.0 - pole * pole) * value if i else value
        out[i] = last
    return out
