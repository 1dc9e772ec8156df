"""Orders that are none: a hum of fixed frequency, seen where the motor turns steadily for a while."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Times the score of an order that a fixed frequency must have, to be what stands behind it. At a steady speed both
# explain the same, and half a step of the grid between two orders, or two frequencies, costs up to a fifth.
BETTER = 1.5
TAIL = 0.1  # share of the score of an order that the slowest samples, and the fastest, may add for chance


class FixedLines:
    """What each fixed frequency explains of the torque that innovations ask for, in the unit of a score."""

    def __init__(self, torque: Sequence[np.ndarray], lines: np.ndarray, response: np.ndarray, step: float) -> None:
        """torque (n,) per trace; response (LINES, outputs) of innovations to it at lines (LINES,) [Hz]"""
        size = 1 << (2 * max(len(t) for t in torque) - 1).bit_length()
        self.frequency = np.fft.rfftfreq(size, step)
        self.frequency = self.frequency[self.frequency <= lines[-1]]
        power = np.interp(self.frequency, lines, (np.abs(response) ** 2).sum(axis=1))
        spectra = [np.abs(np.fft.rfft(t, size)[:len(power)]) ** 2 / len(t) for t in torque]
        score = sum(spectra) / np.maximum(power, 1e-300)
        # Each trace has a phase of its own, with which noise alone explains one part more.
        self.score = score - (1.0 - 1.0 / len(spectra)) * np.median(score)

    def explains(self, order: float, score: float, torque: Sequence[np.ndarray], angles: Sequence[np.ndarray],
                 speeds: Sequence[np.ndarray]) -> bool:
        """Whether one frequency explains more than an order does, among those at which the order explains it."""
        asked = [t * np.exp(-1j * order * a) for t, a in zip(torque, angles, strict=True)]
        total = sum(complex(a.sum()) for a in asked)
        speed = np.abs(np.concatenate(speeds))
        at = np.argsort(speed, kind="stable")
        grown = np.cumsum((np.concatenate(asked) * np.conj(total)).real[at]) / abs(total) ** 2
        low, high = speed[at[np.argmax(grown >= TAIL)]], speed[at[np.flatnonzero(grown <= 1.0 - TAIL)[-1]]]
        inside = slice(*np.searchsorted(self.frequency, order / (2.0 * np.pi) * np.array([low, high]) + np.array(
            [-1.0, 1.0]) * (self.frequency[1] - self.frequency[0])))
        return bool(len(self.score[inside]) and self.score[inside].max() > BETTER * score)
