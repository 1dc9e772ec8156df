"""Frequency responses by Welch's method: H1, H2, H3, Hv and the indirect estimate in closed loop.

The spectra are those of scipy.signal.csd, but every frame is transformed once for all pairs of channels, which
makes them five times as fast; added are pooling over stretches and runs, the estimators, and the variance
that follows from coherence and the number of independent frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from drivetool.errors import BadOption, NotEnoughData

Estimator = Literal["h1", "h2", "h3", "hv", "indirect"]
ESTIMATORS: tuple[Estimator, ...] = ("h1", "h2", "h3", "hv", "indirect")
# Independent frames at least: the coherence of a single frame is one, whatever the data
MIN_INDEPENDENT_FRAMES = 2.0
# Of the largest input amplitude, 80 dB: below it a line is leakage of the window, not excited
MIN_EXCITED_AMPLITUDE = 1e-4


@dataclass(frozen=True)
class Response:
    """A measured frequency response.

    frequency  (n,) Hz, rising, excited lines only
    g          (n,) complex, output over input
    noise      (n,) E|error of g|^2 by noise; NaN where it is not identifiable
    total      (n,) the same with nonlinear distortion, where runs with other phases identify it
    coherence  (n,) 0..1; for a periodic excitation that of the averaged periods
    bins       spectral lines that share their information (1.5 for a Hann window, 1 for periods)
    averages   independent frames or periods behind each value
    method     how it was found
    """

    frequency: np.ndarray
    g: np.ndarray
    noise: np.ndarray
    total: np.ndarray
    coherence: np.ndarray
    bins: float
    averages: float
    method: str

    def at(self, lines: np.ndarray) -> Response:
        """The lines that a mask (n,) names."""
        return Response(*(a[lines] for a in (self.frequency, self.g, self.noise, self.total, self.coherence)),
                        self.bins, self.averages, self.method)

    def band(self, low: float, high: float) -> Response:
        """The lines from `low` to `high` Hz."""
        return self.at((self.frequency >= low) & (self.frequency <= high))

    @property
    def variance(self) -> np.ndarray:
        """(n,) the larger of both variances, for weights that include distortion."""
        return np.where(np.isfinite(self.total), np.fmax(self.total, self.noise), self.noise)


@dataclass(frozen=True)
class Welch:
    """How spectra are averaged.

    length   of a frame [samples]; overlap: share of it, 0 <= overlap < 1; window: name for SciPy
    """

    length: int
    overlap: float = 0.5
    window: str = "hann"

    def __post_init__(self):
        if self.length < 8:
            raise BadOption("frames of at least 8 samples", f"{self.length}", "Give --length more seconds.")
        if not 0.0 <= self.overlap < 1.0:
            raise BadOption("an overlap from 0 to below 1", f"{self.overlap:g}", "Correct --overlap.")
        try:
            scipy.signal.get_window(self.window, 8)
        except (ValueError, TypeError):
            raise BadOption("a window that SciPy knows by its name alone", f"'{self.window}'",
                            "Use for example hann, hamming, blackman or boxcar.") from None

    @property
    def shift(self) -> int:
        """Samples from one frame to the next."""
        return self.length - int(self.overlap * self.length)

    @property
    def bins(self) -> float:
        """Equivalent noise bandwidth of the window, in lines."""
        w = scipy.signal.get_window(self.window, self.length)
        return float(self.length * np.sum(w**2) / np.sum(w) ** 2)

    def frames(self, size: int) -> int:
        """Frames in a stretch of `size` samples."""
        return 0 if size < self.length else 1 + (size - self.length) // self.shift

    def independent(self, size: int) -> float:
        """Frames of a stretch that count as independent: overlapping ones share data.

        source  Welch 1967, the variance of the averaged periodogram
        """
        k, w = self.frames(size), scipy.signal.get_window(self.window, self.length)
        energy, shared = float(w @ w), 0.0
        for j in range(1, k):
            if j * self.shift >= self.length:
                break
            rho = float(w[j * self.shift:] @ w[: self.length - j * self.shift]) / energy
            shared += 2.0 * (1.0 - j / k) * rho**2
        return k / (1.0 + shared)


@dataclass(frozen=True)
class Spectra:
    """Pooled auto and cross spectra of channels.

    frequency  (n,) Hz; matrix (n, m, m) with [i, j] = E conj(X_i) X_j; averages: independent frames
    """

    frequency: np.ndarray
    matrix: np.ndarray
    averages: float


def pooled(stretches: Sequence[np.ndarray], step: float, welch: Welch) -> Spectra:
    """Spectra over uninterrupted stretches, each weighed by its frames.

    stretches  (n_i, m) channels
    raises     NotEnoughData: fewer than two independent frames
    """
    total, frames, averages = 0.0, 0, 0.0
    for x in stretches:
        count = welch.frames(len(x))
        if not count:
            continue
        lines = _frame_spectra(x, welch)
        total = total + np.einsum("fin,fjn->nij", lines.conj(), lines)
        frames, averages = frames + count, averages + welch.independent(len(x))
    if averages < MIN_INDEPENDENT_FRAMES:
        raise NotEnoughData(
            f"at least {MIN_INDEPENDENT_FRAMES:g} independent frames of {welch.length * step:g} s",
            f"{averages:.2g} in stretches of {', '.join(f'{len(x) * step:g} s' for x in stretches)}",
            "Record longer, or shorten the frames with --length.")
    w = scipy.signal.get_window(welch.window, welch.length)
    density = np.asarray(total) * 2.0 * step / float(w @ w) / frames
    density[0] *= 0.5
    if welch.length % 2 == 0:
        density[-1] *= 0.5
    return Spectra(np.fft.rfftfreq(welch.length, step), density, averages)


def _frame_spectra(x: np.ndarray, welch: Welch) -> np.ndarray:
    """(frames, m, lines) spectra of windowed frames without their mean and slope."""
    frames = np.lib.stride_tricks.sliding_window_view(x, welch.length, axis=0)[:: welch.shift]
    t = np.linspace(-1.0, 1.0, welch.length)
    line = np.stack([np.full(welch.length, 1.0 / np.sqrt(welch.length)), t / np.linalg.norm(t)])
    frames = frames - (frames @ line.T) @ line
    return np.fft.rfft(frames * scipy.signal.get_window(welch.window, welch.length), axis=2)


def welch_response(stretches: Sequence[np.ndarray], step: float, welch: Welch,
                   estimator: Estimator = "h1") -> Response:
    """A frequency response from pooled spectra.

    stretches  (n_i, 2) input and output, or (n_i, 3) with the reference that drives the loop
    estimator  h1, h2, h3 (mean of both), hv (geometric mean), indirect (over the reference)
    returns    Response at the excited lines above 0 Hz
    raises     BadOption: indirect without a reference; NotEnoughData: too few frames, no excited line
    source     h3: Mitchell 1982; hv: Rocklin, Crowley, Vold 1985, for one input; variances: Bendat and
               Piersol 2010, sec. 9.2; indirect: Ljung 1999, sec. 13.5
    """
    if estimator == "indirect" and stretches[0].shape[1] < 3:
        raise BadOption("a reference channel for the indirect estimate", "input and output only",
                        "Map reference_torque, reference_speed or reference_angle, or use --estimator h1.")
    s = pooled(stretches, step, welch)
    p = s.matrix
    puu, pyy, puy = p[:, 0, 0].real, p[:, 1, 1].real, p[:, 0, 1]
    # The lowest lines contain the window's leakage from offset and drift.
    lowest = int(np.ceil(welch.bins))
    keep = (np.arange(len(puu)) >= lowest) & (puu > MIN_EXCITED_AMPLITUDE**2 * puu[lowest:].max(initial=0.0))
    keep &= np.abs(puy) > 0.0
    if estimator == "indirect":
        prr = p[:, 2, 2].real
        keep &= prr > MIN_EXCITED_AMPLITUDE**2 * prr[lowest:].max(initial=0.0)
    if not keep.any():
        raise NotEnoughData("spectral lines that the torque excites and the sensor measures", "none",
                            "Look at both channels with inspect; record while they change.")
    puu, pyy, puy, p, f = puu[keep], pyy[keep], puy[keep], p[keep], s.frequency[keep]
    coherence = np.clip(np.abs(puy) ** 2 / (puu * pyy), 0.0, 1.0)
    h1, h2 = puy / puu, pyy / np.conj(puy)
    g = {"h1": h1, "h2": h2, "h3": 0.5 * (h1 + h2),
         "hv": np.sqrt(np.abs(h1) * np.abs(h2)) * np.exp(1j * np.angle(h1))}.get(estimator)
    if g is None:
        pru, pry, prr = p[:, 2, 0], p[:, 2, 1], p[:, 2, 2].real
        g = pry / pru
        # The output minus g times the input, in proportion to the reference's part of the input.
        residual = pyy - 2.0 * (np.conj(g) * puy).real + np.abs(g) ** 2 * puu
        noise = np.maximum(residual, 0.0) * prr / np.abs(pru) ** 2 / s.averages
        coherence = np.clip(np.abs(pry) ** 2 / (prr * pyy), 0.0, 1.0)
    else:
        noise = np.abs(g) ** 2 * (1.0 - coherence) / np.maximum(coherence, 1e-12) / s.averages
    unknown = np.full(len(f), np.nan)
    return Response(f, g, noise, unknown, coherence, welch.bins, s.averages, estimator)
