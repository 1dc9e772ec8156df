"""An induction motor that is switched on and off: its equations in the stator's own frame, by a general solver."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

from tests.simulator.coasting import RPM, STEP, Motor, motion


@dataclass(frozen=True)
class Machine:
    """The machine of the coast-down reference; supply: rms between two phases [V], frequency [Hz]."""

    motor: Motor = field(default_factory=Motor)
    stator: float = 60.5
    rotor: float = 42.2
    leakage: float = 0.66
    magnetizing: float = 1.73
    pairs: int = 1
    voltage: float = 220.0
    frequency: float = 50.0

    @property
    def inductances(self) -> np.ndarray:
        """(2, 2) of stator and rotor [H]."""
        side = 0.5 * self.leakage + self.magnetizing
        return np.array([[side, self.magnetizing], [self.magnetizing, side]])

    def currents(self, flux: np.ndarray) -> np.ndarray:
        """Stator and rotor current (2,) complex."""
        return np.linalg.solve(self.inductances, flux)

    def torque(self, flux: np.ndarray) -> float:
        """Air-gap torque [Nm]: 1.5 p (psi_d i_q - psi_q i_d) of the stator."""
        own = self.currents(flux)[0]
        return 1.5 * self.pairs * (flux[0].real * own.imag - flux[0].imag * own.real)

    def phase(self, t: float) -> complex:
        """Voltage of the stator as a space vector, peak value."""
        return self.voltage * np.sqrt(2.0 / 3.0) * np.exp(2j * np.pi * self.frequency * t)


def run_up(machine: Machine, duration: float, speed: float = 0.0, step: float = STEP) -> np.ndarray:
    """(angle, speed, torque) (3, n) at the samples from switching on at rest, or at a speed, without flux."""
    def electrical(t: float, flux: np.ndarray, w: float) -> np.ndarray:
        lost = np.array([machine.stator, machine.rotor]) * machine.currents(flux)
        return np.array([machine.phase(t), 1j * machine.pairs * w * flux[1]]) - lost

    def flux_of(x: np.ndarray) -> np.ndarray:
        return x[:2] + 1j * x[2:4]

    def rate(t: float, x: np.ndarray, turns: bool, sign: float) -> np.ndarray:
        flux, w = flux_of(x), x[5] if turns else 0.0
        slope = electrical(t, flux, w)
        own = machine.motor.viscous * w + sign * machine.motor.coulomb
        faster = (machine.torque(flux) - own) / machine.motor.inertia if turns else 0.0
        return np.concatenate([slope.real, slope.imag, [w, faster]])

    def slips(t: float, x: np.ndarray, *_) -> float:
        return abs(machine.torque(flux_of(x))) - machine.motor.coulomb

    slips.terminal = True
    x, t, turns, sign = np.array([0.0, 0.0, 0.0, 0.0, 0.0, speed]), 0.0, speed > 0.0, 1.0
    at, found = np.arange(0.0, duration, step), []
    settings = {"rtol": 1e-11, "atol": 1e-13, "max_step": 5e-4, "method": "DOP853"}
    if not turns:
        still = solve_ivp(rate, (0.0, duration), x, args=(False, 1.0), events=slips, dense_output=True, **settings)
        t, x = still.t[-1], still.y[:, -1]
        sign = float(np.sign(machine.torque(flux_of(x))))
        found.append(still.sol(at[at < t]))
    moves = solve_ivp(rate, (t, duration), x, args=(True, sign), t_eval=at[at >= t], **settings)
    assert sign > 0.0 and moves.y[5].min() > -1e-9  # it starts forward and never turns back
    found.append(moves.y)
    whole = np.concatenate(found, axis=1)
    return np.vstack([whole[4], whole[5], [machine.torque(flux_of(x)) for x in whole.T]])


def up_and_down(machine: Machine, rest: float = 0.05, duration: float = 0.8, end: float = 80 * RPM,
                ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(angle, speed, whether supplied), each (n,): at rest, switched on, switched off, coasting down."""
    up = run_up(machine, duration)
    down = motion(machine.motor, lambda t: 0.0, float(up[1, -1]), end, 8.0)
    before = np.zeros(round(rest / STEP))
    angle = np.concatenate([before, up[0, :-1], up[0, -1] + down[0]])
    speed = np.concatenate([before, up[1, :-1], down[1]])
    on = np.arange(len(angle))
    return angle, speed, (on >= len(before)) & (on < len(before) + up.shape[1] - 1)
