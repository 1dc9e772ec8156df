"""What an estimator gets: roles on one uniform grid, in SI, immutable."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Literal, NamedTuple
from zlib import crc32

import numpy as np

from drivetool.errors import BadOption, BadRecording
from drivetool.finding import Finding
from drivetool.logs.grid import STEP_TOLERANCE
from drivetool.logs.roles import quantity

TorqueIs = Literal["command", "measurement", "unknown"]


# Unix time exceeds this [s] since 2001; a clock that counts from the start of a machine reaches it in 32 years.
MIN_UNIX_SECONDS = 1e9


class Source(NamedTuple):
    """A recording as a result names it: name, SHA-256, and the time at which it began as logged (UTC), if any."""

    file: str
    sha256: str
    began: str | None = None


def start_date(start: float) -> str | None:
    """Seconds of a log's clock as a date (UTC); None: they count from something else than 1970."""
    if not MIN_UNIX_SECONDS < start < 10 * MIN_UNIX_SECONDS:
        return None
    return datetime.fromtimestamp(round(start, 6), UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


@dataclass(frozen=True)
class Channel:
    """One channel as it was logged.

    time    (n,) seconds on the channel's own clock, counted from the recording's origin;
            as logged: the one door (door/build.py) checks that it does not decrease
    values  (n,) in `unit`
    unit    as written in the log, or None
    """

    time: np.ndarray
    values: np.ndarray
    unit: str | None = None


@dataclass(frozen=True)
class Recording:
    """A log file as it was: each channel on its own clock.

    name      path as given, of an absolute one the file's name (see display_name)
    sha256    of the file, set by read_recording
    channels  by name, the requested ones; channels of one clock share its time array
    findings  what the reader repaired or lost
    origin    seconds on the log's clock from which the channels' times count; kept separately,
              because 64-bit floats resolve the seconds since 1970 to 0.2 us only
    unreadable  topics or columns that are there but cannot be read -> why
    """

    name: str
    sha256: str
    channels: Mapping[str, Channel]
    findings: tuple[Finding, ...] = ()
    origin: float = 0.0
    unreadable: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """Signals by role on one uniform grid.

    name         path as given, of an absolute one the file's name (see display_name)
    sha256       of the log file
    step         sample interval [s]
    start        time of the first sample on the log's clock [s]
    signals      role -> (n,) SI; NaN where a sensor has no value. Torques are held over
                 the interval that follows their sample (zero order hold) and never NaN
                 inside a segment
    segments     (first, last+1) index pairs without a gap in time
    torque_unit  Nm or N, or A, V or % where all torques are; motion_unit rad or m
    input_units  roles whose torque is logged as A, V or % beside others in Nm or N -> that unit
    torque_is    whether the logged torque is the command or a measurement of it
    magnitudes   roles whose sign is not in the log
    offset       time of the first sample after the start of the recording it is a part of [s]
    begins       whether it begins where its recording does: only there may a start state be known
    others       the parts of the recording at other rates, each on a grid of its own; see parts_at_all_rates
    """

    name: str
    sha256: str
    step: float
    start: float
    signals: Mapping[str, np.ndarray]
    segments: tuple[tuple[int, int], ...]
    torque_unit: str = "Nm"
    motion_unit: str = "rad"
    torque_is: TorqueIs = "unknown"
    findings: tuple[Finding, ...] = field(default=())
    offset: float = 0.0
    magnitudes: tuple[str, ...] = ()
    input_units: Mapping[str, str] = field(default_factory=dict)
    begins: bool = True
    others: tuple[Experiment, ...] = ()

    @property
    def source(self) -> Source:
        """The file that it came from."""
        return Source(self.name, self.sha256, start_date(self.start - self.offset))

    @property
    def number(self) -> int:
        """A checksum that distinguishes recordings where only a number can be stored; 0 without a file."""
        return recording_number(self.sha256)

    @property
    def contents(self) -> tuple[str, str]:
        """Checksums of the file, and of its contents, which stays in another format, such as `convert` writes."""
        units = self.torque_unit, self.motion_unit, *sorted(self.input_units.items())
        digest = sha256(repr((self.step, self.segments, *units)).encode())
        for role in sorted(self.signals):
            digest.update(role.encode())
            digest.update(np.ascontiguousarray(self.signals[role] + 0.0))  # no negative zeros
        return self.sha256, digest.hexdigest()

    @property
    def size(self) -> int:
        """Number of samples on the grid."""
        return len(next(iter(self.signals.values())))

    @property
    def used(self) -> int:
        """Number of samples in its segments."""
        return sum(last - first for first, last in self.segments)

    @property
    def rate(self) -> str:
        """Its samples a second, as messages have them."""
        return f"{1.0 / self.step:.4g} Hz"

    @property
    def time(self) -> np.ndarray:
        """(n,) seconds from the start of the recording."""
        return self.offset + np.arange(self.size) * self.step

    def signal(self, role: str, why: str) -> np.ndarray:
        """The (n,) signal of a role; BadRecording names the roles there are."""
        if role not in self.signals:
            raise BadRecording(
                f"role {role} for {why}", f"none in {self.name}",
                "Name its channel in the channel map.", sorted(self.signals))
        return self.signals[role]

    def signed(self, role: str, why: str) -> np.ndarray:
        """The (n,) signal of a role; BadRecording also where the log has its magnitude only."""
        if role in self.magnitudes:
            raise BadRecording(
                f"{role} with its sign for {why}", f"only its magnitude in {self.name} (unsigned: true)",
                "Its sign is unknown while the drive brakes: use steady, or log it with its sign.")
        return self.signal(role, why)

    def unit(self, role: str) -> str:
        """The unit of a role."""
        if other := {"voltage": "V", "frequency": "Hz"}.get(quantity(role)):
            return other
        if role.endswith("torque"):
            return self.input_units.get(role, self.torque_unit)
        return self.motion_unit + ("/s" if role.endswith("speed") else "")

    def between(self, first: float, last: float) -> Experiment:
        """The part from `first` to `last` seconds, as an experiment of its own."""
        i, j = max(0, round(first / self.step)), min(self.size, round(last / self.step))
        cut = tuple((max(a, i) - i, min(b, j) - i) for a, b in self.segments if min(b, j) > max(a, i))
        return replace(
            self, start=self.start + i * self.step, offset=self.offset + i * self.step, segments=cut,
            signals={role: values[i:j] for role, values in self.signals.items()})


def parts_at_all_rates(experiments: Sequence[Experiment]) -> list[Experiment]:
    """The recordings and their parts at other rates, as separate experiments in the order of time."""
    return [part for e in experiments
            for part in sorted((replace(e, others=()), *e.others), key=lambda part: part.start)]


def group_by_rate(experiments: Sequence[Experiment]) -> list[list[int]]:
    """Indices of experiments, grouped by sampling rate: quantities per sample are comparable within a group."""
    found: list[list[int]] = []
    for i, e in enumerate(experiments):
        group_of_rate = next((group for group in found
                              if abs(e.step / experiments[group[0]].step - 1.0) < STEP_TOLERANCE), None)
        if group_of_rate is None:
            found.append([i])
        else:
            group_of_rate.append(i)
    return found


def recording_sources(experiments: Sequence[Experiment]) -> tuple[Source, ...]:
    """The files that they came from, each once."""
    found: dict[tuple[str, str], Source] = {}
    for e in experiments:
        found.setdefault((e.name, e.sha256), e.source)
    return tuple(found.values())


def refuse_copies(experiments: Sequence[Experiment]) -> None:
    """Raise BadOption where two recordings have one content: a copy is no repeat, and would count twice."""
    seen: dict[str, str] = {}
    for e in experiments:
        known = next((seen[c] for c in e.contents if c in seen), None)
        if known is not None:
            same = "twice" if e.name == known else f"and {e.name} with one content"
            raise BadOption("every recording once", f"{known} {same}", "Leave out the copy.")
        seen |= dict.fromkeys(e.contents, e.name)


def display_name(path: Path) -> str:
    """What results and messages call a recording: its path as given; of an absolute one, the file's name alone."""
    return path.name if path.is_absolute() else path.as_posix()


def natural_order(path: Path) -> list[tuple[int, str]]:
    """part-2 before part-10."""
    return [(int(each), "") if each.isdigit() else (-1, each) for each in re.split(r"(\d+)", str(path))]


def recording_number(sha256: str) -> int:
    """The number by which a recording of that content is known."""
    return crc32(sha256.encode())


def number_duplicates(names: Sequence[str]) -> list[str]:
    """Names with a number where two are the same, or a table would merge them."""
    many, seen, found = Counter(names), Counter(), []
    for name in names:
        seen[name] += 1
        found.append(f"{name} ({seen[name]})" if many[name] > 1 else name)
    return found
