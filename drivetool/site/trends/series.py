"""The values of one parameter of one machine, recording by recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.finding_codes import SUMMED
from drivetool.logs.formats import Row

SECONDS_PER_DAY = 86400.0  # s
# Statuses of values that are not fitted: they carry no information on the machine at that time.
UNFITTED_STATUSES = ("held", "not-identifiable")
AT_BOUND_STATUS = "at-bound"  # a value without a std, but fitted to its recording
# In a recording with one direction a friction is the sum of several: not a value for the series of one of them.
SUMMABLE_FRICTIONS = (".idle_torque", ".coulomb")
MAX_MAGNITUDE = 1e100  # of a value or a std: squares and their sums must stay below the largest float, 1.8e308
# Relative. Ten times the rounding of a result file, which has 10 significant digits.
EQUALITY_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Series:
    """A parameter of a machine by one step from recordings of one kind, in their order.

    recordings  (n) their names
    starts      (n,) s since 1970 (UTC); None if one of the logs has no absolute time
    values, stds  (n,) in `unit`; NaN where no std is stated
    left_out    recordings of the machine that have the parameter without a finite, fitted value
    kind        what was recorded
    """

    machine: str
    parameter: str
    step: str
    unit: str
    recordings: tuple[str, ...]
    starts: np.ndarray | None
    values: np.ndarray
    stds: np.ndarray
    left_out: int = 0
    kind: str = ""

    @property
    def days(self) -> np.ndarray | None:
        """(n,) whole days since 1970 (UTC), which group the recordings."""
        return None if self.starts is None else np.floor(self.starts / SECONDS_PER_DAY).astype(int)

    @property
    def constant(self) -> bool:
        """Whether all values are equal within the rounding of a file."""
        low, high = float(self.values.min()), float(self.values.max())
        return high - low <= EQUALITY_TOLERANCE * max(abs(low), abs(high))

    @property
    def variances(self) -> np.ndarray:
        """(n,) of each value from its stated std; the median where one is missing, 0 if all are."""
        known = np.isfinite(self.stds)
        median_std = float(np.median(self.stds[known])) if known.any() else 0.0
        return np.where(known, self.stds, median_std) ** 2

    def without(self, places: Sequence[int]) -> Series:
        """The series without the recordings at some places."""
        remaining = np.delete(np.arange(len(self.values)), places)
        return replace(self, recordings=tuple(self.recordings[i] for i in remaining), values=self.values[remaining],
                       starts=None if self.starts is None else self.starts[remaining], stds=self.stds[remaining])


def series_of(rows: Iterable[Row]) -> tuple[Series, ...]:
    """The series of a summary, machines and parameters in its order.

    rows     in any order. Rows without a parameter, or of all recordings together, are ignored.
    returns  one Series per machine, parameter, step and kind with at least one value. Values that are not finite,
             held or not identifiable are counted in `left_out`. So is one without a std where others have one:
             the fit did not converge, or only a sum is identifiable. Each unit is a separate series.
    """
    groups: dict[tuple[str, str, str, str, str], list[Row]] = {}
    for row in rows:
        if row.parameter is not None and row.recording:
            groups.setdefault((row.machine, row.parameter, row.step, row.unit, row.kind), []).append(row)
    return tuple(found for key, group in groups.items() if (found := _series_from_rows(key, group)) is not None)


def _series_from_rows(key: tuple[str, str, str, str, str], group: Sequence[Row]) -> Series | None:
    """The series of these rows; None without a usable value."""
    machine, parameter, step, unit, kind = key
    fitted_rows = sorted((row for row in group if _is_fitted(row)), key=lambda row: (row.order, row.recording))
    if any(_usable_std(row) is not None for row in fitted_rows):
        # A value without a std is not identified from its own recording.
        fitted_rows = [row for row in fitted_rows if _usable_std(row) is not None or row.status == AT_BOUND_STATUS]
    if not fitted_rows:
        return None
    starts = [row.start for row in fitted_rows]
    stds = [np.nan if (std := _usable_std(row)) is None else std for row in fitted_rows]
    return Series(machine, parameter, step, unit, tuple(row.recording for row in fitted_rows),
                  None if None in starts else np.array(starts, float),
                  np.array([row.value for row in fitted_rows], float), np.array(stds, float),
                  len(group) - len(fitted_rows), kind)


def _is_fitted(row: Row) -> bool:
    """Whether the row has a value that was fitted to its recording."""
    summed = not SUMMED.isdisjoint(row.findings) and (row.parameter or "").endswith(SUMMABLE_FRICTIONS)
    return (row.value is not None and abs(row.value) < MAX_MAGNITUDE and row.status not in UNFITTED_STATUSES
            and not summed)


def _usable_std(row: Row) -> float | None:
    """The std of a row if it is positive and finite."""
    return row.std if row.std is not None and 0.0 < row.std < MAX_MAGNITUDE else None


def without_copies(rows: Sequence[Row]) -> tuple[list[Row], dict[str, str]]:
    """The rows without recordings that are copies of another one of their machine.

    rows     of a summary
    returns  the other rows; name of each copy -> its original. Two recordings are copies if all their values and
             all their stds are equal to the last digit, and a std is stated: noise does not repeat.
    """
    content: dict[tuple[str, str], list[tuple]] = {}
    for row in rows:
        if row.recording and _is_fitted(row):
            content.setdefault((row.machine, row.recording), []).append(
                (row.step, row.parameter, row.value, row.std))
    first_recordings: dict[tuple[str, frozenset], str] = {}
    copies: dict[tuple[str, str], str] = {}
    for (machine, recording), figures in content.items():
        if any(std for *_, std in figures):
            first = first_recordings.setdefault((machine, frozenset(figures)), recording)
            if first != recording:
                copies[machine, recording] = first
    original_rows = [row for row in rows if (row.machine, row.recording) not in copies]
    return original_rows, {recording: first for (_, recording), first in copies.items()}
