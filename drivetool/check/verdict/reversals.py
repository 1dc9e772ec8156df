"""The error around reversals, where backlash and dry friction appear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.check.verdict.view import View
from drivetool.identify.estimate import PlotData

# S around a reversal. A choice: the error before is the reference, the effect follows.
TIME_BEFORE_REVERSAL, TIME_AFTER_REVERSAL = 0.1, 0.4
# Of the range that a signal must leave on either side. A choice: noise about zero is no reversal.
REVERSAL_DEAD_BAND = 0.02
MIN_REVERSALS = 3  # reversals. A choice: an average over fewer shows single events


@dataclass(frozen=True)
class Reversals:
    """Where a signal of a record changes its sign: index (k,) of samples, direction (k,) after it."""

    what: str
    index: np.ndarray
    direction: np.ndarray


def reversals_of(views: Sequence[View]) -> list[list[Reversals]]:
    """Per record the reversals of the motor's speed and of the shaft's torque."""
    found = []
    for view in views:
        signals = {"speed": view.speed, f"shaft {view.words[1]}": view.shaft}
        found.append([Reversals(what, *_sign_changes(signal, view.pieces()))
                      for what, signal in signals.items() if signal is not None])
    return found


def _sign_changes(signal: np.ndarray, pieces: Sequence[slice]) -> tuple[np.ndarray, np.ndarray]:
    """(index, direction) of sign changes that leave a dead band on both sides, within one run each."""
    band = REVERSAL_DEAD_BAND * float(np.ptp(signal))
    index, direction = [], []
    for piece in pieces:
        y = signal[piece]
        clear = np.flatnonzero(np.abs(y) > band)
        sides = np.sign(y[clear])
        for k in np.flatnonzero(np.diff(sides) != 0.0):
            a, b = int(clear[k]), int(clear[k + 1])
            zero = a + int(np.argmax(np.sign(y[a:b + 1]) == sides[k + 1]))
            index.append(piece.start + zero)
            direction.append(sides[k + 1])
    return np.array(index, int), np.array(direction, float)


def reversal_plots(views: Sequence[View], reversals: Sequence[Sequence[Reversals]]) -> list[PlotData]:
    """Mean and rms of the error around reversals, with its sign changed where the signal falls."""
    found = []
    step = float(np.median(np.diff(views[0].time)))
    longest = max(len(view.time) for view in views)  # with stamps in a wrong unit a record is shorter than the plot
    before, after = (min(round(time / step), longest) for time in (TIME_BEFORE_REVERSAL, TIME_AFTER_REVERSAL))
    reach = np.arange(-before, after + 1)
    for what in dict.fromkeys(r.what for each in reversals for r in each):
        cuts = {"before": [], "after": []}
        for view, each in zip(views, reversals, strict=True):
            for one in (r for r in each if r.what == what):
                for which, error in view.errors.items():
                    cuts[which] += _errors_around(view, error, one, reach)
        n = len(cuts["before"])
        if n < MIN_REVERSALS:
            continue
        curves = {}
        for which, rows in cuts.items():
            table = np.array(rows)
            with np.errstate(invalid="ignore", divide="ignore"):
                known = np.isfinite(table).sum(axis=0)
                mean = np.nansum(table, axis=0) / known
                size = np.sqrt(np.nansum(table**2, axis=0) / known)
            curves[f"mean {which}"] = (reach * step, mean)
            curves[f"size {which}"] = (reach * step, size)
        label, unit = views[0].words[0], views[0].units[0]
        found.append(PlotData(
            "diagnosis-residual-reversal", f"Error around {n} reversals of the {what}",
            f"time after the {what} changes its sign [s]", f"error of {label} [{unit}]", curves))
    return found


def _errors_around(view: View, error: np.ndarray, one: Reversals, reach: np.ndarray) -> list[np.ndarray]:
    """The error around each reversal, less its mean before, NaN beyond its free run."""
    found = []
    edges = np.array([*view.breaks, len(view.time)])
    for at, side in zip(one.index, one.direction, strict=True):
        k = int(np.searchsorted(edges, at, "right"))
        index = at + reach
        inside = (index >= edges[k - 1]) & (index < edges[k])
        row = np.full(len(reach), np.nan)
        row[inside] = side * error[index[inside]]
        early = row[reach < 0]
        if np.isfinite(early).any():  # a free run carries earlier errors along
            found.append(row - np.nanmean(early))
    return found
