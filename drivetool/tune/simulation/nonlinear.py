"""The tuned loop around the whole drive: gaps, Coulomb friction, idle torques.

Between events the closed loop is linear, so the exact kernel that simulates records is used
here too: the controller's states are further states of the piecewise affine system.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive import MOTOR_TORQUE, Assembly, Drive, Layout, chain_alone
from drivetool.drive.simulation import Plant, Trace
from drivetool.quantity import name_of
from drivetool.tune.speed_loop import Loop, Settings, mechanics, steady_torques

REFERENCE_COLUMN, LOAD_COLUMN = 0, 1  # columns of the inputs


def is_nonlinear(drive: Drive) -> bool:
    """Whether a gap or Coulomb friction acts."""
    return has_gap(drive) or any((drive.value(name_of(b, "coulomb")) or 0.0) > 0.0 for b in drive.bodies)


def has_gap(drive: Drive) -> bool:
    """Whether any shaft has a gap."""
    return any((drive.value(name_of(s, "half_gap")) or 0.0) > 0.0 for s in drive.shafts)


def closed_loop(loop: Loop, settings: Settings, step: float, outputs: Sequence[str] = ()) -> Plant:
    """The simulation model of the loop, with speed reference and load torque as inputs.

    outputs  roles of the drive; the states are always returned: speeds, twists, controller, and elastic twists of
             gaps in which the shaft relaxes. The measured shaft torque of a mimo loop is that of a closed contact
    step     sample interval of the inputs [s]
    """
    plain = Assembly(chain_alone(loop.drive),
                     Layout((), (MOTOR_TORQUE, "load_torque"), tuple(outputs), step, gradient=False)).system()
    chain = mechanics(loop.drive, loop.wiring)[0]
    nm, n = len(chain), len(loop.a)
    nx = n + plain.nx - nm
    place = np.r_[:nm, n:nx]  # of the states of the drive
    closed = loop.matrix(settings)
    control = closed[:nm].copy()
    control[:, :nm] -= chain
    mass = np.ones((nx, 1))
    mass[place] = plain.mass
    rows = np.zeros((nx, nx + 3, 1))
    rows[place[:, None], place] = plain.rows[:, :plain.nx]
    rows[place, nx + LOAD_COLUMN] = plain.rows[:, plain.nx + 1]
    rows[place, nx + 2] = plain.rows[:, plain.nx + 2]
    rows[:nm, :n, 0] += control * mass[:nm]
    rows[nm:n, :n, 0] = closed[nm:]
    rows[:n, nx + REFERENCE_COLUMN, 0] = loop.reference(settings) * mass[:n, 0]
    spring, open_guard = np.zeros((plain.ng, nx, 1)), np.zeros((plain.ng, nx, 1))
    spring[:, place], open_guard[:, place] = plain.spring, plain.open_guard
    read = np.zeros((plain.ny, nx, 1))
    read[:, place] = plain.outputs
    relaxing = np.where(plain.relaxing < nm, plain.relaxing, plain.relaxing + n - nm)
    return Plant(plain._replace(rows=rows, mass=mass, spring=spring, open_guard=open_guard, relaxing=relaxing,
                                outputs=read, memory=np.ones(nx), nx=nx, nu=2, ns=nx, plain=nx))


def simulate_loop(plant: Plant, inputs: np.ndarray, start: np.ndarray, step: float) -> tuple[np.ndarray,
                                                                                             np.ndarray]:
    """(outputs (n, ny), states (n, nx)) from a start state under reference and load torque (n, 2).

    start  (nx,), or without elastic twists, which are then relaxed
    """
    trace = Trace(np.ascontiguousarray(inputs, float), np.full((len(inputs), plant.system.ny), np.nan), step)
    out, states, _ = plant.simulate(trace, np.pad(start, (0, plant.nx - len(start))), keep=True)
    return out, states


def steady_state(loop: Loop, settings: Settings, speed: float, load: float = 0.0) -> np.ndarray:
    """(nx,) start state: all bodies at a speed of the first motor, contacts closed, controller at rest.

    The torque through each shaft determines on which side its gap is closed; without torque, the middle.
    """
    drive, n = loop.drive, len(loop.drive.bodies)
    state = np.zeros(len(loop.a))
    state[:n] = speed / np.array(drive.gear_ratios())
    shafts, torque = steady_torques(drive, speed, load, float(np.sign(speed)))
    for k, (shaft, shaft_torque) in enumerate(zip(drive.shafts, shafts, strict=True)):
        half = drive.value(name_of(shaft, "half_gap")) or 0.0
        state[n + k] = shaft_torque / drive.value(name_of(shaft, "stiffness")) + half * np.sign(shaft_torque)
    return _with_controller(loop, settings, state, speed, torque)


def _with_controller(loop: Loop, settings: Settings, state: np.ndarray, speed: float, torque: float) -> np.ndarray:
    """The controller's states at which all motors together give this torque."""
    nm = 2 * len(loop.drive.bodies) - 1
    a, b = loop.matrix(settings), loop.reference(settings)
    # The controller's states are at rest except for one degree of freedom, the integrator.
    inner = a[nm:-1, nm:-1]
    fixed = a[nm:-1, :nm] @ state[:nm] + b[nm:-1] * speed
    at_zero = np.linalg.solve(inner, -fixed) if len(inner) else np.zeros(0)
    per_unit = np.linalg.solve(inner, -a[nm:-1, -1]) if len(inner) else np.zeros(0)
    rows = loop.torque_rows(settings)
    zero = rows @ np.r_[state[:nm], at_zero, 0.0]
    zero += loop.direct * speed * np.array([loop.reference_gain(m, settings) for m in loop.wiring.motors])
    slope = rows @ np.r_[np.zeros(nm), per_unit, 1.0]
    integral_state = (torque - zero.sum()) / slope.sum() if slope.sum() else 0.0
    state[nm:-1] = at_zero + integral_state * per_unit
    state[-1] = integral_state
    return state
