"""Frequency response of a drive whose torque is held over each sample, with exact gradients.

A sampled record has this response, not that of the continuous drive: at a tenth of the sampling rate
the hold alone delays the phase by 18 degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.drive import Assembly, Drive, Layout, linear_drive
from drivetool.identify.setup.setup import with_trial_values


@dataclass(frozen=True)
class HeldResponse:
    """G from motor torque to a sensor over some free parameters.

    drive   linear: gaps closed, no Coulomb friction; names: the free parameters
    output  role; step: sample interval [s]; frequency (n,) Hz
    """

    drive: Drive
    names: tuple[str, ...]
    output: str
    step: float
    frequency: np.ndarray

    def at(self, values: Sequence[float], gradient: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """((n,) complex G, (n, k) complex dG over the names); gradient False: (G, empty).

        The dead time turns the phase exactly; that the steps of a held torque then fall between the
        samples is left out, which matters only near the Nyquist frequency.
        """
        drive = with_trial_values(self.drive, self.names, np.asarray(values, float))
        dead_time = drive.value("converter.dead_time") or 0.0
        layout = Layout(self.names, ("motor_torque",), (self.output,), self.step, gradient=gradient)
        s = Assembly(linear_drive(drive), layout).system()
        nx, k = s.nx, len(self.names) if gradient else 0
        flow = s.rows[:, : nx + 1, 0] / s.mass[:, :1]
        block = np.zeros((nx + 1, nx + 1))
        block[:nx] = flow * self.step
        whole = scipy.linalg.expm(block)
        a, b, c = whole[:nx, :nx], whole[:nx, nx], s.outputs[0, :, 0]
        w = 2.0 * np.pi * self.frequency
        z = np.exp(1j * w * self.step)
        inverse = np.linalg.inv(z[:, None, None] * np.eye(nx) - a)
        right, left = inverse @ b, np.einsum("i,nij->nj", c, inverse)
        delay = np.exp(-1j * w * dead_time)
        g = right @ c * delay
        slopes = np.zeros((len(w), k), complex)
        for j in range(k):
            slope = np.zeros_like(block)
            slope[:nx] = (s.rows[:, : nx + 1, 1 + j] - flow * s.mass[:, 1 + j: 2 + j]) / s.mass[:, :1] * self.step
            if slope.any():
                change = scipy.linalg.expm_frechet(block, slope, compute_expm=False)
                slopes[:, j] = np.einsum("nj,nj->n", left, right @ change[:nx, :nx].T + change[:nx, nx])
            slopes[:, j] += right @ s.outputs[0, :, 1 + j]
            slopes[:, j] *= delay
            if self.names[j] == "converter.dead_time":
                slopes[:, j] += -1j * w * g
        return g, slopes
