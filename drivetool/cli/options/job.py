"""The request of a command that reads recordings, and what it has read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from drivetool.errors import BadOption

if TYPE_CHECKING:
    from drivetool.files.yaml import Loaded
    from drivetool.logs import Experiment

WORD_SEPARATOR = "\0"  # between both words of --record: no argument of a process can hold it


@dataclass(frozen=True)
class Job:
    """The request of a command that reads recordings, in the words of its options."""

    step: str
    given: Sequence[str]  # recordings, and folders of them
    params: Sequence[str] = ()
    map: str | None = None
    drive: str | None = None
    set: Sequence[str] = ()
    out: str | None = None
    json: bool = False
    plot: str | None = None
    strict: bool = False
    quiet: bool = False
    condition: Sequence[str] = ()
    more: Sequence[str] = ()  # files read by an option that this command alone has
    start: Sequence[str] = ()
    record: Sequence[str] = ()
    stages: str = ""

    @cached_property
    def logs(self) -> list[str]:
        """The recordings; BadOption, see recordings_in."""
        from drivetool.files.disk import recordings_in

        return recordings_in(self.given)

    @property
    def log(self) -> str:
        """The recording of a step that takes one; BadOption: a folder with several."""
        if len(self.logs) > 1:
            raise BadOption("one recording", f"{len(self.logs)} in the folder {self.given[0]}",
                            "Name one of them.", self.logs)
        return self.logs[0]

    @property
    def inputs(self) -> list[str]:
        """Every path that is read."""
        return [*self.logs, *self.params, *self.more, *filter(None, (self.map, self.drive))]


@dataclass(frozen=True)
class Opened:
    """Everything read and checked: recordings, parameter files, the drive file if there is one."""

    experiments: tuple[Experiment, ...]
    loaded: Loaded
    shape: Loaded | None = field(default=None)

    @property
    def inputs(self) -> tuple[tuple[str, str], ...]:
        """(name, sha256) of every parameter file that was read."""
        return (self.shape.inputs if self.shape else ()) + self.loaded.inputs
