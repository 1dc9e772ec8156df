"""Parameters that differ between recordings: the drive as it was while one of them was made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.drive import AT, Drive, shared
from drivetool.logs import Experiment, number_of


def as_recorded(drive: Drive, free: Sequence[str], number: int) -> tuple[Drive, tuple[str, ...]]:
    """(the drive as it was in a recording, the names that its columns go by there).

    free     names of the free parameters, NAME@RECORD among them
    number   of the recording, see `Experiment.number`; one that has nothing of its own is that of the others
    returns  NAME has the value, and its column is the one, of NAME@RECORD; the column that all others share then
             stands for nothing
    """
    label = next((name for name, sha in drive.records.items() if number_of(sha) == number), None)
    if label is None:
        return drive, tuple(free)
    own = {shared(n): n for n in (*drive.values, *free) if n.partition(AT)[2] == label}
    values = {**drive.values, **{name: drive.values[n] for name, n in own.items() if n in drive.values}}
    names = {n: name for name, n in own.items()} | {name: f"{name}{AT}" for name in own}
    constants = {shared(n): v for n, v in drive.constants.items() if n.partition(AT)[2] == label}
    drive = replace(drive, values=values, constants={**drive.constants, **constants})
    return drive, tuple(names.get(n, n) for n in free)


def differs(drive: Drive) -> bool:
    """Whether a parameter has a value of its own in some recording."""
    return any(AT in n for n in drive.values)


def shared_by_some(free: Sequence[str], drive: Drive, experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """The free parameters without those of which every recording has a value of its own."""
    names = {sha: name for name, sha in drive.records.items()}
    labels = [names.get(e.sha256) for e in experiments]
    return tuple(n for n in free if AT in n or not all(
        label is not None and f"{n}{AT}{label}" in drive.values for label in labels))
