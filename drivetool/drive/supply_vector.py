"""The supply of an induction motor as a space vector of peak values, stationary and in a rotating frame.

Each value in a frame is the mean until the next sample.
"""

from __future__ import annotations

import numpy as np

# Fraction of the largest voltage above which the frequency is evaluated. A choice: noise rotates smaller vectors.
MIN_VOLTAGE_FRACTION = 0.05


def vector_of_phases(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n,) complex, stationary, from the voltages (n,) [V] of two of three phases that add up to zero."""
    return a + 1j * (a + 2.0 * b) / np.sqrt(3.0)


def vector_of_converter(voltage: np.ndarray, frequency: np.ndarray, step: float) -> np.ndarray:
    """(n,) complex, stationary, from rms voltages between phases (n,) [V] and frequencies (n,) [Hz]; step [s]."""
    angle = 2.0 * np.pi * step * np.concatenate([[0.0], np.cumsum(frequency[:-1])])
    return voltage * np.sqrt(2.0 / 3.0) * np.exp(1j * angle)


def vector_frequency(later: np.ndarray, earlier: np.ndarray, step: float) -> np.ndarray:
    """Frequencies [Hz] of a vector from sample to sample, where it is large enough."""
    significant = np.minimum(np.abs(later), np.abs(earlier)) > MIN_VOLTAGE_FRACTION * np.nanmax(np.abs(later))
    return np.angle(later[significant] / earlier[significant]) / (2.0 * np.pi * step)


def by_converter(vector: np.ndarray, frame: float, step: float, frequency: np.ndarray) -> np.ndarray:
    """The vector in a frame [Hz]: the converter holds its amplitude and rotates it."""
    turn = 2.0 * np.pi * step * (frequency - frame)
    return _in_frame(vector, frame, step) * np.exp(0.5j * turn) * np.sinc(0.5 * turn / np.pi)


def by_phases(vector: np.ndarray, frame: float, step: float) -> np.ndarray:
    """The vector in a frame [Hz]: the mean of two samples, unless it is switched between them."""
    held = _in_frame(vector, frame, step)
    significant = np.abs(held) > MIN_VOLTAGE_FRACTION * np.nanmax(np.abs(held))
    both = significant[1:] & significant[:-1]
    held[:-1] = np.where(both, 0.5 * (held[1:] + held[:-1]), held[:-1])
    return held


def _in_frame(vector: np.ndarray, frame: float, step: float) -> np.ndarray:
    return vector * np.exp(-2j * np.pi * frame * step * np.arange(len(vector)))
