"""A linear estimate with or without instruments, and its covariance under errors that are correlated in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import toeplitz
from scipy.stats import chi2

BLOCKS = 16  # contiguous, so that errors may be correlated within (Bester, Conley, Hansen 2011)
# Frequencies to either side over which the residual's spectrum is smoothed: 33 together know its level to 18 per
# cent, and the noise of a drive changes little over so few periods of the record.
NEAR = 16
ORDER = 4  # of the autoregression that takes the slope out of a spectrum before it is smoothed
LOADED = 1e-6  # of the power, added as white: what the filter has taken out altogether has no autoregression
LEAST_LEFT = 0.1  # of the power at a frequency, that a fit is taken to leave at least
BY_CHANCE = float(chi2.ppf(0.99, BLOCKS - 1)) / (BLOCKS - 1)  # ratio of variances up to which blocks say nothing


@dataclass(frozen=True)
class Rows:
    """Equations of a recording at even times: residual (n,), slopes and instruments (n, k); zero where unused."""

    residual: np.ndarray
    slopes: np.ndarray
    instruments: np.ndarray


def inverse_of(rows: Sequence[Rows]) -> np.ndarray:
    """(k, k) inverse of instruments times slopes; without the directions that nothing tells."""
    z, x = (np.concatenate([getattr(r, name) for r in rows]) for name in ("instruments", "slopes"))
    size = [np.sqrt(np.mean(m**2, axis=0)) for m in (z, x)]
    for s in size:
        s[s == 0.0] = 1.0
    product = (z / size[0]).T @ (x / size[1])
    return np.linalg.pinv(product, rcond=1e-12) / np.outer(size[1], size[0])


def change_of(rows: Sequence[Rows], inverse: np.ndarray) -> np.ndarray:
    """(k,) by which the parameters change until no instrument sees a residual."""
    return inverse @ sum(r.instruments.T @ r.residual for r in rows)


def influence_of(rows: Sequence[Rows], inverse: np.ndarray) -> np.ndarray:
    """(BLOCKS, k) each block's share of the error of an estimate that leaves these residuals."""
    scores = np.concatenate([r.instruments * r.residual[:, None] for r in rows])
    block = np.arange(len(scores)) * BLOCKS // max(len(scores), 1)
    return np.array([scores[block == b].sum(axis=0) for b in range(BLOCKS)]) @ inverse.T


def covariance_of(rows: Sequence[Rows], inverse: np.ndarray) -> np.ndarray:
    """(k, k) covariance of an estimate under stationary errors of any spectrum.

    The spectrum is that of the residual, smoothed beside an autoregression, over the share that the fit has left at
    each frequency.
    source  Hannan 1963 for the spectrum; Andrews and Monahan 1992 for the autoregression; MacKinnon and White 1985
            (HC3) for what the fit takes up
    """
    found = np.zeros_like(inverse)
    for r in rows:
        n, used = len(r.residual), np.count_nonzero(r.instruments.any(axis=1))
        if not used:
            continue
        size = 1 << (2 * n - 1).bit_length()
        near = NEAR * size // n
        whitened = np.abs(np.fft.rfft(autoregression(r.residual), size)) ** 2
        power = smooth(np.abs(np.fft.rfft(r.residual, size)) ** 2 * whitened, near) / whitened
        z, x = np.fft.rfft(r.instruments, size, axis=0), np.fft.rfft(r.slopes, size, axis=0)
        taken = np.einsum("fi,ij,fj->f", x, inverse, z.conj()).real / n
        left = np.maximum(1.0 - smooth(taken, near), LEAST_LEFT)
        both = np.full(len(power), 2.0)
        both[0] = both[-1] = 1.0  # the other frequencies have a negative twin
        spectrum = both * power / left**2 / (used * size)
        found += ((z.conj().T * spectrum) @ z).real
    return inverse @ found @ inverse.T


def autoregression(values: np.ndarray) -> np.ndarray:
    """(ORDER + 1,) coefficients 1, a1, .. that whiten a series, by Yule and Walker."""
    size = 1 << (2 * len(values) - 1).bit_length()
    products = np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)[:ORDER + 1]
    if products[0] <= 0.0:
        return np.concatenate([[1.0], np.zeros(ORDER)])
    matrix = toeplitz(products[:-1]) + LOADED * products[0] * np.eye(ORDER)
    return np.concatenate([[1.0], -np.linalg.solve(matrix, products[1:])])


def smooth(values: np.ndarray, near: int) -> np.ndarray:
    """The mean over so many neighbours to either side; at the ends they are mirrored."""
    near = min(near, len(values) - 1)
    padded = np.pad(values, near, mode="reflect")
    sums = np.cumsum(np.concatenate([[0.0], padded]))
    return (sums[2 * near + 1:] - sums[:-2 * near - 1]) / (2.0 * near + 1.0)


def beyond_stationary(influence: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(k,) standard deviations that blocks of the record show beyond stationary errors; zero where it is chance.

    influence   (BLOCKS, k) shares of the error; covariance: (k, k) under stationary errors
    """
    by_blocks = BLOCKS * np.var(influence, axis=0, ddof=1)
    stationary = np.diag(covariance)
    return np.sqrt(np.where(by_blocks > BY_CHANCE * stationary, by_blocks - stationary, 0.0))
