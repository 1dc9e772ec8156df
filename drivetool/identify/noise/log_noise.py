"""The part of a logged torque that is likely to be noise of the log alone: where its spectrum is a floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.logs import Experiment, of_one_rate

TOP = 0.8  # of the Nyquist frequency, above which the floor is read
FRAMES = 16  # at least, in the mean of a spectrum
LONGEST = 1024  # samples of a frame


def likely_noise(experiments: Sequence[Experiment], role: str) -> tuple[np.ndarray, ...]:
    """Per experiment (n,) the expected noise of the log, given what was logged (Wiener's filter).

    At each frequency it is the share of the floor in the power. What is much stronger than the floor is signal, and
    passes as signal.
    """
    found = [np.zeros(e.size) for e in experiments]
    for group in of_one_rate(experiments):
        alike = [experiments[i] for i in group]
        stretches = [e.signals[role][a:b] for e in alike for a, b in e.segments]
        size = min(LONGEST, max(len(s) for s in stretches) * 2 // (FRAMES + 1))
        power = _spectrum(stretches, size) if size >= 32 else None
        if power is None:
            continue
        frequency = np.linspace(0.0, 1.0, len(power))  # over Nyquist's
        floor = float(np.median(power[frequency > TOP]))
        share = np.minimum(floor / np.maximum(power, 1e-300), 1.0)
        for i in group:
            for a, b in experiments[i].segments:
                found[i][a:b] = _filtered(experiments[i].signals[role][a:b], frequency, share, size)
    return tuple(found)


def _spectrum(stretches: Sequence[np.ndarray], size: int) -> np.ndarray | None:
    """Mean power of windowed half-overlapping frames; None if there is no frame."""
    window = np.hanning(size)
    frames = [s[i:i + size] for s in stretches for i in range(0, len(s) - size + 1, size // 2)]
    if not frames:
        return None
    return np.mean([np.abs(np.fft.rfft(window * (f - f.mean()))) ** 2 for f in frames], axis=0)


def _filtered(values: np.ndarray, frequency: np.ndarray, share: np.ndarray, size: int) -> np.ndarray:
    """A stretch through a zero-phase filter; beyond its ends it goes on, mirrored."""
    pad = min(size, len(values) - 1)
    long = np.concatenate([2.0 * values[0] - values[pad:0:-1], values, 2.0 * values[-1] - values[-2:-pad - 2:-1]])
    spectrum = np.fft.rfft(long)
    gain = np.interp(np.linspace(0.0, 1.0, len(spectrum)), frequency, share)
    return np.fft.irfft(gain * spectrum, len(long))[pad:pad + len(values)]
