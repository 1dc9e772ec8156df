"""The torque that the chain behind the motor requires while the motor moves as measured.

The motor gets an inertia that no torque of the chain can move, and the torque that then makes its motion. So the
simulation kernel can be used, with its gaps, its stiction and its sensitivities.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from drivetool.drive import Drive, Layout
from drivetool.drive.simulation import Plant, Trace, plant_of
from drivetool.identify.motion.motion import Motion
from drivetool.identify.motion.required_torque import TorquePart
from drivetool.identify.setup import Roles, first_states
from drivetool.logs import Experiment
from drivetool.quantity import name_of, owner_of

# Times all inertias of the chain: the motion of the motor by the chain's torques is then below rounding.
IMPOSED_INERTIA_FACTOR = 1e14
# Of the stiffness: sensitivity of a shaft's torque to its initial twist at which the transient ends. A choice: far
# below the noise of a logged torque.
TRANSIENT_THRESHOLD = 1e-4


def torque_of_chain(drive: Drive, free: tuple[str, ...], e: Experiment, motion: Motion,
           inputs: Mapping[str, np.ndarray]) -> TorquePart:
    """Torque at the motor, means over the samples' intervals, and its derivatives.

    drive    a chain with values; free: names of its k free parameters; empty: no sensitivities
    inputs   role -> (n,) torques on the other bodies
    """
    own = tuple(n for n in free if owner_of(n) != drive.bodies[0])
    columns = [free.index(n) for n in own]
    value, slopes = np.full(e.size, np.nan), np.zeros((e.size, len(free)))
    for part, plant, trace, start in _runs(drive, own, e, motion, inputs):
        if own:
            out, jacobian = plant.jacobian(trace, start)
            slopes[part, columns] = _interval_mean(jacobian[:, 0, :len(own)])
        else:
            out = plant.outputs(trace, start)
        value[part] = _interval_mean(out[:, 0])
    name = name_of(drive.shafts[0], "ratio")
    ratio = drive.value(name)
    if name in free:
        slopes[:, free.index(name)] -= value / ratio
    return TorquePart(value / ratio, slopes / ratio)


def initial_transient(drive: Drive, e: Experiment, motion: Motion, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
    """(n,) whether a sample is in the chain's initial transient, by the sensitivity of the first shaft's torque."""
    found = np.zeros(e.size, bool)
    for part, plant, trace, start in _runs(drive, (), e, motion, inputs):
        _, jacobian = plant.jacobian(trace, start)
        twist = plant.system.nq + len(drive.bodies)
        shows = np.flatnonzero(np.abs(
            jacobian[:, 0, twist]) > TRANSIENT_THRESHOLD * drive.values[name_of(drive.shafts[0], "stiffness")])
        found[part.start:part.start + (shows[-1] + 1 if len(shows) else 0)] = True
    return found


def _runs(drive: Drive, own: tuple[str, ...], e: Experiment, motion: Motion,
          inputs: Mapping[str, np.ndarray]) -> Iterator[tuple[slice, Plant, Trace, np.ndarray]]:
    """(samples, plant, trace, start state) of each stretch with a known motion, as the kernel simulates it."""
    motor, moved = drive.bodies[0], _with_imposed_motion(drive)
    roles = Roles(("motor_torque", *inputs), ("shaft_torque",))
    plant = plant_of(moved, Layout(own, roles.inputs, roles.outputs, e.step))
    for first, last in e.segments:
        part = slice(first, last)
        acceleration = motion.acceleration[part]
        if not np.isfinite(acceleration).all():
            continue
        speed = motion.speed[first] - 0.5 * e.step * acceleration[0]
        torques = [moved.values[name_of(motor, "inertia")] * acceleration, *(v[part] for v in inputs.values())]
        trace = Trace(np.column_stack(torques), np.zeros((last - first, 1)), e.step, e.name,
                      e.offset + first * e.step, e.number,
                      start={f"{motor}.speed": speed, "angle": motion.angle[first]})
        yield part, plant, trace, first_states(moved, roles, [trace], own)[0]


def _with_imposed_motion(drive: Drive) -> Drive:
    """The drive with an imposed motor motion, without the motor's own friction."""
    motor = drive.bodies[0]
    values = {n: v for n, v in drive.values.items() if owner_of(n) != motor}
    inertia = IMPOSED_INERTIA_FACTOR * max(sum(drive.inertias()), 1e-9)
    return replace(drive, values={**values, name_of(motor, "inertia"): inertia, **{
        f"{motor}.{s}": 0.0 for s in ("viscous", "coulomb", "idle_torque")}})


def _interval_mean(values: np.ndarray) -> np.ndarray:
    """Mean over the interval that follows each sample."""
    found = values.copy()
    found[:-1] = 0.5 * (values[:-1] + values[1:])
    return found
