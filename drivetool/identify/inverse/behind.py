"""The torque that the chain behind the motor asks for while the motor is moved as it was measured.

The motor is given an inertia that no torque of the chain can move, and the torque which then makes its motion: so
the kernel of the simulation serves, with its gaps, its sticking and its sensitivities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive.assemble import Layout
from drivetool.drive.augment import plant_of
from drivetool.drive.chain import Drive
from drivetool.drive.simulate import Trace
from drivetool.identify.inverse.asked import Part
from drivetool.identify.inverse.motion import Motion
from drivetool.identify.setup import Roles, first_states
from drivetool.logs.experiment import Experiment

# Times all inertias of the chain: a constant torque of it then moves the motor by 1e-10 of its motion in 10 s.
IMPOSED = 1e14
FADED = 1e-4  # of its stiffness, below which a shaft's torque does not know any more how it began


@dataclass(frozen=True)
class Behind:
    """What the chain asks of the motor: part; begun (n,): whether the start state still shows."""

    part: Part
    begun: np.ndarray


def behind(drive: Drive, free: tuple[str, ...], e: Experiment, motion: Motion,
           inputs: Mapping[str, np.ndarray]) -> Behind:
    """Torque at the motor, means over the samples' intervals, and its derivatives.

    drive    a chain with values; free: names of its k free parameters
    inputs   role -> (n,) torques on the other bodies
    """
    motor, shaft = drive.bodies[0], drive.shafts[0]
    moved = _imposed(drive)
    own = tuple(n for n in free if not n.startswith(f"{motor}."))
    roles = Roles(("motor_torque", *inputs), ("shaft_torque",))
    k, columns = len(free), [free.index(n) for n in own]
    value, slopes, begun = np.full(e.size, np.nan), np.zeros((e.size, k)), np.zeros(e.size, bool)
    plant = plant_of(moved, Layout(own, roles.inputs, roles.outputs, e.step))
    for first, last in e.segments:
        part = slice(first, last)
        acceleration = motion.acceleration[part]
        if not np.isfinite(acceleration).all():
            continue
        speed = motion.speed[first] - 0.5 * e.step * acceleration[0]
        start = {f"{motor}.speed": speed, "angle": motion.angle[first]}
        torques = [moved.values[f"{motor}.inertia"] * acceleration, *(v[part] for v in inputs.values())]
        trace = Trace(np.column_stack(torques), np.zeros((last - first, 1)), e.step, e.name,
                      e.offset + first * e.step, e.number, start=start)
        out, jacobian = plant.jacobian(trace, first_states(moved, roles, [trace], own)[0])
        value[part] = _mean(out[:, 0])
        slopes[part, columns] = _mean(jacobian[:, 0, :len(own)])
        twist = plant.system.nq + len(drive.bodies)
        shows = np.abs(jacobian[:, 0, twist]) > FADED * drive.values[f"{shaft}.stiffness"]
        begun[first:first + _last(shows) + 1] = True
    ratio = drive.value(f"{shaft}.ratio")
    if (name := f"{shaft}.ratio") in free:
        slopes[:, free.index(name)] -= value / ratio
    return Behind(Part(value / ratio, slopes / ratio), begun)


def _imposed(drive: Drive) -> Drive:
    """The drive whose motor goes its way, without friction of its own."""
    motor = drive.bodies[0]
    values = {n: v for n, v in drive.values.items() if not n.startswith(f"{motor}.")}
    inertia = IMPOSED * max(sum(drive.inertias()), 1e-9)
    return replace(drive, values={**values, f"{motor}.inertia": inertia, **{
        f"{motor}.{s}": 0.0 for s in ("viscous", "coulomb", "idle_torque")}})


def _mean(values: np.ndarray) -> np.ndarray:
    """Over the interval that follows each sample."""
    found = values.copy()
    found[:-1] = 0.5 * (values[:-1] + values[1:])
    return found


def _last(shows: np.ndarray) -> int:
    """Index of the last that is true; -1 if none is."""
    return int(np.flatnonzero(shows)[-1]) if shows.any() else -1
