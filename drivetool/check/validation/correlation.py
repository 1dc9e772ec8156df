"""Does what the model leaves over still depend on the torque?

The residual is the simulation error seen through the noise model: the error of one-step
prediction, for a linear drive the whitened error of the free run. The free run's own error cannot
be judged: torque noise makes it wander, and two wandering series correlate by chance (Yule 1926);
in closed loop the controller lets the torque answer it. One-step errors of a true model are white
and independent of every earlier torque, in closed loop too. So only lags at which the torque comes
first are judged; the others show feedback and are drawn only.

Blocks of samples are averaged to about eight per period of the fastest resonance, so that a faster
logger does not dilute the correlation in sensor noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LIMIT_97 = 2.17  # normal quantile of a two-sided 97 %
PER_PERIOD = 8.0  # blocks per period of the fastest resonance
STEP = 0.01  # s; block of a drive without resonance
PERIODS = 5.0  # of the slowest resonance that the lags span
MOST_LAGS, FEWEST_BLOCKS, DRAWS = 100, 1500, 2000
MEMORY = 20  # blocks over which the residual's own correlation is counted
ORDER = 10  # most of the autoregression that whitens what the noise model left coloured
ALARM = 0.01  # family-wise p below which the residual is said to depend on the torque
CHUNK = 8192  # rows of lagged inputs in memory at a time


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
      sees the ringing that a wrong stiffness leaves: over a slow torque it averages out of r.
    The model counts as exact: where its fit is known, what that leaves open is allowed for before (left_open.py).
    Taken as exact, one fitted on a record of equal length and the same motion falls below p = 0.01 in some 4 % of
    cases, below 0.001 as good as never; in another motion more often.

    residuals   (n,) per stretch, NaN where there is none; inputs: (n, nu) per stretch
    step        sample interval [s]
    resonances  of the drive [Hz]
    returns     Correlation; None: no input changes, or fewer than 20 blocks
    """
    block = block_length(residuals, step, resonances)
    e, u = thinned(residuals, inputs, block)
    if sum(int(np.isfinite(x).sum()) for x in e) < 20:
        return None
    e, u, known = _centred(e, u)
    n, energy = sum(int(k.sum()) for k in known), sum(float(x @ x) for x in e)
    if energy <= 0.0 or u[0].shape[1] == 0:
        return None
    m = lag_count(n, step * block, resonances)
    spread = np.sqrt(sum(np.sum(x**2, axis=0) for x in u) * n / sum(map(len, u)))
    norm = np.repeat(spread, m)
    after, covariance = _bartlett(u, e, known, m, energy)
    r = after / (norm * np.sqrt(energy))
    covariance /= np.outer(norm, norm) * n
    deviation = np.sqrt(np.diag(covariance))
    p_largest, chance = _largest(r, covariance, deviation, seed)
    before = _before(u, e, m) / (spread[:, None] * np.sqrt(energy))
    return Correlation(
        np.arange(-m, m + 1) * step * block, np.hstack([before, r.reshape(-1, m)]),
        LIMIT_97 * deviation.reshape(-1, m), float(np.abs(r).max()),
        float(np.mean(np.abs(r) > LIMIT_97 * deviation)),
        min(1.0, 2.0 * min(p_largest, _explained(u, e, known, m))), chance)


def block_length(residuals: Sequence[np.ndarray], step: float, resonances: Sequence[float]) -> int:
    """Samples per block: eight blocks per period, but 1500 blocks if there are so many samples.

    No shorter than the interval of a slow sensor.
    """
    size, there = sum(map(len, residuals)), sum(int(np.isfinite(x).sum()) for x in residuals)
    wanted = 1.0 / (PER_PERIOD * max(resonances)) if len(resonances) else STEP
    return max(1, min(round(wanted / step), size // FEWEST_BLOCKS), round(size / max(there, 1)))


def lag_count(n: int, step: float, resonances: Sequence[float]) -> int:
    """Lags over five periods of the slowest resonance, 20 to 100 of them, at most n/4."""
    wanted = round(PERIODS / (min(resonances) * step)) if len(resonances) else MOST_LAGS
    return max(1, min(max(wanted, 20), MOST_LAGS, n // 4))


def thinned(residuals: Sequence[np.ndarray], inputs: Sequence[np.ndarray],
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
    """p-value of the Ljung-Box test of one-step errors, NaN where there is none; None: too few."""
    from scipy.stats import chi2

    n = int(sum(np.isfinite(x).sum() for x in residuals))
    e = [np.where(np.isfinite(x), x, 0.0) for x in residuals]
    own = _autocorrelation(e, lags)
    if n < 5 * lags or own[0] <= 0.0:
        return None
    rho = own[1:] / own[0]
    return float(chi2.sf(n * (n + 2.0) * np.sum(rho**2 / (n - np.arange(1, lags + 1))), lags))


def _centred(e: Sequence[np.ndarray], u: Sequence[np.ndarray]):
    """Residuals without mean, zero where there is none; the inputs that change; what is known."""
    known = [np.isfinite(x) for x in e]
    every = np.concatenate(u)
    mean = sum(x[k].sum() for x, k in zip(e, known, strict=True)) / max(sum(k.sum() for k in known), 1)
    level, moving = every.mean(axis=0), np.ptp(every, axis=0) > 0.0
    return ([np.where(k, x - mean, 0.0) for x, k in zip(e, known, strict=True)],
            [(x - level)[:, moving] for x in u], known)


def _sums(u: Sequence[np.ndarray], e: Sequence[np.ndarray], v: Sequence[np.ndarray],
          known: Sequence[np.ndarray], m: int) -> tuple[np.ndarray, np.ndarray]:
    """(U' e, U' V) with the lags 1..m of every input in the columns; held before a stretch."""
    def lagged(x: np.ndarray) -> list[np.ndarray]:
        padded = np.pad(x[:-1], ((m, 0), (0, 0)), mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, m, axis=0)
        return windows[:, :, ::-1]

    total_e, total_v = 0.0, 0.0
    for x, y, z, k in zip(u, e, v, known, strict=True):
        left, right = lagged(x), lagged(z)
        for a in range(0, len(x), CHUNK):
            part = slice(a, min(len(x), a + CHUNK))
            here = left[part].reshape(part.stop - a, -1) * k[part, None]
            total_e = total_e + here.T @ y[part]
            total_v = total_v + here.T @ right[part].reshape(part.stop - a, -1)
    return total_e, total_v


def _bartlett(u: Sequence[np.ndarray], e: Sequence[np.ndarray], known: Sequence[np.ndarray], m: int,
              energy: float) -> tuple[np.ndarray, np.ndarray]:
    """Sums of residual and lagged inputs, and their covariance over the residual's variance."""
    rho = _autocorrelation(e, MEMORY) / energy * (1.0 - np.arange(MEMORY + 1) / (MEMORY + 1.0))
    filter_ = np.concatenate([rho[:0:-1], rho])
    held = [np.pad(x, ((MEMORY, MEMORY), (0, 0)), mode="edge") for x in u]
    v = [np.column_stack([np.convolve(column, filter_, "valid") for column in x.T]) for x in held]
    after, covariance = _sums(u, e, v, known, m)
    return after, 0.5 * (covariance + covariance.T)


def _before(u: Sequence[np.ndarray], e: Sequence[np.ndarray], m: int) -> np.ndarray:
    """(inputs, m + 1) sums of residual and input at lags -m..0."""
    return np.array([[sum(float(x[:len(x) - k] @ v[k:, j]) for x, v in zip(e, u, strict=True) if len(x) > k)
                      for k in range(m, -1, -1)] for j in range(u[0].shape[1])])


def _autocorrelation(e: Sequence[np.ndarray], lags: int) -> np.ndarray:
    """(lags + 1,) sums of products of a series with itself."""
    return np.array([sum(float(x[k:] @ x[:len(x) - k]) for x in e if len(x) > k) for k in range(lags + 1)])


def _largest(r: np.ndarray, covariance: np.ndarray, deviation: np.ndarray,
             seed: int) -> tuple[float, float]:
    """(p-value of the largest |r|/std, |r| exceeded by chance in 3 % of records)."""
    from scipy.stats import norm

    values, vectors = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    values = np.sqrt(np.maximum(values, 0.0))
    draws = np.abs(np.random.default_rng(seed).standard_normal((DRAWS, len(r))) * values @ vectors.T)
    z = float(np.max(np.abs(r) / deviation))
    above = int(np.sum(draws.max(axis=1) >= z))
    p = min((1 + above) / (1 + DRAWS), 2.0 * len(r) * float(norm.sf(z)))
    return p, float(np.quantile((draws * deviation).max(axis=1), 0.97))


def _explained(u: Sequence[np.ndarray], e: Sequence[np.ndarray], known: Sequence[np.ndarray],
               m: int) -> float:
    """p-value of the share of the whitened residual that the lagged whitened inputs explain."""
    from scipy.signal import lfilter
    from scipy.stats import beta

    n = sum(int(k.sum()) for k in known)
    a = _whitener(e, n) if all(k.all() for k in known) else np.ones(1)
    e = [lfilter(a, 1.0, x) for x in e]
    u = [lfilter(a, 1.0, x - x[:1], axis=0) + a.sum() * x[:1] for x in u]
    after, gram = _sums(u, e, u, known, m)
    values, vectors = np.linalg.eigh(gram)
    keep = values > 1e-8 * values[-1]
    k = int(keep.sum())
    share = float(np.sum((vectors[:, keep].T @ after) ** 2 / values[keep])) / sum(float(x @ x) for x in e)
    return float(beta.sf(min(share, 1.0), k / 2.0, (n - k) / 2.0))


def _whitener(e: Sequence[np.ndarray], n: int) -> np.ndarray:
    """Autoregression 1, a1, .. of a series, its order by the Schwarz criterion."""
    from scipy.linalg import solve_toeplitz

    own = _autocorrelation(e, min(ORDER, n // 10))
    best, found = n * np.log(own[0]), np.ones(1)
    for order in range(1, len(own)):
        a = solve_toeplitz(own[:order], -own[1:order + 1])
        left = own[0] + a @ own[1:order + 1]
        if left > 0.0 and n * np.log(left) + order * np.log(n) < best:
            best, found = n * np.log(left) + order * np.log(n), np.concatenate([[1.0], a])
    return found
