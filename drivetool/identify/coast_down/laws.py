"""The further friction law of a drive whose viscous and Coulomb friction do not suffice, and its gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.identify.coast_down.coast_down_fit import RESIDUAL_BLOCKS, CoastDownFit, Prior, Run, fit, simulated
from drivetool.identify.estimate import Z95
from drivetool.quantity import quantity_of, with_parts

LAWS = {"drag": ("drag",), "stribeck": ("stribeck", "stribeck_speed"),
        "breakaway": ("breakaway", "breakaway_speed")}
LOW_SPEED_LAWS = ("stribeck", "breakaway")  # two forms of one surplus at low speed, of which a body has one
# Of the Coulomb friction: start value of a surplus. A choice: large enough to have a derivative.
START_TO_COULOMB = 0.3
# Start values of its speed, in units of the motion per second. A choice: steps of a factor of five, as each costs a
# fit.
START_SPEEDS = (1.0, 5.0, 25.0)
# Rounds that rank several starts: counts are placed by the fit of the first round in the second.
LAW_SCREENING_ROUNDS = 2
# Probability by chance below which coast-downs differ, and the friction follows another law. A choice: one false
# alarm in a thousand records.
MISFIT_SIGNIFICANCE = 1e-3
# Log likelihood by which a law must lead, after that of its parameters: a likelihood ratio of e^10, one in 22 000.
MIN_LAW_LIKELIHOOD_LEAD = 10.0
# Readings, from the last, at which coast-downs may end: another one stops up to a count sooner or later, and at low
# speed a model without the law errs most.
END_READINGS = (-1, -2, 0)


@dataclass(frozen=True)
class ErrorReduction:
    """Reduction in % of the simulation error on another coast-down from the same speed, with its 95 % interval."""

    percent: float
    low: float
    high: float


@dataclass(frozen=True)
class AdditionalFrictionLaw:
    """Laws that explain the residual and are not distinguishable, the likeliest first; the gain of that one.

    laws    each one law, or two together; names: parameters of the likeliest
    misfit  probability by chance of the residual that the likeliest leaves
    """

    laws: tuple[tuple[str, ...], ...]
    names: tuple[str, ...]
    gain: ErrorReduction
    misfit: float


@dataclass(frozen=True)
class _Trial:
    """A fit with further laws: minus the log likelihood with the penalty for its parameters."""

    laws: tuple[str, ...]
    penalised_loss: float
    drive: Drive
    fitted: CoastDownFit


def start_drives(start: Drive, free: Sequence[str]) -> list[Drive]:
    """Start values of fits: several speeds for each surplus of friction that is free and not known."""
    found = [start]
    for name in free:
        if quantity_of(name) in LOW_SPEED_LAWS and start.value(name) == 0.0:
            surplus = START_TO_COULOMB * (start.value(with_parts(name, quantity="coulomb")) or 0.0)
            found = [d.with_values({name: surplus, f"{name}_speed": v}) for d in found for v in START_SPEEDS]
    return found


def further_law(ended: Drive, free: Sequence[str], runs: Sequence[Run], prior: Prior, fitted: CoastDownFit,
                ) -> AdditionalFrictionLaw | None:
    """Try each law in addition to the fitted ones, and two where one does not suffice; None: none explains it.

    ended  the drive with the fitted values
    """
    present = {law for law in LAWS if f"motor.{law}" in free or ended.value(f"motor.{law}")}
    at_rest = [(law,) for law in LOW_SPEED_LAWS if not present & set(LOW_SPEED_LAWS)]
    drag = [("drag",)] if "drag" not in present else []
    found = [_trial(laws, ended, free, runs, prior) for laws in (*drag, *at_rest)]
    if drag and at_rest and max(t.fitted.misfit for t in found) < MISFIT_SIGNIFICANCE:
        found += [_trial((*drag[0], *t.laws), t.drive, free, runs, prior) for t in found if t.laws in at_rest]
    found = sorted((t for t in found if t.penalised_loss < 0.5 * fitted.deviance - MIN_LAW_LIKELIHOOD_LEAD),
                   key=lambda t: t.penalised_loss)
    if not found:
        return None
    best = found[0]
    alike = tuple(t.laws for t in found if t.penalised_loss < best.penalised_loss + MIN_LAW_LIKELIHOOD_LEAD)
    gains = [_error_reduction(_angle_errors(ended, fitted, runs, end),
                              _angle_errors(best.drive, best.fitted, runs, end)) for end in END_READINGS]
    gain = replace(gains[0], low=min(g.low for g in gains), high=max(g.high for g in gains))
    return AdditionalFrictionLaw(alike, _parameters_of(best.laws), gain, best.fitted.misfit)


def _parameters_of(laws: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"motor.{name}" for law in laws for name in LAWS[law])


def _trial(laws: tuple[str, ...], start: Drive, free: Sequence[str], runs: Sequence[Run], prior: Prior) -> _Trial:
    """The best fit with further laws, from the best start after two rounds; with Schwarz's (BIC) penalty."""
    names = (*free, *_parameters_of(laws))
    starts = start_drives(start, names)
    if len(starts) > 1:
        tries = [fit(drive, names, runs, prior, LAW_SCREENING_ROUNDS) for drive in starts]
        first = min(tries, key=lambda f: f.deviance)
        starts = [start.with_values(first.found)]
    best = fit(starts[0], names, runs, prior)
    price = (len(names) - len(free)) * float(np.log(len(best.weighted_residuals)))
    return _Trial(laws, 0.5 * (best.deviance + price), start.with_values(best.found), best)


def _angle_errors(drive: Drive, fitted: CoastDownFit, runs: Sequence[Run], end: int) -> np.ndarray:
    """(m,) simulated less measured at the samples of the coast-downs, as in `validate`.

    end  reading at which they end, counted from the last; 0: the end of the record
    """
    errors = []
    for run, reading, start in zip(runs, fitted.readings, fitted.starts, strict=True):
        if np.any(run.inputs):
            continue
        seen = slice(int(reading.known[0]), int(reading.known[end]) + 1 if end else None)
        measured = reading.values if reading.counted is None else reading.counted + 0.5 * reading.count
        error = (simulated(drive, run, start)[0] - measured)[seen]
        errors.append(error[np.isfinite(error)])
    return np.concatenate(errors)


def _error_reduction(base: np.ndarray, with_it: np.ndarray) -> ErrorReduction:
    """From errors (m,) without and with the law: its effect recurs on another run, the rest is noise there too.

    The interval is for another run: noise counts twice, in this run and in that. The caller varies the end.
    """
    before, after = float(base @ base), float(with_it @ with_it)
    log = 0.5 * np.log(after / before)
    # The contribution of the noise to the logarithm, less its mean, in sums over blocks longer than its
    # correlation.
    noise = with_it**2 / after - (base**2 - (base - with_it)**2) / before
    sums = np.array([part.sum() for part in np.array_split(noise - noise.mean(), RESIDUAL_BLOCKS)])
    std = 0.5 * float(np.sqrt(2.0 * RESIDUAL_BLOCKS / (RESIDUAL_BLOCKS - 1) * (sums @ sums)))
    low, high = (100.0 * (1.0 - float(np.exp(log + s * Z95 * std))) for s in (1.0, -1.0))
    return ErrorReduction(100.0 * (1.0 - float(np.exp(log))), low, high)
