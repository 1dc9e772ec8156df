"""An induction motor: its torque from the voltages at its stator, with the fluxes as states.

Equations of the two-axis model in a frame that turns at a chosen frequency, as space vectors (peak values):
p_s' = u - Rs i_s - j we p_s, p_r' = -Rr i_r - j (we - p w) p_r, T = 1.5 p Im(conj(p_s) i_s). In a frame at the
frequency of the supply a steady voltage is constant, so that held samples represent it exactly.

The printed equations (11) and (13) of the source have the wrong sign before the terms in we: as printed, the
fluxes are unstable.
"""

from __future__ import annotations

import numpy as np

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

FLUXES = ("stator_flux_d", "stator_flux_q", "rotor_flux_d", "rotor_flux_q")
VOLTAGES = ("stator_voltage_d", "stator_voltage_q")
MAX_POLE_PAIRS = 12  # a choice: motors that are built have no more
VECTOR_POWER_SCALE = 1.5  # power of three phases over the product of their space vectors of peak values


def torque(a, b, time, side, p, out):
    """p[0] a b: a torque of two fluxes, or a voltage that the rotating rotor induces."""
    out[0] = p[0, 0] * a * b
    out[1], out[2], out[3] = p[0, 0] * b, p[0, 0] * a, a * b


def current_factors(leakage, magnetizing) -> tuple:
    """(own, mutual) factors of the currents: i_s = own p_s - mutual p_r, i_r = own p_r - mutual p_s [1/H].

    leakage  the total leakage inductance, half at the stator, half at the rotor, and the magnetizing one [H]
    """
    side = 0.5 * leakage + magnetizing
    determinant = side * side - magnetizing * magnetizing
    return side / determinant, magnetizing / determinant


def stamp(assembly, _motor):
    """Four fluxes as states; the rotor's own voltage and the torque are products of two of them."""
    own = {name: assembly.of_body(0, name) for name in EFFECT.quantities}
    self_factor, mutual = current_factors(own["leakage_inductance"], own["magnetizing_inductance"])
    one, turning = assembly.number(1.0), 2.0 * np.pi * own["supply_frequency"]
    stator, rotor = ([assembly.states.index(name) for name in names] for names in (FLUXES[:2], FLUXES[2:]))
    for axis, other, sign in ((0, 1, 1.0), (1, 0, -1.0)):
        for row, partner, loss in ((stator, rotor, own["stator_resistance"]),
                                   (rotor, stator, own["rotor_resistance"])):
            assembly.torque(row[axis], row[axis], -loss * self_factor)
            assembly.torque(row[axis], partner[axis], loss * mutual)
            assembly.torque(row[axis], row[other], sign * turning)
        if VOLTAGES[axis] in assembly.layout.inputs:
            assembly.torque(stator[axis], assembly.nx + assembly.layout.inputs.index(VOLTAGES[axis]), one)
        speed, pairs = {assembly.speed(0): one}, own["pole_pairs"]
        assembly.law(torque, [-sign * pairs], speed, {rotor[other]: one}, body=rotor[axis])
        strength = sign * VECTOR_POWER_SCALE * pairs * mutual
        assembly.law(torque, [strength], {stator[other]: one}, {rotor[axis]: one}, body=0, drives=True)


def states(assembly, motor):
    """The fluxes, where the motor's torque is computed from its stator voltages."""
    return FLUXES if assembly.acts(motor, "magnetizing_inductance") else ()


def start(drive, _motor, speeds, inputs):
    """The steady fluxes of the first voltage at that speed."""
    voltage = complex(*(inputs.get(role, 0.0) for role in VOLTAGES))
    steady = np.linalg.solve(flux_dynamics(drive, speeds[0]), [-voltage, 0.0])
    return [part for flux in steady for part in (flux.real, flux.imag)]


EFFECT = Effect(
    code="induction-motor",
    of="motor",
    quantities={
        "stator_resistance": Quantity("ohm", "resistance of a phase of the stator", (1e-6, 1e6), 1.0, 1.0),
        "rotor_resistance": Quantity("ohm", "resistance of a phase of the rotor, seen from the stator",
                                     (1e-6, 1e6), 1.0, 1.0),
        "leakage_inductance": Quantity("H", "leakage inductance of stator and rotor together", (1e-9, 1e6), 0.01,
                                       0.01),
        "magnetizing_inductance": Quantity("H", "magnetizing inductance of a phase", (0.0, 1e6), 0.1, 0.0),
        "pole_pairs": Quantity("", "pole pairs of the motor", (1.0, MAX_POLE_PAIRS), 1.0, 1.0,
                               tuple(map(float, range(1, MAX_POLE_PAIRS + 1)))),
        "supply_frequency": Quantity("Hz", "frequency of the frame that the voltages are given in",
                                     (0.0, 1e4), 50.0, 0.0),
    },
    stamp=stamp,
    torque=torque,
    states=states,
    start=start,
    inputs=VOLTAGES,
    law="T = 1.5 p Im(conj(p_s) i_s); p_s' = u - Rs i_s - j we p_s, p_r' = -Rr i_r - j (we - p w) p_r",
    needs="the voltages at the stator, and a run-up",
    source="Mechanical Parameter Estimation of an Induction Motor for a Digital Twin Using Coast-Down Data, "
           "eqs. (10)-(16), signs corrected; Krause 1986, Analysis of Electric Machinery",
    present=("magnetizing_inductance",),
    odd=False,  # its field rotates in one direction
)


def flux_dynamics(drive, speed: float) -> np.ndarray:
    """(2, 2) complex: rates of stator and rotor flux over both, at a speed [rad/s], in the drive's frame.

    raises  BadParameters: a value is missing
    """
    value = {name: drive.value(f"motor.{name}") for name in EFFECT.quantities}
    own, mutual = current_factors(value["leakage_inductance"], value["magnetizing_inductance"])
    frame = 2j * np.pi * value["supply_frequency"]
    rs, rr = value["stator_resistance"], value["rotor_resistance"]
    return np.array([[-rs * own - frame, rs * mutual],
                     [rr * mutual, -rr * own - frame + 1j * value["pole_pairs"] * speed]])


def _torque_factor(drive) -> float:
    """Torque over the imaginary part of conj(p_r) p_s [Nm/Wb^2]."""
    _, mutual = current_factors(
        drive.value("motor.leakage_inductance"), drive.value("motor.magnetizing_inductance"))
    return VECTOR_POWER_SCALE * drive.value("motor.pole_pairs") * mutual


def steady_torque(drive, amplitude: float, speed: float) -> float:
    """Torque [Nm] at a constant speed [rad/s], at a phase voltage of that peak value [V] and the drive's frequency.

    source  the solved flux equations; equal to that of the equivalent circuit
    """
    stator, rotor = np.linalg.solve(flux_dynamics(drive, speed), [-amplitude, 0.0])
    return float(_torque_factor(drive) * np.imag(np.conj(rotor) * stator))


def mean_torque(drive, voltage: np.ndarray, speed: np.ndarray, step: float) -> float:
    """Mean torque [Nm] over a record that starts without flux, approximated by the trapezoidal rule.

    voltage  (n,) complex [V]; speed (n,) [rad/s]; step: sample interval [s]
    """
    flux, total = np.zeros(2, complex), 0.0
    for u, w in zip(voltage, speed, strict=True):
        half = 0.5 * step * flux_dynamics(drive, w)
        flux = np.linalg.solve(np.eye(2) - half, flux + half @ flux + [step * u, 0.0])
        total += float(np.imag(np.conj(flux[1]) * flux[0]))
    return _torque_factor(drive) * total / len(voltage)
