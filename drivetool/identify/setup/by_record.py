"""Parameters that differ between recordings: the drive as it was while one of them was made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.drive import Drive
from drivetool.logs import Experiment, recording_number
from drivetool.quantity import RECORD_MARK, record_of, shared, with_parts


def as_recorded(drive: Drive, free: Sequence[str], number: int) -> tuple[Drive, tuple[str, ...]]:
    """(the drive as it was in a recording, the names of its columns there).

    free     names of the free parameters, NAME@RECORD among them
    number   of the recording, see `Experiment.number`; one without own values has those of the others
    returns  NAME has the value and the column of NAME@RECORD; the column that all others share then has no effect
    """
    label = next((name for name, sha in drive.records.items() if recording_number(sha) == number), None)
    if label is None:
        return drive, tuple(free)
    own = {shared(n): n for n in (*drive.values, *free) if record_of(n) == label}
    values = {**drive.values, **{name: drive.values[n] for name, n in own.items() if n in drive.values}}
    names = {n: name for name, n in own.items()} | {name: f"{name}{RECORD_MARK}" for name in own}
    constants = {shared(n): v for n, v in drive.constants.items() if record_of(n) == label}
    drive = replace(drive, values=values, constants={**drive.constants, **constants})
    return drive, tuple(names.get(n, n) for n in free)


def shared_free_names(free: Sequence[str], drive: Drive, experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """The free parameters without those of which every recording has a value of its own."""
    names = {sha: name for name, sha in drive.records.items()}
    labels = [names.get(e.sha256) for e in experiments]
    return tuple(n for n in free if record_of(n) or not all(
        label is not None and with_parts(n, record=label) in drive.values for label in labels))
