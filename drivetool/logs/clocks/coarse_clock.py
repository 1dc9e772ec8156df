"""The uniform clock behind stamps that were cut to a coarse resolution, such as milliseconds at 4 kHz."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.logs import JITTER_TOLERANCE

# Stamps cut to a resolution lie within one resolution of the line of a uniform clock; slow drift and the rounding
# of stored values add the tenth. A lost sample shifts the later stamps by a step: it is seen where a step is longer
# than that tenth.
MAX_LINE_DEVIATION = 1.1
# Without drift, all stamps lie within one resolution of a line (1e-3 for rounding); with lost samples they do not.
MAX_DEVIATION_WITHOUT_DRIFT = 1.0 + 1e-3
# Stamps are whole multiples of the resolution, to this share of it: seconds stored in single precision need it.
MULTIPLE_TOLERANCE = 1e-3
# A sample that is lost or logged twice makes one or two steps of a uniform clock uneven; a coarse clock makes many.
# Of ten lost at random, some lie so near each other that no line comes within a resolution of all stamps.
MIN_UNEVEN_STEPS = 10
PRECHECK_STEPS = 1000  # steps; a choice: enough to recognise most fine clocks without a pass over all of them
# Steps of two lengths, one twice the other, come from two writers that take turns; a logger loses fewer samples.
MAX_LOST_SHARE = 0.1
# A choice: fewer samples of a stretch do not determine the slope of its line.
MIN_LINE_SAMPLES = 50
# At least this share of the samples with a repeated stamp has new values; otherwise the rows were logged twice.
# A coarse sensor at standstill repeats its values for half a record, seldom for longer.
MIN_NEW_VALUE_SHARE = 0.05


def restore_uniform_times(time: np.ndarray, values: Sequence[np.ndarray] = ()) -> tuple[np.ndarray, float] | None:
    """Stamps of the uniform clock that coarse ones were cut from, and their resolution.

    time    (n,) seconds, not decreasing
    values  (n,) each, of the channels on this clock: repeated stamps with repeated values are rows logged twice
    returns ((n,) seconds, strictly increasing, each within a resolution of its stamp; resolution [s]); None where
            the stamps are no multiples of one, or where no uniform clock explains them
    """
    steps = np.diff(time)
    if len(time) < MIN_LINE_SAMPLES or np.ptp(steps) <= JITTER_TOLERANCE * steps.mean():
        return None
    median = float(np.median(steps))
    usual = median or float(np.ptp(time)) / (len(time) - 1)
    # The first steps suffice to recognise most clocks that are fine enough.
    if any(_common_resolution(part) < JITTER_TOLERANCE * usual for part in (steps[:PRECHECK_STEPS], steps)):
        return None
    resolution = _common_resolution(steps)
    uneven = int(np.sum(np.abs(steps - median) > 0.5 * resolution))
    if uneven < MIN_UNEVEN_STEPS or _rows_logged_twice(steps == 0, values):
        return None
    # Steps well above the resolution show which samples are missing between them; others are one sample each.
    step_counts = np.maximum(1, np.round(steps / usual)) if usual > 2 * resolution else np.ones(len(steps))
    if np.mean(step_counts > 1) > MAX_LOST_SHARE:
        return None
    place = np.concatenate([[0.0], np.cumsum(step_counts)])
    spread_stamps = _spread_over_cells(time, resolution)
    if spread_stamps is not None and \
            np.ptp(time - _fit_stamp_line(time, place)) > MAX_DEVIATION_WITHOUT_DRIFT * resolution:
        return spread_stamps, resolution
    found = np.empty(len(time))
    stretches = _split_at_lost_samples(time, place, resolution)
    if MIN_UNEVEN_STEPS * len(stretches) > uneven:
        return None
    for first, last in stretches:
        part = found[first:last] = _fit_stamp_line(time[first:last], place[first:last])
        if np.ptp(time[first:last] - part) > MAX_LINE_DEVIATION * resolution:
            return None
    # A stamp that is cut comes before its sample, by half the resolution on average.
    found += 0.5 * resolution
    return (found, resolution) if np.all(np.diff(found) > 0) else None


def _common_resolution(steps: np.ndarray) -> float:
    """Largest time of which all steps, (m,), are whole multiples [s]; near zero where there is none."""
    steps = np.unique(steps[steps > 0])
    if not len(steps):
        return np.inf
    found = float(steps[0])
    while True:
        rest = np.abs(steps - found * np.round(steps / found))
        if rest.max() <= MULTIPLE_TOLERANCE * found or found < MULTIPLE_TOLERANCE * steps[0]:
            return found
        found = float(rest[rest > MULTIPLE_TOLERANCE * found].min())


def _spread_over_cells(time: np.ndarray, resolution: float) -> np.ndarray | None:
    """Stamps where the resolution is a whole number of steps and samples were lost: (n,) seconds.

    Stamps shared by too few samples show how many were lost there, not which. The rows are spread evenly, so that
    each is off by as many steps at most; None where another clock lies behind the stamps.
    """
    cell = np.round((time - time[0]) / resolution).astype(np.int64)
    cells, first, counts = np.unique(cell, return_index=True, return_counts=True)
    full = int(np.argmax(np.bincount(counts)))
    lost = int(np.sum(full - counts[1:-1]))
    if full < 2 or counts.max() > full or not 0 < lost <= MAX_LOST_SHARE * full * len(cells):
        return None
    count = np.repeat(counts, counts)
    place = np.floor((np.arange(len(time)) - np.repeat(first, counts) + 0.5) * full / count)
    place[:counts[0]] = np.arange(full - counts[0], full)  # a record begins and ends inside a cell
    place[first[-1]:] = np.arange(counts[-1])
    return time[0] + (cell + (place + 0.5) / full) * resolution


def _rows_logged_twice(repeats_stamp: np.ndarray, values: Sequence[np.ndarray]) -> bool:
    """Whether samples that share a stamp, (n - 1,), repeat the values before them."""
    if not values or not repeats_stamp.any():
        return False
    same = np.all([v[1:] == v[:-1] for v in values], axis=0)
    return float(np.mean(~same[repeats_stamp])) < MIN_NEW_VALUE_SHARE


def _split_at_lost_samples(time: np.ndarray, place: np.ndarray, resolution: float) -> list[tuple[int, int]]:
    """(first, last + 1) of the stretches in which every sample lies near one line; split where most is off it."""
    todo, done = [(0, len(time))], []
    while todo:
        first, last = todo.pop()
        off = time[first:last] - _fit_stamp_line(time[first:last], place[first:last])
        at = first + 1 + int(np.argmax(np.abs(np.cumsum(off - off.mean())[:-1])))
        if np.ptp(off) <= MAX_LINE_DEVIATION * resolution or min(at - first, last - at) < MIN_LINE_SAMPLES:
            done.append((first, last))
        else:
            todo += [(first, at), (at, last)]
    return sorted(done)


def _fit_stamp_line(time: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(n,) the straight line through stamps over their places."""
    i = place - place.mean()
    return time.mean() + i * (float(time @ i) / float(i @ i))
