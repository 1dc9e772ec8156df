"""The least standard deviations that any unbiased fit can reach on a linear machine's records.

From the truth and the simulator's equations alone: one-step errors of the machine's own transfer
function, differentiated with respect to its values, start, torque offset and noise polynomial.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import expm, solve_discrete_are
from scipy.signal import lfilter

from tests.simulator.linear import equations
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

FIELDS = ("inertia", "viscous", "stiffness", "damping")
SMALL = 1e-5


def least_std(machine: Machine, figures: Callable[[Machine], Mapping[str, float]], torque: np.ndarray, step: float,
              sensor: float, noise: float = 0.0, records: int = 10, first: int = 0) -> dict[str, float]:
    """Figure -> bound of its standard deviation.

    figures  the requested figures as a function of the machine; all of FIELDS are unknown, as are start and
             torque offset, and, with torque noise, the polynomial C of A y = B u + C e
    sensor   std of the motor speed's white noise [rad/s]; noise: of the torque's [Nm]
    records  with torque noise the speed itself carries information: averaged over so many
    first    sample from which on the record is used; the state there is unknown
    """
    size = len(_values(machine))
    values = np.ones(size)
    tail, variance = _noise_polynomial(machine, step, sensor, noise)
    information = 0.0
    for seed in range(records if noise else 1):
        y = simulate_linear(machine, torque, step, None, white_noise(len(torque), noise, 7000 + seed)).speeds[:, 0]
        y = y + white_noise(len(torque), sensor, 8000 + seed)

        def errors(p, y=y):
            a, b = _polynomials(_moved(machine, p[:size]), step)
            if not noise:
                return -lfilter(b, a, torque)[first:]
            return (lfilter(a, p[size:], y) - lfilter(b, p[size:], torque))[first:]

        columns = _slopes(errors, np.concatenate([values, tail]) if noise else values)
        a, b = _polynomials(machine, step)
        pulse = np.eye(len(a) - 1, len(torque) - first)
        columns += [lfilter([1.0], tail, row) for row in pulse] + [lfilter(b, tail, np.ones(len(torque) - first))]
        if noise:
            del columns[size]  # the leading one of C
        psi = np.stack(columns, axis=1)
        information = information + psi.T @ psi
    information = information / (records if noise else 1)
    scale = np.sqrt(np.diag(information))
    covariance = variance * np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    names = list(figures(machine))
    slopes = np.stack(_slopes(lambda p: np.array(list(figures(_moved(machine, p)).values())), values), axis=1)
    variances = np.einsum("ij,jk,ik->i", slopes, covariance[:size, :size], slopes)
    return dict(zip(names, np.sqrt(variances), strict=True))


def _values(machine: Machine) -> np.ndarray:
    return np.concatenate([getattr(machine, field) for field in FIELDS])


def _moved(machine: Machine, factors: np.ndarray) -> Machine:
    """The machine with all values of FIELDS multiplied."""
    values = iter(_values(machine) * factors)
    return replace(machine, **{f: tuple(float(next(values)) for _ in getattr(machine, f)) for f in FIELDS})


def _discrete(machine: Machine, step: float) -> tuple[np.ndarray, np.ndarray]:
    """(F, G) of the speeds and twists under a held motor torque."""
    n = 2 * machine.bodies - 1
    a, b, _ = equations(machine)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = a[:n, :n], b[:n, 0]
    ahead = expm(block * step)
    return ahead[:n, :n], ahead[:n, n:]


def _polynomials(machine: Machine, step: float) -> tuple[np.ndarray, np.ndarray]:
    """(A, B) in powers of the delay, motor torque to motor speed."""
    f, g = _discrete(machine, step)
    h = np.eye(len(f))[:1]
    a = np.poly(f)
    return a, np.poly(f - g @ h) - a


def _noise_polynomial(machine: Machine, step: float, sensor: float, noise: float) -> tuple[np.ndarray, float]:
    """(C of A y = B u + C e, variance of e): the Kalman filter's; without torque noise C is A."""
    f, g = _discrete(machine, step)
    if not noise:
        return np.poly(f), sensor**2
    h = np.eye(len(f))[:1]
    p = solve_discrete_are(f.T, h.T, noise**2 * g @ g.T, np.array([[sensor**2]]))
    variance = (h @ p @ h.T).item() + sensor**2
    return np.poly(f - f @ p @ h.T @ h / variance), variance


def _slopes(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> list[np.ndarray]:
    """Central differences of a vector function, one array per argument."""
    found = []
    for k in range(len(at)):
        move = np.zeros(len(at))
        move[k] = SMALL
        found.append((function(at + move) - function(at - move)) / (2.0 * SMALL))
    return found
