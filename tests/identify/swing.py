"""A body moved along a sum of sines, and its torque in closed form: records without a simulator."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import one_body
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from drivetool.logs import Experiment
from tests.recover import experiment

STEP = 2e-3  # s
FINE = 200  # parts of a sample over which a sign is averaged
PARTS = ((3.0, 0.4, 0.3), (0.5, 1.3, 1.1), (0.15, 2.9, 2.0))  # amplitude [rad], frequency [Hz], phase [rad]
TRUTH = {"motor.inertia": 0.02, "motor.viscous": 0.05, "motor.coulomb": 0.4, "motor.idle_torque": 0.1}


@dataclass(frozen=True)
class Swing:
    """Closed forms of a motion, each (n,); those from `mean_speed` on are means over a sample or in its middle."""

    angle: np.ndarray
    speed: np.ndarray
    mean_speed: np.ndarray
    acceleration: np.ndarray
    side: np.ndarray
    middle: np.ndarray


def swing(n=4000, step=STEP, parts=PARTS, offset=0.0) -> Swing:
    """n samples; offset [rad/s]: a constant speed besides."""
    time = np.arange(n + 1) * step

    def angle(t):
        return offset * t + sum(a * np.sin(2.0 * np.pi * f * t + p) for a, f, p in parts)

    def speed(t):
        return offset + sum(2.0 * np.pi * f * a * np.cos(2.0 * np.pi * f * t + p) for a, f, p in parts)

    inside = time[:-1, None] + (np.arange(FINE) + 0.5) / FINE * step
    return Swing(angle(time[:-1]), speed(time[:-1]), np.diff(angle(time)) / step, np.diff(speed(time)) / step,
                 np.sign(speed(inside)).mean(axis=1), angle(time[:-1] + 0.5 * step))


def torque_for(s: Swing, more=0.0) -> np.ndarray:
    """(n,) torque that moves the body of TRUTH so; more: (n,) a further braking torque."""
    inertia, viscous, coulomb, idle = TRUTH.values()
    return inertia * s.acceleration + viscous * s.mean_speed + coulomb * s.side + idle + more


def record(s: Swing, role="motor_speed", more=0.0, noise=0.0, step=STEP) -> Experiment:
    """Torque and motion as they were logged."""
    measured = (s.speed if role == "motor_speed" else s.angle) + noise
    made = experiment(torque_for(s, more), s.speed, step=step)
    return replace(made, signals={"motor_torque": made.signals["motor_torque"], role: measured})


def task_of(*records: Experiment, free=tuple(TRUTH), **values) -> Task:
    """A fit of one body that begins at the truth, or at other values."""
    drive = one_body().with_values({**TRUTH, **{f"motor.{n}": v for n, v in values.items()}})
    return Task(drive, free, roles_of(records, drive), records)
