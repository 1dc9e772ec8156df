"""The torque that a motion requires of the motor: the sum over all effects on its body, and its derivatives.

The effects stamp their laws as for a simulation; here they are evaluated at the motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Assembly, Drive, Law, Layout, is_constant
from drivetool.drive.effects import transmission_loss
from drivetool.errors import BadOption
from drivetool.identify.motion.motion import Motion
from drivetool.quantity import name_of, owner_of

DEAD_TIME = "converter.dead_time"


@dataclass(frozen=True)
class TorquePart:
    """A part of the torque: value (n,) and its derivatives (n, k) over the free parameters."""

    value: np.ndarray
    slopes: np.ndarray


@dataclass(frozen=True)
class RequiredTorque:
    """The torque that a motion requires, by its dependence on the motion.

    accelerating  proportional to the acceleration; sliding: to the speed
    rest          any other
    """

    accelerating: TorquePart
    sliding: TorquePart
    rest: TorquePart


def first_body(drive: Drive) -> Drive:
    """The motor's body alone, with all torques on it."""
    body = drive.bodies[0]
    values = {n: v for n, v in drive.values.items() if owner_of(n) in (body, "friction")}
    torques = tuple(n for n in drive.known_torques if owner_of(n) == body)
    return replace(drive, bodies=(body,), shafts=(), values=values, known_torques=torques)


def check_no_signal_path(drive: Drive, free: Sequence[str]) -> None:
    """Raise BadOption where a path or a loss lies between the log and the first body, or its law has a state.

    That of a gap may have one: the chain behind the motor is simulated, with the loss of its transmissions.
    """
    with_states = (name_of(owner, suffix) for effect, owner, _ in drive.effects()
                   if effect.has_states and effect.of != "shaft" for suffix in effect.present)
    losses = [name_of(drive.bodies[0], suffix) for suffix in transmission_loss.EFFECT.present]
    path = (DEAD_TIME, *with_states, *losses)
    acting = [n for n in path if n in free or drive.value(n) != drive.quantity(n).neutral]
    acting += [n for n in drive.values if is_constant(n)]  # not the constant that made the torque
    if acting:
        raise BadOption("torque and motion without delay, filter, loss or torque constant between them, and laws "
                        "without states, for --criterion inverse", ", ".join(acting),
                        "Leave --criterion out: a simulation models them.")


def required_torque_of(drive: Drive, free: Sequence[str], motion: Motion, step: float,
          inputs: Mapping[str, np.ndarray]) -> RequiredTorque:
    """The torque of the motor that a motion of its body requires.

    drive    of one body, with values
    free     names of its k free parameters
    motion   means over the samples' intervals, each (n,)
    step     sample interval [s]
    inputs   role -> (n,) other torques on the body, known ones among them
    returns  RequiredTorque, [N m] or the drive's unit
    """
    layout = Layout(tuple(free), ("motor_torque", *inputs), ("motor_angle",), step)
    a = Assembly(drive, layout)
    k, n = len(free), len(motion.speed)
    state = {a.speed(0): motion.speed, a.states.index("angle"): motion.angle, a.constant: np.ones(n)}
    state |= {a.nx + 1 + i: values for i, values in enumerate(inputs.values())}
    mass = a.masses[0].jet()
    accelerating = TorquePart(mass[0] * motion.acceleration, np.outer(motion.acceleration, mass[1:1 + k]))
    sliding, rest = np.zeros((n, 1 + k)), np.zeros((n, 1 + k))
    for (row, column), factor in a.rows.items():
        if row == 0 and column in state:
            (sliding if column == a.speed(0) else rest)[:] -= np.outer(state[column], factor.jet()[:1 + k])
    for level in a.frictions.values():
        rest += np.outer(motion.side, level.jet()[:1 + k])
    for law in a.laws:
        rest -= _torque_of_law(law, state, motion, k)
    return RequiredTorque(accelerating, *(TorquePart(p[:, 0], p[:, 1:]) for p in (sliding, rest)))


def _torque_of_law(law: Law, state: Mapping[int, np.ndarray], motion: Motion, k: int) -> np.ndarray:
    """(n, 1 + k) torque of a smooth law at every sample, and its derivatives."""
    n = len(motion.speed)
    arguments = np.zeros((2, n, 1 + k))
    for i, row in enumerate((law.first, law.second)):
        for column, factor in row.items():
            arguments[i] += np.outer(state[column], factor.jet()[:1 + k])
    parameters = np.array([p.jet()[:1 + k] for p in law.parameters])
    side = motion.side if law.slides else np.ones(n)
    out, found = np.zeros((n, 3 + len(parameters))), np.zeros((n, 1 + k))
    for i in np.flatnonzero(np.isfinite(motion.speed)):
        law.torque(arguments[0, i, 0], arguments[1, i, 0], motion.time[i], side[i], parameters, out[i])
    found[:, 0] = out[:, 0]
    found[:, 1:] = out[:, 1, None] * arguments[0, :, 1:] + out[:, 2, None] * arguments[1, :, 1:]
    found[:, 1:] += out[:, 3:] @ parameters[:, 1:]
    found[~np.isfinite(motion.speed)] = np.nan
    return found
