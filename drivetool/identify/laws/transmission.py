"""Friction that grows with the torque transmitted, as a law that a drive may lack.

Unlike the laws over the motion it needs the torque: of one body that of its motor, else that of a fit's shaft.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drivetool.drive import Assembly, Layout
from drivetool.identify.laws.laws import MIN_DIRECTION_SHARE, Law
from drivetool.identify.motion import Motion, Motions
from drivetool.identify.noise import filtered
from drivetool.identify.setup import Outcome
from drivetool.quantity import name_of

NAME = "friction that grows with the torque transmitted"


def transmission_law(outcome: Outcome, motions: Mapping[str, Motions],
                     one_efficiency: bool = True) -> tuple[Law, ...]:
    """The law on the last body behind a transmission of one efficiency, whether it drives or is driven.

    What is lost is then one share of the mean of the torques before and behind the transmission. What accelerates
    the rotor in front of it is not transmitted: of one body the law has a column of the acceleration too, whose
    factor is the rotor's unknown share of the inertia. Without both driving and driven motion it is no law: the
    torque transmitted is then proportional to all others together.

    outcome  of an innovations fit; motions: of each body
    one_efficiency  else what is lost is one share of the torque before the transmission
    """
    columns, ways, body = [], [], outcome.drive.bodies[-1]
    for motion, before in zip(motions[body].each, _transmitted(outcome), strict=True):
        # A body at rest is held against the torque.
        way = np.where(motion.slow, np.sign(before), motion.side) * np.sign(before)
        behind = np.where(motion.slow | (not one_efficiency), before, _required(outcome, motion))
        rotor = [way * motion.acceleration] if len(outcome.drive.bodies) == 1 else []
        columns.append(np.column_stack([0.5 * way * (before + behind), *rotor]))
        ways.append(way[~motion.slow & np.isfinite(way)])
    driven = np.concatenate(ways) < 0.0
    if not driven.size or not MIN_DIRECTION_SHARE < np.mean(driven) < 1.0 - MIN_DIRECTION_SHARE:
        return ()
    size = np.sqrt(np.nanmean(np.concatenate(columns) ** 2, axis=0))
    if not size.min() > 0.0:
        return ()
    name = f"{NAME}, on the {body}" if len(motions) > 1 else NAME
    return (Law(name, tuple(c / size for c in columns), "nothing", None, body, positive=True),)


def _required(outcome: Outcome, motion: Motion) -> np.ndarray:
    """(n,) torque that the motion of the last body requires behind the transmission, by the parameters of a fit."""
    drive = outcome.drive
    inertia = drive.inertias()[-1]
    viscous, coulomb, idle = (drive.known_value(name_of(drive.bodies[-1], n)) or 0.0
                              for n in ("viscous", "coulomb", "idle_torque"))
    return inertia * motion.acceleration + viscous * motion.speed + coulomb * motion.side + idle


def _transmitted(outcome: Outcome) -> list[np.ndarray]:
    """Per experiment (n,) mean torque over each interval before the transmission; NaN outside its segments."""
    task, found = outcome.fitted, []
    assembly = Assembly(task.drive, Layout((), task.roles.inputs, task.roles.outputs, 1.0, gradient=False))
    stretches = filtered(outcome.problem, outcome.solution.point, outcome.fit.noise)
    for e in task.experiments:
        torque = np.full(e.size, np.nan)
        for first, last in e.segments:
            # A stretch too short for a trace has no state.
            if stretches and len(stretches[0].states) == last - first:
                inputs = [e.signals[role][first:last] for role in task.roles.inputs]
                torque[first:last] = _torque_of(assembly, stretches.pop(0).states, inputs)
        found.append(torque)
    return found


def _torque_of(assembly: Assembly, states: np.ndarray, inputs: list[np.ndarray]) -> np.ndarray:
    """(n,) mean torque over each interval, in which inputs are held and states change linearly."""
    held, torque, shaft = np.zeros(len(states)), np.zeros(len(states)), assembly.n - 2
    for column, factor in assembly.transmitted(assembly.n - 1).items():
        if column < assembly.nx:
            torque += factor.v * states[:, column]
        else:
            held += factor.v * inputs[column - assembly.nx]
    if shaft in assembly.gaps:
        closed = sum(factor.v * states[:, column] for column, factor in assembly.in_contact(shaft).items())
        reach = (assembly.shafts[shaft][0] * assembly.gaps[shaft]).v
        torque += np.sign(closed) * np.maximum(np.abs(closed) - reach, 0.0)
    torque[:-1] = 0.5 * (torque[1:] + torque[:-1])
    return torque + held
