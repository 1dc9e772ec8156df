"""The uniform clock behind stamps that were cut to a coarse resolution, such as milliseconds at 4 kHz."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.logs import JITTER

# Stamps cut to a resolution lie within one of it from the line of a uniform clock; a slow drift of the clock and
# the rounding of what is stored add to that. A sample that was lost shifts the stamps behind it by a step, which
# is seen where a step is a larger share of the resolution than this.
WITHIN = 1.1
# Without drift, all stamps lie within the resolution itself from a line; those of a clock that lost samples do not.
EXACT = 1.0 + 1e-3
# Stamps are whole multiples of the resolution, to this share of it (seconds as floats of single precision).
WHOLE = 1e-3
# Single samples that were lost or logged twice make a step or two of a uniform clock uneven, a coarse clock makes
# many. Of so many lost at random, some lie so near each other that no line comes within a resolution of all stamps.
UNEVEN = 10
FIRST = 1000  # steps
# Behind steps of two lengths, one of them twice the other, lie two writers that take turns; a logger loses fewer.
SELDOM = 0.1
# Fewer samples of a stretch do not tell a line from another one.
LEAST = 50
# Of the samples that share a stamp with the one before, this share at least has other values than that: fewer, and
# the rows were logged twice. A coarse sensor at standstill repeats its values for half a record, seldom for longer.
OTHER = 0.05


def restored(time: np.ndarray, values: Sequence[np.ndarray] = ()) -> tuple[np.ndarray, float] | None:
    """Stamps of the uniform clock that coarse ones were cut from, and their resolution.

    time    (n,) seconds, not decreasing
    values  (n,) each, of the channels on this clock: repeated stamps with repeated values are rows logged twice
    returns ((n,) seconds, strictly increasing, each within a resolution of its stamp; resolution [s]); None where
            the stamps are no multiples of one, or where no uniform clock explains them
    """
    steps = np.diff(time)
    if len(time) < LEAST or np.ptp(steps) <= JITTER * steps.mean():
        return None
    middle = float(np.median(steps))
    usual = middle or float(np.ptp(time)) / (len(time) - 1)
    # The first steps tell most clocks that are fine enough, without a look at all of them.
    if any(_resolution(part) < JITTER * usual for part in (steps[:FIRST], steps)):
        return None
    resolution = _resolution(steps)
    uneven = int(np.sum(np.abs(steps - middle) > 0.5 * resolution))
    if uneven < UNEVEN or _twice(steps == 0, values):
        return None
    # Steps well above the resolution tell which samples are missing between them; others are one sample each.
    whole = np.maximum(1, np.round(steps / usual)) if usual > 2 * resolution else np.ones(len(steps))
    if np.mean(whole > 1) > SELDOM:
        return None
    place = np.concatenate([[0.0], np.cumsum(whole)])
    counted = _counted(time, resolution)
    if counted is not None and np.ptp(time - _line(time, place)) > EXACT * resolution:
        return counted, resolution
    found = np.empty(len(time))
    stretches = _stretches(time, place, resolution)
    if UNEVEN * len(stretches) > uneven:
        return None
    for first, last in stretches:
        part = found[first:last] = _line(time[first:last], place[first:last])
        if np.ptp(time[first:last] - part) > WITHIN * resolution:
            return None
    # A stamp that is cut comes before its sample, by half the resolution on average.
    found += 0.5 * resolution
    return (found, resolution) if np.all(np.diff(found) > 0) else None


def _resolution(steps: np.ndarray) -> float:
    """Largest time of which all steps, (m,), are whole multiples [s]; near zero where there is none."""
    steps = np.unique(steps[steps > 0])
    if not len(steps):
        return np.inf
    found = float(steps[0])
    while True:
        rest = np.abs(steps - found * np.round(steps / found))
        if rest.max() <= WHOLE * found or found < WHOLE * steps[0]:
            return found
        found = float(rest[rest > WHOLE * found].min())


def _counted(time: np.ndarray, resolution: float) -> np.ndarray | None:
    """Stamps where the resolution is a whole number of steps and samples were lost: (n,) seconds.

    Stamps that are shared by too few tell how many were lost there, not which. The rows are spread over the places,
    so that each is off by as many steps at most; None where another clock lies behind the stamps.
    """
    cell = np.round((time - time[0]) / resolution).astype(np.int64)
    cells, first, there = np.unique(cell, return_index=True, return_counts=True)
    full = int(np.argmax(np.bincount(there)))
    lost = int(np.sum(full - there[1:-1]))
    if full < 2 or there.max() > full or not 0 < lost <= SELDOM * full * len(cells):
        return None
    count = np.repeat(there, there)
    place = np.floor((np.arange(len(time)) - np.repeat(first, there) + 0.5) * full / count)
    place[:there[0]] = np.arange(full - there[0], full)  # a record begins and ends inside a cell
    place[first[-1]:] = np.arange(there[-1])
    return time[0] + (cell + (place + 0.5) / full) * resolution


def _twice(shares: np.ndarray, values: Sequence[np.ndarray]) -> bool:
    """Whether samples that share a stamp, (n - 1,), repeat the values before them."""
    if not values or not shares.any():
        return False
    same = np.all([v[1:] == v[:-1] for v in values], axis=0)
    return float(np.mean(~same[shares])) < OTHER


def _stretches(time: np.ndarray, place: np.ndarray, resolution: float) -> list[tuple[int, int]]:
    """(first, last + 1) of the stretches in which every sample lies near one line; split where most is off it."""
    todo, done = [(0, len(time))], []
    while todo:
        first, last = todo.pop()
        off = time[first:last] - _line(time[first:last], place[first:last])
        if np.ptp(off) <= WITHIN * resolution or last - first < 2 * LEAST:
            done.append((first, last))
            continue
        at = first + 1 + int(np.argmax(np.abs(np.cumsum(off - off.mean())[:-1])))
        if min(at - first, last - at) < LEAST:
            done.append((first, last))
            continue
        todo += [(first, at), (at, last)]
    return sorted(done)


def _line(time: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(n,) the straight line through stamps over their places."""
    i = place - place.mean()
    return time.mean() + i * (float(time @ i) / float(i @ i))
