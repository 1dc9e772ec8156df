"""Which further law a friction follows that viscous and Coulomb friction leave incomplete, and what it gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.identify.coast_down.run_down_fit import BLOCKS, Fitted, Prior, Run, fit, simulated
from drivetool.identify.estimate import Z95

LAWS = {"drag": ("drag",), "stribeck": ("stribeck", "stribeck_speed"),
        "breakaway": ("breakaway", "breakaway_speed")}
AT_REST = ("stribeck", "breakaway")  # two forms of one surplus at low speed, of which a body has one
SURPLUS = tuple(f".{law}" for law in AT_REST)  # each with a speed of its own
SHARE = 0.3  # of the Coulomb friction, from which a surplus begins
SPEEDS = (1.0, 5.0, 25.0)  # from which its speed begins, in units of the motion per second
SCREENING = 2  # rounds after which the best of several starts shows: counts are then placed by the fit of the first
UNLIKELY = 1e-3  # chance below which run-downs are said to differ, and a law to be another
# Log likelihood by which a law must lead, after that of its parameters: a likelihood ratio of e^10, one in 22 000.
LEAD = 10.0
# Readings, from the last, at which run-downs may end: another one stops up to a count sooner or later, and where it
# is slow a model without the law errs most.
ENDS = (-1, -2, 0)


@dataclass(frozen=True)
class Gain:
    """By how many per cent the error of the simulation falls on another run-down from the same speed, with 95 %."""

    percent: float
    low: float
    high: float


@dataclass(frozen=True)
class Further:
    """Laws that explain what is left, alike but for chance, the likeliest first; what that one gains.

    laws    each one law, or two together; names: parameters of the likeliest
    misfit  probability that chance leaves what the likeliest leaves
    """

    laws: tuple[tuple[str, ...], ...]
    names: tuple[str, ...]
    gain: Gain
    misfit: float


@dataclass(frozen=True)
class _Trial:
    """What a fit with further laws came to: minus the log likelihood with the price of its parameters."""

    laws: tuple[str, ...]
    unlikely: float
    drive: Drive
    fitted: Fitted


def begun(start: Drive, free: Sequence[str]) -> list[Drive]:
    """Where fits begin: at several speeds of a surplus of friction that is free and not known."""
    found = [start]
    for name in free:
        if name.endswith(SURPLUS) and start.value(name) == 0.0:
            surplus = SHARE * (start.value(name.rpartition(".")[0] + ".coulomb") or 0.0)
            found = [d.with_values({name: surplus, f"{name}_speed": v}) for d in found for v in SPEEDS]
    return found


def further_law(ended: Drive, free: Sequence[str], runs: Sequence[Run], prior: Prior, fitted: Fitted,
                ) -> Further | None:
    """Try each law on top of what was fitted, and two where one leaves something; None: none explains it.

    ended  the drive with what was fitted
    """
    present = {law for law in LAWS if f"motor.{law}" in free or ended.value(f"motor.{law}")}
    at_rest = [(law,) for law in AT_REST if not present & set(AT_REST)]
    drag = [("drag",)] if "drag" not in present else []
    found = [_tried(laws, ended, free, runs, prior) for laws in (*drag, *at_rest)]
    if drag and at_rest and max(t.fitted.misfit for t in found) < UNLIKELY:
        found += [_tried((*drag[0], *t.laws), t.drive, free, runs, prior) for t in found if t.laws in at_rest]
    found = sorted((t for t in found if t.unlikely < 0.5 * fitted.unlikely - LEAD), key=lambda t: t.unlikely)
    if not found:
        return None
    best = found[0]
    alike = tuple(t.laws for t in found if t.unlikely < best.unlikely + LEAD)
    gains = [_gain(_errors(ended, fitted, runs, end), _errors(best.drive, best.fitted, runs, end)) for end in ENDS]
    gain = replace(gains[0], low=min(g.low for g in gains), high=max(g.high for g in gains))
    return Further(alike, _names(best.laws), gain, best.fitted.misfit)


def _names(laws: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"motor.{name}" for law in laws for name in LAWS[law])


def _tried(laws: tuple[str, ...], start: Drive, free: Sequence[str], runs: Sequence[Run], prior: Prior) -> _Trial:
    """The best fit with further laws; of several starts the one that is ahead after two rounds. Schwarz's price."""
    names = (*free, *_names(laws))
    starts = begun(start, names)
    if len(starts) > 1:
        tries = [fit(drive, names, runs, prior, SCREENING) for drive in starts]
        first = min(tries, key=lambda f: f.unlikely)
        starts = [start.with_values(first.found)]
    best = fit(starts[0], names, runs, prior)
    price = (len(names) - len(free)) * float(np.log(len(best.left)))
    return _Trial(laws, 0.5 * (best.unlikely + price), start.with_values(best.found), best)


def _errors(drive: Drive, fitted: Fitted, runs: Sequence[Run], end: int) -> np.ndarray:
    """(m,) simulated less measured at the samples of the run-downs, as `validate` has it.

    end  reading at which they end, counted from the last; 0: the end of the record
    """
    left = []
    for run, reading, start in zip(runs, fitted.readings, fitted.starts, strict=True):
        if np.any(run.inputs):
            continue
        seen = slice(int(reading.known[0]), int(reading.known[end]) + 1 if end else None)
        measured = reading.values if reading.counted is None else reading.counted + 0.5 * reading.count
        error = (simulated(drive, run, start)[0] - measured)[seen]
        left.append(error[np.isfinite(error)])
    return np.concatenate(left)


def _gain(base: np.ndarray, with_it: np.ndarray) -> Gain:
    """From errors (m,) of both: what the law makes up for is the same on another run, the rest is chance there too.

    The interval is of another run: chance counts twice, here and there. Where it stops is in the caller's.
    """
    before, after = float(base @ base), float(with_it @ with_it)
    log = 0.5 * np.log(after / before)
    # Where the noise enters the logarithm, its mean apart, in sums over blocks longer than its correlation.
    chance = with_it**2 / after - (base**2 - (base - with_it)**2) / before
    sums = np.array([part.sum() for part in np.array_split(chance - chance.mean(), BLOCKS)])
    std = 0.5 * float(np.sqrt(2.0 * BLOCKS / (BLOCKS - 1) * (sums @ sums)))
    least, most = (100.0 * (1.0 - float(np.exp(log + s * Z95 * std))) for s in (1.0, -1.0))
    return Gain(100.0 * (1.0 - float(np.exp(log))), least, most)
