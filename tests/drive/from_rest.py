"""A drive that starts from rest in the kernel: the speeds of its bodies, and their sensitivities by differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.drive.assemble import Layout
from drivetool.drive.simulation.augment import plant_of
from drivetool.drive.simulation.simulate import Trace
from tests.drive.test_kernel import STEP


def outputs_of(drive, torque, free=(), start=None):
    """(n, bodies) speeds, with their sensitivities where something is free; start: states, by default zero."""
    roles = tuple(f"{body}_speed" for body in drive.bodies)
    plant = plant_of(drive, Layout(tuple(free), ("motor_torque",), roles, STEP, gradient=bool(free)))
    trace = Trace(torque[:, None], np.zeros((len(torque), len(roles))), STEP)
    start = np.zeros(plant.nx) if start is None else np.array(start)
    return plant.jacobian(trace, start) if free else plant.outputs(trace, start)


def sensitivity_errors(drive, torque, free, body, step):
    """parameter -> (n,) error of the sensitivities of a body's speed over the largest, against central differences.

    step  of the differences, relative
    """
    _, jacobian = outputs_of(drive, torque, free)
    found = {}
    for k, parameter in enumerate(free):
        size = step * drive.value(parameter)
        up, down = (outputs_of(replace(drive, values={**drive.values, parameter: drive.value(parameter) + change}),
                               torque)[:, body] for change in (size, -size))
        expected = (up - down) / (2.0 * size)
        found[parameter] = np.abs(jacobian[:, body, k] - expected) / np.abs(expected).max()
    return found
