"""The torque that the chain behind the motor asks for while the motor is moved as it was measured.

The motor is given an inertia that no torque of the chain can move, and the torque which then makes its motion: so
the kernel of the simulation serves, with its gaps, its sticking and its sensitivities.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive, Layout
from drivetool.drive.simulation import Plant, Trace, plant_of
from drivetool.identify.motion.motion import Motion
from drivetool.identify.motion.required_torque import Part
from drivetool.identify.setup import Roles, first_states
from drivetool.logs import Experiment

# Times all inertias of the chain: what its torques move of the motor then is a rounding error of its motion.
IMPOSED = 1e14
FADED = 1e-4  # of its stiffness, below which a shaft's torque does not know any more how it began


def behind(drive: Drive, free: tuple[str, ...], e: Experiment, motion: Motion,
           inputs: Mapping[str, np.ndarray]) -> Part:
    """Torque at the motor, means over the samples' intervals, and its derivatives.

    drive    a chain with values; free: names of its k free parameters; none: no sensitivities are worked out
    inputs   role -> (n,) torques on the other bodies
    """
    own = tuple(n for n in free if not n.startswith(f"{drive.bodies[0]}."))
    columns = [free.index(n) for n in own]
    value, slopes = np.full(e.size, np.nan), np.zeros((e.size, len(free)))
    for part, run in _runs(drive, own, e, motion, inputs):
        if own:
            out, jacobian = run.plant.jacobian(run.trace, run.start)
            slopes[part, columns] = _mean(jacobian[:, 0, :len(own)])
        else:
            out = run.plant.outputs(run.trace, run.start)
        value[part] = _mean(out[:, 0])
    name = f"{drive.shafts[0]}.ratio"
    ratio = drive.value(name)
    if name in free:
        slopes[:, free.index(name)] -= value / ratio
    return Part(value / ratio, slopes / ratio)


def begins(drive: Drive, e: Experiment, motion: Motion, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
    """(n,) whether the first shaft still shows in which state the chain began, by the sensitivity of its torque."""
    found = np.zeros(e.size, bool)
    for part, run in _runs(drive, (), e, motion, inputs):
        _, jacobian = run.plant.jacobian(run.trace, run.start)
        twist = run.plant.system.nq + len(drive.bodies)
        shows = np.flatnonzero(np.abs(jacobian[:, 0, twist]) > FADED * drive.values[f"{drive.shafts[0]}.stiffness"])
        found[part.start:part.start + (shows[-1] + 1 if len(shows) else 0)] = True
    return found


@dataclass(frozen=True)
class _Run:
    """A stretch of a record as the kernel runs it."""

    plant: Plant
    trace: Trace
    start: np.ndarray


def _runs(drive: Drive, own: tuple[str, ...], e: Experiment, motion: Motion,
          inputs: Mapping[str, np.ndarray]) -> Iterator[tuple[slice, _Run]]:
    """Every stretch in which the motion is known."""
    motor, moved = drive.bodies[0], _imposed(drive)
    roles = Roles(("motor_torque", *inputs), ("shaft_torque",))
    plant = plant_of(moved, Layout(own, roles.inputs, roles.outputs, e.step))
    for first, last in e.segments:
        part = slice(first, last)
        acceleration = motion.acceleration[part]
        if not np.isfinite(acceleration).all():
            continue
        speed = motion.speed[first] - 0.5 * e.step * acceleration[0]
        torques = [moved.values[f"{motor}.inertia"] * acceleration, *(v[part] for v in inputs.values())]
        trace = Trace(np.column_stack(torques), np.zeros((last - first, 1)), e.step, e.name,
                      e.offset + first * e.step, e.number,
                      start={f"{motor}.speed": speed, "angle": motion.angle[first]})
        yield part, _Run(plant, trace, first_states(moved, roles, [trace], own)[0])


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
