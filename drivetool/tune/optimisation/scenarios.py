"""Possible drives: draws from the covariance of the parameter file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import BadParameters
from drivetool.identify.estimate import Covariance
from drivetool.tune.optimisation.criteria import signals
from drivetool.tune.optimisation.load_step_factors import speed_factors
from drivetool.tune.optimisation.search import sensitivity_of
from drivetool.tune.optimisation.sections import SpreadSection
from drivetool.tune.speed_loop import Loop, Settings, Wiring, build, plant

QUANTILE_LEVELS = (0.05, 0.5, 0.95)  # median and a 90 % interval, which 200 draws still resolve


@dataclass(frozen=True)
class Draws:
    """Drives drawn from the uncertainty of the file.

    drives        physical ones, with nominal values of parameters without uncertainty
    unphysical    draws beyond a bound of a parameter; left out
    names         of the parameters that vary
    """

    drives: tuple[Drive, ...]
    unphysical: int
    names: tuple[str, ...]


class FigureSpread(SpreadSection):
    """How figures of a tuned loop spread over the draws; an unstable draw counts as infinite.

    samples  figure -> (draws,) values, for pictures
    """

    samples: dict[str, np.ndarray]


def joint_covariance(drive: Drive, known: Covariance | None, stds: Mapping[str, float]) -> Covariance | None:
    """The covariance of all parameters with an uncertainty; uncorrelated if no correlation is known.

    known  of the parameter file, in the units of the drive
    stds   standard deviations of single parameters; those in `known` are not used
    """
    names = [n for n in (known.names if known else ()) if drive.value(n) is not None]
    uncorrelated = [n for n in stds if n not in names and stds[n] > 0.0 and drive.value(n) is not None]
    if not names and not uncorrelated:
        return None
    matrix = np.zeros((len(names) + len(uncorrelated),) * 2)
    if names:
        matrix[:len(names), :len(names)] = known.part(names).matrix
    for k, name in enumerate(uncorrelated, len(names)):
        matrix[k, k] = stds[name] ** 2
    return Covariance((*names, *uncorrelated), matrix)


def draw_drives(drive: Drive, covariance: Covariance, count: int, seed: int) -> Draws:
    """Normal draws with all correlations.

    count   requested; those that are not physical are left out and counted
    seed    of the draws
    raises  BadParameters: an invalid covariance, or no physical draw
    """
    root = _covariance_root(covariance)
    rng = np.random.default_rng(seed)
    centre = np.array([drive.value(n) for n in covariance.names])
    drives, unphysical = [], 0
    for values in centre + rng.standard_normal((count, len(centre))) @ root.T:
        try:
            drives.append(drive.with_values(dict(zip(covariance.names, map(float, values), strict=True))))
        except BadParameters:
            unphysical += 1
    if not drives:
        raise BadParameters("a covariance with at least one physical draw", f"{count} draws, none of them physical",
                            "The parameters are too uncertain for a robust design; identify them better.")
    return Draws(tuple(drives), unphysical, covariance.names)


def _covariance_root(covariance: Covariance) -> np.ndarray:
    """(k, k) R with R R' the covariance, which rounding may have made slightly indefinite."""
    scale = np.sqrt(np.clip(np.diag(covariance.matrix), 0.0, None))
    scale[scale == 0.0] = 1.0
    correlation = 0.5 * (covariance.matrix + covariance.matrix.T) / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(correlation)
    if values.min() < -1e-6 * max(values.max(), 1.0):
        raise BadParameters("a covariance without negative variances",
                            f"{values.min():.3g} along one direction of {', '.join(covariance.names)}",
                            "Correct the covariance section of the parameter file, or delete it.")
    return scale[:, None] * vectors * np.sqrt(np.clip(values, 0.0, None))


def spread_of_figures(draws: Draws, wiring: Wiring, settings: Settings, limit: float) -> FigureSpread:
    """Sensitivity, impact drop and overshoot of one setting over the draws."""
    rows = [loop_figures(build(drive, wiring), settings) for drive in draws.drives]
    samples = {name: np.array(values) for name, values in zip(
        ("max_sensitivity", "impact_drop", "overshoot"), zip(*rows, strict=True), strict=True)}
    return FigureSpread(
        len(draws.drives) + draws.unphysical, draws.unphysical, int(np.isinf(samples["max_sensitivity"]).sum()),
        list(draws.names), float(np.mean(samples["max_sensitivity"] > limit * (1.0 + 1e-9))),
        {name: {f"{level:g}": _quantile(values, level) for level in QUANTILE_LEVELS}
         for name, values in samples.items()}, samples)


def loop_figures(loop: Loop, settings: Settings) -> tuple[float, float, float]:
    """(Ms, impact drop, overshoot [%]) of the load speed; infinite where unstable."""
    ms = sensitivity_of(loop, plant(loop.drive, loop.wiring), settings)
    if np.isinf(ms):
        return np.inf, np.inf, np.inf
    found = speed_factors(signals(loop, settings, ["load_speed"])["load_speed"])
    return ms, found.impact_drop, found.overshoot


def _quantile(values: np.ndarray, level: float) -> float:
    """The smallest value that a share `level` of the draws does not exceed."""
    ordered = np.sort(values)
    return float(ordered[min(len(ordered) - 1, max(0, int(np.ceil(level * len(ordered) - 1e-9)) - 1))])
