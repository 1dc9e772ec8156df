"""A linear estimate with or without instruments, and its covariance under errors that are correlated in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

INFLUENCE_BLOCKS = 16  # contiguous, so that errors may be correlated within (Bester, Conley, Hansen 2011)
# Frequencies to either side over which the residual's spectrum is smoothed: 33 together know its level to 18 per
# cent, and the noise of a drive changes little over so few periods of the record.
SPECTRUM_NEIGHBOURS = 16
# Of the autoregression that whitens a spectrum before it is smoothed. A choice: two resonances.
AUTOREGRESSION_ORDER = 4
# Of the power, added as white noise: a band that a filter removed makes the autoregression singular
WHITE_LOADING = 1e-6
# Of the power at a frequency, the least residual share. A choice: it bounds the correction of fitted lines.
MIN_RESIDUAL_SHARE = 0.1
# Ratio of variances: 99 % by chance (chi-square)
MAX_VARIANCE_RATIO = 2.0 * float(scipy.special.gammaincinv(0.5 * (INFLUENCE_BLOCKS - 1), 0.99)) / (
    INFLUENCE_BLOCKS - 1)


@dataclass(frozen=True)
class Rows:
    """Equations of a recording at even times: residual (n,), slopes and instruments (n, k); zero where unused."""

    residual: np.ndarray
    slopes: np.ndarray
    instruments: np.ndarray


def inverse_of(rows: Sequence[Rows]) -> np.ndarray:
    """(k, k) inverse of instruments times slopes; without unidentifiable directions."""
    z, x = (np.concatenate([getattr(r, name) for r in rows]) for name in ("instruments", "slopes"))
    size = [np.sqrt(np.mean(m**2, axis=0)) for m in (z, x)]
    for s in size:
        s[s == 0.0] = 1.0
    product = (z / size[0]).T @ (x / size[1])
    return np.linalg.pinv(product, rcond=1e-12) / np.outer(size[1], size[0])


def change_of(rows: Sequence[Rows], inverse: np.ndarray) -> np.ndarray:
    """(k,) parameter change after which the residual is orthogonal to all instruments."""
    return inverse @ sum(r.instruments.T @ r.residual for r in rows)


def influence_of(rows: Sequence[Rows], inverse: np.ndarray) -> np.ndarray:
    """(INFLUENCE_BLOCKS, k) each block's share of the error of an estimate with these residuals."""
    scores = np.concatenate([r.instruments * r.residual[:, None] for r in rows])
    block = np.arange(len(scores)) * INFLUENCE_BLOCKS // max(len(scores), 1)
    return np.array([scores[block == b].sum(axis=0) for b in range(INFLUENCE_BLOCKS)]) @ inverse.T


def covariance_of(rows: Sequence[Rows], inverse: np.ndarray) -> np.ndarray:
    """(k, k) covariance of an estimate under stationary errors of any spectrum.

    The spectrum is that of the residual, prewhitened by an autoregression and smoothed, over the residual share of
    the fit at each frequency.
    source  Hannan 1963 for the spectrum; Andrews and Monahan 1992 for the autoregression; MacKinnon and White 1985
            (HC3) for the share that the fit absorbs
    """
    found = np.zeros_like(inverse)
    for r in rows:
        n, used = len(r.residual), np.count_nonzero(r.instruments.any(axis=1))
        if not used:
            continue
        size = 1 << (2 * n - 1).bit_length()
        near = SPECTRUM_NEIGHBOURS * size // n
        whitened = np.abs(np.fft.rfft(autoregression(r.residual), size)) ** 2
        power = smooth(np.abs(np.fft.rfft(r.residual, size)) ** 2 * whitened, near) / whitened
        z, x = np.fft.rfft(r.instruments, size, axis=0), np.fft.rfft(r.slopes, size, axis=0)
        absorbed = np.einsum("fi,ij,fj->f", x, inverse, z.conj()).real / n
        residual_share = np.maximum(1.0 - smooth(absorbed, near), MIN_RESIDUAL_SHARE)
        both = np.full(len(power), 2.0)
        both[0] = both[-1] = 1.0  # the other frequencies have a negative twin
        spectrum = both * power / residual_share**2 / (used * size)
        found += ((z.conj().T * spectrum) @ z).real
    return inverse @ found @ inverse.T


def autoregression(values: np.ndarray) -> np.ndarray:
    """(AUTOREGRESSION_ORDER + 1,) coefficients 1, a1, .. that whiten a series, by Yule and Walker."""
    size = 1 << (2 * len(values) - 1).bit_length()
    products = np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)[:AUTOREGRESSION_ORDER + 1]
    if products[0] <= 0.0:
        return np.concatenate([[1.0], np.zeros(AUTOREGRESSION_ORDER)])
    matrix = scipy.linalg.toeplitz(products[:-1]) + WHITE_LOADING * products[0] * np.eye(AUTOREGRESSION_ORDER)
    return np.concatenate([[1.0], -np.linalg.solve(matrix, products[1:])])


def smooth(values: np.ndarray, near: int) -> np.ndarray:
    """The mean over so many neighbours to either side; mirrored at the ends."""
    near = min(near, len(values) - 1)
    padded = np.pad(values, near, mode="reflect")
    sums = np.cumsum(np.concatenate([[0.0], padded]))
    return (sums[2 * near + 1:] - sums[:-2 * near - 1]) / (2.0 * near + 1.0)


def between_block_std(influence: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(k,) standard deviations between blocks of the record beyond stationary errors; zero if not significant.

    influence   (INFLUENCE_BLOCKS, k) shares of the error; covariance: (k, k) under stationary errors
    """
    by_blocks = INFLUENCE_BLOCKS * np.var(influence, axis=0, ddof=1)
    stationary = np.diag(covariance)
    return np.sqrt(np.where(by_blocks > MAX_VARIANCE_RATIO * stationary, by_blocks - stationary, 0.0))
