"""The values of one parameter of one machine, recording by recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.finding_codes import SUMMED
from drivetool.logs.formats import Row

DAY = 86400.0  # s
# A value that was not fitted says nothing of the machine at that time.
NOT_MEASURED = ("held", "not-identifiable")
AT_BOUND = "at-bound"  # a value without a std, and yet by its recording
# Where a recording turns one way, a friction stands for the sum of both: no value of a series of one of them.
FRICTIONS = (".idle_torque", ".coulomb")
LARGEST = 1e100  # of a value or a std: the square of a larger one is soon none
# Relative; a summary has values as the files have them, with 10 significant digits.
EQUAL = 1e-9


@dataclass(frozen=True)
class Series:
    """A parameter of a machine by one step from recordings of one kind, in their order.

    recordings  (n) their names
    starts      (n,) s since 1970 (UTC); None where one of the logs has no absolute time
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
        """(n,) whole days since 1970 (UTC), by which recordings belong together."""
        return None if self.starts is None else np.floor(self.starts / DAY).astype(int)

    @property
    def constant(self) -> bool:
        """Whether all values are equal, but for the rounding of a file."""
        low, high = float(self.values.min()), float(self.values.max())
        return high - low <= EQUAL * max(abs(low), abs(high))

    @property
    def variances(self) -> np.ndarray:
        """(n,) of each value by its stated std; the median one where none is stated, 0 where none has any."""
        known = np.isfinite(self.stds)
        usual = float(np.median(self.stds[known])) if known.any() else 0.0
        return np.where(known, self.stds, usual) ** 2

    def without(self, places: Sequence[int]) -> Series:
        """The series without the recordings at some places."""
        kept = np.delete(np.arange(len(self.values)), places)
        return replace(self, recordings=tuple(self.recordings[i] for i in kept), values=self.values[kept],
                       starts=None if self.starts is None else self.starts[kept], stds=self.stds[kept])


def series_of(rows: Iterable[Row]) -> tuple[Series, ...]:
    """The series of a summary, machines and parameters in its order.

    rows     in any order. A row without a parameter tells nothing here, nor does one of all recordings together.
    returns  one Series per machine, parameter, step and kind with at least one value. Values that are not finite,
             held or not identifiable are counted in `left_out`. So is one without a std where others have one: of
             a fit that did not settle, or a share of what only a sum tells. A unit that changes begins a series of
             its own.
    """
    groups: dict[tuple[str, str, str, str, str], list[Row]] = {}
    for row in rows:
        if row.parameter is not None and row.recording:
            groups.setdefault((row.machine, row.parameter, row.step, row.unit, row.kind), []).append(row)
    return tuple(found for key, group in groups.items() if (found := _series(key, group)) is not None)


def _series(key: tuple[str, str, str, str, str], group: Sequence[Row]) -> Series | None:
    """The rows of one series; None where no value is left."""
    machine, parameter, step, unit, kind = key
    told = sorted((row for row in group if _told(row)), key=lambda row: (row.order, row.recording))
    if any(_std(row) is not None for row in told):  # a value without one is told by no record of its own
        told = [row for row in told if _std(row) is not None or row.status == AT_BOUND]
    if not told:
        return None
    starts = [row.start for row in told]
    stds = [np.nan if (std := _std(row)) is None else std for row in told]
    return Series(machine, parameter, step, unit, tuple(row.recording for row in told),
                  None if None in starts else np.array(starts, float), np.array([row.value for row in told], float),
                  np.array(stds, float), len(group) - len(told), kind)


def _told(row: Row) -> bool:
    """Whether the row has a value that was fitted to its recording."""
    summed = not SUMMED.isdisjoint(row.findings) and (row.parameter or "").endswith(FRICTIONS)
    return row.value is not None and abs(row.value) < LARGEST and row.status not in NOT_MEASURED and not summed


def _std(row: Row) -> float | None:
    """The std of a row that can be one."""
    return row.std if row.std is not None and 0.0 < row.std < LARGEST else None


def without_copies(rows: Sequence[Row]) -> tuple[list[Row], dict[str, str]]:
    """The rows without recordings that repeat another one of their machine.

    rows     of a summary
    returns  the rows that are left; name of each copy -> the recording that it repeats. Two recordings are one
             where all their values and all their stds are equal to the last digit, and one std is stated: noise
             does not repeat itself.
    """
    content: dict[tuple[str, str], list[tuple]] = {}
    for row in rows:
        if row.recording and _told(row):
            content.setdefault((row.machine, row.recording), []).append(
                (row.step, row.parameter, row.value, row.std))
    seen: dict[tuple[str, frozenset], str] = {}
    copies: dict[tuple[str, str], str] = {}
    for (machine, recording), figures in content.items():
        if any(std for *_, std in figures):
            first = seen.setdefault((machine, frozenset(figures)), recording)
            if first != recording:
                copies[machine, recording] = first
    left = [row for row in rows if (row.machine, row.recording) not in copies]
    return left, {recording: first for (_, recording), first in copies.items()}
