"""Does the residual still depend on the torque?

The residual is the simulation error filtered by the noise model: the one-step prediction error, for a
linear drive the whitened error of the free run. The free run's own error cannot be tested: torque noise
makes it a random walk, and two random walks correlate by chance (Yule 1926); in closed loop the controller
feeds it back to the torque. One-step prediction errors of a true model are white and independent of every
earlier torque, in closed loop too. So only lags at which the torque comes first are tested; the others show
feedback and are drawn only.

Blocks of samples are averaged to about eight per period of the fastest resonance, so that a faster
logger does not dilute the correlation in sensor noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

LIMIT_97 = 2.17  # normal quantile of a two-sided 97 %
# Blocks per period of the fastest resonance: fewer alias it, more dilute the correlation in noise.
BLOCKS_PER_PERIOD = 8.0
DEFAULT_BLOCK_TIME = 0.01  # s; block of a drive without resonance. A choice: friction and inertia act more slowly
LAG_PERIODS = 5.0  # of the slowest resonance that the lags span. A choice: by then a damped one has decayed
# Lags at most: they bound the covariance matrix. Blocks: their 97 % band, 2.17/sqrt(1500) = 0.06, is well below the
# limit of 0.15. Draws: p = 0.03 then has a standard error of 0.004.
MAX_LAGS, MIN_CORRELATION_BLOCKS, CORRELATION_DRAWS = 100, 1500, 2000
# Blocks over which the residual's own correlation counts. A choice: tapered, later ones add only scatter.
AUTOCORRELATION_BLOCKS = 20
# Of the autoregression that whitens a coloured residual, at most; the Schwarz criterion chooses below.
MAX_WHITENING_ORDER = 10
DEPENDENCE_SIGNIFICANCE = 0.01  # family-wise p. A choice: one false alarm in a hundred right models
ROWS_IN_MEMORY = 8192  # rows of lagged inputs in memory at a time: bounds the memory of long records


@dataclass(frozen=True)
class Correlation:
    """Normalised cross-correlation of residual and inputs.

    lags     (2 m + 1,) [s], positive: the torque came first; r: (inputs, 2 m + 1)
    band     (inputs, m) 97 % band at the positive lags
    largest  |r| over the positive lags; outside: their share outside the band
    p        family-wise over all positive lags and inputs
    chance   |r| that noise alone exceeds in 3 % of records
    """

    lags: np.ndarray
    r: np.ndarray
    band: np.ndarray
    largest: float
    outside: float
    p: float
    chance: float


def correlate(residuals: Sequence[np.ndarray], inputs: Sequence[np.ndarray], step: float,
              resonances: Sequence[float], seed: int) -> Correlation | None:
    """Correlation of residual and inputs with its bands and family-wise p-value.

    The correlations of two independent series at the lags t and s have the covariance
    sum over k of rho_e(k) rho_u(k + t - s) / N (Bartlett 1946); with a white residual the 97 %
    band is 2.17/sqrt(N). rho_e is tapered (Newey, West 1987).
    Family-wise p: the smaller of two, doubled (Bonferroni).
    - The largest |r|/std against draws of normal vectors with that covariance, so that
      neighbouring lags count as the few independent ones they are; beyond the draws, Bonferroni
      over the lags.
    - The share of the residual that any filter of the torque over these lags explains (F test),
      both whitened by the autoregression of the residual, white if the noise model is right. It
      detects the ringing of a wrong stiffness: under a slow torque this averages out of r.
    The model counts as exact: the uncertainty of its fit, where known, is allowed for before
    (fit_confidence_region.py). Taken as exact, one fitted on a record of equal length and the same motion falls
    below p = 0.01 in some 4 % of cases, below 0.001 almost never; in another motion more often.

    residuals   (n,) per stretch, NaN where there is none; inputs: (n, nu) per stretch
    step        sample interval [s]
    resonances  of the drive [Hz]
    returns     Correlation; None: no input changes, or fewer than 20 blocks
    """
    block = block_length(residuals, step, resonances)
    e, u = block_averages(residuals, inputs, block)
    if sum(int(np.isfinite(x).sum()) for x in e) < 20:
        return None
    e, u, known = _centred(e, u)
    n, energy = sum(int(k.sum()) for k in known), sum(float(x @ x) for x in e)
    if energy <= 0.0 or u[0].shape[1] == 0:
        return None
    m = lag_count(n, step * block, resonances)
    input_std = np.sqrt(sum(np.sum(x**2, axis=0) for x in u) * n / sum(map(len, u)))
    norm = np.repeat(input_std, m)
    after, covariance = _bartlett(u, e, known, m, energy)
    r = after / (norm * np.sqrt(energy))
    covariance /= np.outer(norm, norm) * n
    deviation = np.sqrt(np.diag(covariance))
    p_largest, chance = _p_of_largest(r, covariance, deviation, seed)
    before = _negative_lag_products(u, e, m) / (input_std[:, None] * np.sqrt(energy))
    return Correlation(
        np.arange(-m, m + 1) * step * block, np.hstack([before, r.reshape(-1, m)]),
        LIMIT_97 * deviation.reshape(-1, m), float(np.abs(r).max()),
        float(np.mean(np.abs(r) > LIMIT_97 * deviation)),
        min(1.0, 2.0 * min(p_largest, _p_of_explained_share(u, e, known, m))), chance)


def block_length(residuals: Sequence[np.ndarray], step: float, resonances: Sequence[float]) -> int:
    """Samples per block: eight blocks per period, but 1500 blocks if there are so many samples.

    No shorter than the interval of a slow sensor.
    """
    size, there = sum(map(len, residuals)), sum(int(np.isfinite(x).sum()) for x in residuals)
    wanted = 1.0 / (BLOCKS_PER_PERIOD * max(resonances)) if len(resonances) else DEFAULT_BLOCK_TIME
    return max(1, min(round(wanted / step), size // MIN_CORRELATION_BLOCKS), round(size / max(there, 1)))


def lag_count(n: int, step: float, resonances: Sequence[float]) -> int:
    """Lags over five periods of the slowest resonance, 20 to 100 of them, at most n/4."""
    wanted = round(LAG_PERIODS / (min(resonances) * step)) if len(resonances) else MAX_LAGS
    return max(1, min(max(wanted, 20), MAX_LAGS, n // 4))


def block_averages(residuals: Sequence[np.ndarray], inputs: Sequence[np.ndarray],
            block: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Residuals summed over blocks to keep their variance, inputs averaged over them."""
    e, u = [], []
    for x, v in zip(residuals, inputs, strict=True):
        m = len(x) // block
        if m < 2:
            continue
        x, v = x[:m * block].reshape(m, block), v[:m * block].reshape(m, block, -1)
        count = np.isfinite(x).sum(axis=1)
        e.append(np.where(count > 0, np.nansum(x, axis=1) / np.sqrt(np.maximum(count, 1)), np.nan))
        u.append(v.mean(axis=1))
    return e, u


def whiteness(residuals: Sequence[np.ndarray], lags: int = 20) -> float | None:
    """p-value of the Ljung-Box test of one-step prediction errors, NaN where unmeasured; None: too few."""
    n = int(sum(np.isfinite(x).sum() for x in residuals))
    e = [np.where(np.isfinite(x), x, 0.0) for x in residuals]
    own = _autocorrelation(e, lags)
    if n < 5 * lags or own[0] <= 0.0:
        return None
    rho = own[1:] / own[0]
    return float(scipy.stats.chi2.sf(n * (n + 2.0) * np.sum(rho**2 / (n - np.arange(1, lags + 1))), lags))


def _centred(e: Sequence[np.ndarray], u: Sequence[np.ndarray]):
    """Residuals without mean, zero where unmeasured; the inputs that change; where residuals are measured."""
    known = [np.isfinite(x) for x in e]
    every = np.concatenate(u)
    mean = sum(x[k].sum() for x, k in zip(e, known, strict=True)) / max(sum(k.sum() for k in known), 1)
    level, moving = every.mean(axis=0), np.ptp(every, axis=0) > 0.0
    return ([np.where(k, x - mean, 0.0) for x, k in zip(e, known, strict=True)],
            [(x - level)[:, moving] for x in u], known)


def _lagged_products(u: Sequence[np.ndarray], e: Sequence[np.ndarray], v: Sequence[np.ndarray],
          known: Sequence[np.ndarray], m: int) -> tuple[np.ndarray, np.ndarray]:
    """(U' e, U' V) with the lags 1..m of every input in the columns; held before a stretch."""
    def lagged(x: np.ndarray) -> list[np.ndarray]:
        padded = np.pad(x[:-1], ((m, 0), (0, 0)), mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, m, axis=0)
        return windows[:, :, ::-1]

    total_e, total_v = 0.0, 0.0
    for x, y, z, k in zip(u, e, v, known, strict=True):
        left, right = lagged(x), lagged(z)
        for a in range(0, len(x), ROWS_IN_MEMORY):
            part = slice(a, min(len(x), a + ROWS_IN_MEMORY))
            here = left[part].reshape(part.stop - a, -1) * k[part, None]
            total_e = total_e + here.T @ y[part]
            total_v = total_v + here.T @ right[part].reshape(part.stop - a, -1)
    return total_e, total_v


def _bartlett(u: Sequence[np.ndarray], e: Sequence[np.ndarray], known: Sequence[np.ndarray], m: int,
              energy: float) -> tuple[np.ndarray, np.ndarray]:
    """Sums of residual and lagged inputs, and their covariance over the residual's variance."""
    rho = _autocorrelation(e, AUTOCORRELATION_BLOCKS) / energy * (
        1.0 - np.arange(AUTOCORRELATION_BLOCKS + 1) / (AUTOCORRELATION_BLOCKS + 1.0))
    filter_ = np.concatenate([rho[:0:-1], rho])
    held = [np.pad(x, ((AUTOCORRELATION_BLOCKS, AUTOCORRELATION_BLOCKS), (0, 0)), mode="edge") for x in u]
    v = [np.column_stack([np.convolve(column, filter_, "valid") for column in x.T]) for x in held]
    after, covariance = _lagged_products(u, e, v, known, m)
    return after, 0.5 * (covariance + covariance.T)


def _negative_lag_products(u: Sequence[np.ndarray], e: Sequence[np.ndarray], m: int) -> np.ndarray:
    """(inputs, m + 1) sums of residual and input at lags -m..0."""
    return np.array([[sum(float(x[:len(x) - k] @ v[k:, j]) for x, v in zip(e, u, strict=True) if len(x) > k)
                      for k in range(m, -1, -1)] for j in range(u[0].shape[1])])


def _autocorrelation(e: Sequence[np.ndarray], lags: int) -> np.ndarray:
    """(lags + 1,) sums of products of a series with itself."""
    return np.array([sum(float(x[k:] @ x[:len(x) - k]) for x in e if len(x) > k) for k in range(lags + 1)])


def _p_of_largest(r: np.ndarray, covariance: np.ndarray, deviation: np.ndarray,
             seed: int) -> tuple[float, float]:
    """(p-value of the largest |r|/std, |r| exceeded by chance in 3 % of records)."""
    values, vectors = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    values = np.sqrt(np.maximum(values, 0.0))
    draws = np.abs(np.random.default_rng(seed).standard_normal((CORRELATION_DRAWS, len(r))) * values @ vectors.T)
    z = float(np.max(np.abs(r) / deviation))
    above = int(np.sum(draws.max(axis=1) >= z))
    p = min((1 + above) / (1 + CORRELATION_DRAWS), 2.0 * len(r) * float(scipy.stats.norm.sf(z)))
    return p, float(np.quantile((draws * deviation).max(axis=1), 0.97))


def _p_of_explained_share(u: Sequence[np.ndarray], e: Sequence[np.ndarray], known: Sequence[np.ndarray],
               m: int) -> float:
    """p-value of the share of the whitened residual that the lagged whitened inputs explain."""
    n = sum(int(k.sum()) for k in known)
    a = _whitener(e, n) if all(k.all() for k in known) else np.ones(1)
    e = [scipy.signal.lfilter(a, 1.0, x) for x in e]
    u = [scipy.signal.lfilter(a, 1.0, x - x[:1], axis=0) + a.sum() * x[:1] for x in u]
    after, gram = _lagged_products(u, e, u, known, m)
    values, vectors = np.linalg.eigh(gram)
    keep = values > 1e-8 * values[-1]
    k = int(keep.sum())
    share = float(np.sum((vectors[:, keep].T @ after) ** 2 / values[keep])) / sum(float(x @ x) for x in e)
    return float(scipy.stats.beta.sf(min(share, 1.0), k / 2.0, (n - k) / 2.0))


def _whitener(e: Sequence[np.ndarray], n: int) -> np.ndarray:
    """Autoregression 1, a1, .. of a series, its order by the Schwarz criterion."""
    own = _autocorrelation(e, min(MAX_WHITENING_ORDER, n // 10))
    best, found = n * np.log(own[0]), np.ones(1)
    for order in range(1, len(own)):
        a = scipy.linalg.solve_toeplitz(own[:order], -own[1:order + 1])
        variance = own[0] + a @ own[1:order + 1]
        if variance > 0.0 and n * np.log(variance) + order * np.log(n) < best:
            best, found = n * np.log(variance) + order * np.log(n), np.concatenate([[1.0], a])
    return found
