"""Ten recordings of one machine that varies from day to day: does the interval of the fit hold the machine?

    python -m tests.study.study_repeats [sets] [shift] [recordings] [scatter]

Each of four parameters varies independently, by a standard deviation of 1.5 % of its mean from recording to
recording. One line per criterion: of every parameter how often the 95 % interval held the mean, its median half
width, and the median of the scatter that was found, both over the value. The last line fits one of the ten alone.
"""

from __future__ import annotations

import sys

import numpy as np

from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from tests.identify.days import NAMES, days_of, machine_of, start_of

SETS, RECORDINGS, SCATTER = 200, 10, 0.015
FIRST_SEED = 720_000


def of_sets(criterion: str, seeds: range, count: int, scatter: float, used: int) -> np.ndarray:
    """(sets, parameters, 3) held, half width and scatter over the value; NaN where no interval is stated."""
    found = []
    for seed in seeds:
        values = machine_of(seed)
        records = days_of(values, count, scatter, seed)[:used]
        estimate = greybox(records, start_of(values), Options(criterion=criterion))
        lines = {p.name: p for p in estimate.parameters}
        row = []
        for name, true in zip(NAMES, values, strict=True):
            p = lines[name]
            if p.std is None:
                row.append((np.nan, np.nan, np.nan))
                continue
            low, high = p.ci95
            row.append((float(low <= true <= high), 0.5 * (high - low) / true, (p.repeatability or 0.0) / true))
        found.append(row)
    return np.array(found)


def line_of(name: str, found: np.ndarray) -> str:
    """The figures of a criterion."""
    held, width, scatter = np.moveaxis(found, 2, 0)
    cells = [f"{int(np.nansum(h))}/{np.count_nonzero(np.isfinite(h))} {100.0 * np.nanmedian(w):5.2f} "
             f"{100.0 * np.nanmedian(s):5.2f}" for h, w, s in zip(held.T, width.T, scatter.T, strict=True)]
    return f"{name:12s} | {' | '.join(cells)}"


def main(sets: int = SETS, shift: int = 0, count: int = RECORDINGS, scatter: float = SCATTER) -> None:
    """Print the table."""
    print("held, half width [%], scatter [%] of", ", ".join(NAMES))
    seeds = range(FIRST_SEED + shift, FIRST_SEED + shift + sets)
    for criterion in ("auto", "innovations", "inverse"):
        print(line_of(criterion, of_sets(criterion, seeds, count, scatter, count)), flush=True)
    print(line_of("auto, one", of_sets("auto", seeds, count, scatter, 1)), flush=True)


if __name__ == "__main__":
    main(*(kind(word) for kind, word in zip((int, int, int, float), sys.argv[1:], strict=False)))
