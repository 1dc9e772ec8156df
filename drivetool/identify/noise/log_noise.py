"""The part of a logged torque that is likely to be recording noise: where its spectrum is a noise floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.logs import Experiment, group_by_rate

# Of the Nyquist frequency, above which the floor is taken. A choice: a drive's torque is weak there
FLOOR_BAND_START = 0.8
# Wanted in the mean of a spectrum. A choice: the scatter of a line is then a quarter, 1 / sqrt(16)
MIN_SPECTRUM_FRAMES = 16
# Samples of a frame. A choice: a resolution of a thousandth of the rate resolves resonances
MAX_FRAME_SAMPLES = 1024


def expected_recording_noise(experiments: Sequence[Experiment], role: str) -> tuple[np.ndarray, ...]:
    """Per experiment (n,) the expected recording noise, given the logged torque (Wiener filter).

    At each frequency its share is that of the floor in the power. Power far above the floor counts as signal.
    """
    found = [np.zeros(e.size) for e in experiments]
    for group in group_by_rate(experiments):
        alike = [experiments[i] for i in group]
        stretches = [e.signals[role][a:b] for e in alike for a, b in e.segments]
        size = min(MAX_FRAME_SAMPLES, max(len(s) for s in stretches) * 2 // (MIN_SPECTRUM_FRAMES + 1))
        power = _mean_spectrum(stretches, size) if size >= 32 else None
        if power is None:
            continue
        frequency = np.linspace(0.0, 1.0, len(power))  # over Nyquist's
        floor = float(np.median(power[frequency > FLOOR_BAND_START]))
        share = np.minimum(floor / np.maximum(power, 1e-300), 1.0)
        for i in group:
            for a, b in experiments[i].segments:
                found[i][a:b] = _zero_phase_filtered(experiments[i].signals[role][a:b], frequency, share, size)
    return tuple(found)


def _mean_spectrum(stretches: Sequence[np.ndarray], size: int) -> np.ndarray | None:
    """Mean power of windowed half-overlapping frames; None if there is no frame."""
    window = np.hanning(size)
    frames = [s[i:i + size] for s in stretches for i in range(0, len(s) - size + 1, size // 2)]
    if not frames:
        return None
    return np.mean([np.abs(np.fft.rfft(window * (f - f.mean()))) ** 2 for f in frames], axis=0)


def _zero_phase_filtered(values: np.ndarray, frequency: np.ndarray, share: np.ndarray, size: int) -> np.ndarray:
    """A stretch through a zero-phase filter; it is continued beyond its ends by point reflection."""
    pad = min(size, len(values) - 1)
    long = np.concatenate([2.0 * values[0] - values[pad:0:-1], values, 2.0 * values[-1] - values[-2:-pad - 2:-1]])
    spectrum = np.fft.rfft(long)
    gain = np.interp(np.linspace(0.0, 1.0, len(spectrum)), frequency, share)
    return np.fft.irfft(gain * spectrum, len(long))[pad:pad + len(values)]
