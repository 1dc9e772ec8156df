"""The frequency response of a drive, from its state space: what spectra and fits are compared with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive import MOTOR_TORQUE, Drive, state_space


def frequency_response(drive: Drive, frequencies_hz: np.ndarray, inputs: Sequence[str] = (MOTOR_TORQUE,),
                       outputs: Sequence[str] = ("motor_speed",)) -> np.ndarray:
    """Frequency response, with converter and dead time.

    frequencies_hz  (n,) above zero: a free drive has no response at standstill
    returns         (n, ny, nu) complex
    source          Tallfors 2005, (2.3), the dead time exact instead of a first-order approximation
    """
    frequencies_hz = np.asarray(frequencies_hz, float)
    a, b, c, d = state_space(drive, inputs, outputs)
    s = 2j * np.pi * frequencies_hz[:, None, None]
    response = c @ np.linalg.solve(s * np.eye(len(a)) - a, np.broadcast_to(b, (len(s), *b.shape))) + d
    delay_factor = np.exp(-s[:, :, 0] * (drive.value("converter.dead_time") or 0.0))
    for k, role in enumerate(inputs):
        if role == MOTOR_TORQUE:
            response[:, :, k] *= delay_factor
    return response
