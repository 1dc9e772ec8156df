"""Six axes in closed position control: parameters by inverse dynamics, with instruments and by least squares.

    python -m tests.study.study_instruments [records] [shift]

The loop feeds encoder noise and steps back into the logged torque. A torque disturbance inside the loop, or noise
of the log alone, has 1, 3 or 10 % of the torque of the fastest move. One line per axis, kind and size: of every
parameter the mean error over the scatter, and how often the 95 % interval of the noise part, and the whole one,
held the truth. Least squares, for comparison, has a quarter of the records.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from drivetool.identify.estimate import Z95
from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from tests.identify.loop import MACHINES, Axis, loop_record

RECORDS = 400
FIRST_SEED = 610_000
SIZES = (0.01, 0.03, 0.1)
KINDS = ("disturbance", "log_noise")


def errors_of(axis: Axis, kind: str, size: float, with_reference: bool, seeds: range) -> np.ndarray:
    """(records, parameters, 3) errors, std by noise and std of all; NaN where no interval is stated."""
    found = []
    for seed in seeds:
        made = loop_record(axis, seed, **{kind: size})
        if not with_reference:
            made = replace(made, signals={n: made.signals[n] for n in ("motor_torque", "motor_angle")})
        estimate = greybox([made], axis.start, Options(criterion="inverse"))
        lines = {p.name: p for p in estimate.parameters}
        found.append([(lines[n].value - v, _or_nan(lines[n].std_noise), _or_nan(lines[n].std))
                      for n, v in axis.truth.items()])
    return np.array(found)


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def line_of(name: str, errors: np.ndarray) -> str:
    """The errors of one situation."""
    e, noise, whole = np.moveaxis(errors, 2, 0)
    cells = [np.abs(e.mean(axis=0)) / e.std(axis=0)]
    for std in (noise, whole):
        cells.append(100.0 * np.nanmean(np.where(np.isnan(std), np.nan, np.abs(e) <= Z95 * std), axis=0))
    shares = [f"{m:5.2f} {n:5.1f} {w:5.1f}" for m, n, w in zip(*cells, strict=True)]
    return f"{name:34s} | {' | '.join(shares)} | {int(np.isnan(whole).any(axis=1).sum())} without"


def main(records: int = RECORDS, shift: int = 0) -> None:
    """Print the table."""
    print("mean error over scatter, held by noise, by all [%], of inertia, viscous, Coulomb, idle torque")
    for place, axis in enumerate(MACHINES):
        for kind in KINDS:
            for size in SIZES:
                for with_reference in (True, False):
                    count = records if with_reference else records // 4
                    first = FIRST_SEED + shift + 1000 * place
                    errors = errors_of(axis, kind, size, with_reference, range(first, first + count))
                    way = "instruments" if with_reference else "least squares"
                    print(line_of(f"{place} {kind} {100 * size:g} % {way}", errors), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
