"""Errors and findings: an error states wanted, found, available, do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Annotated

import msgspec
from msgspec import Meta

from drivetool.finding_codes import CODES, RENAMED, Severity
from drivetool.results import Shape


class DriveToolError(Exception):
    """Base of every error a user may see; the message is one sentence or two.

    wanted     what the step needed
    found      what there was instead
    available  names that would have been accepted, if the list helps
    do         what the reader can do about it
    """

    def __init__(self, wanted: str, found: str, do: str, available: Iterable[str] = ()):
        self.wanted, self.found, self.do = wanted, found, do
        self.available = tuple(available)
        text = f"wanted {wanted}; found {found}"
        if self.available:
            text += f" (available: {', '.join(self.available)})"
        super().__init__(f"{text}. {do}")


class BadRecording(DriveToolError):
    """A log that cannot be read, or lacks data that the step needs."""


class BadParameters(DriveToolError):
    """A parameter file, name or value that cannot be used."""


class BadOption(DriveToolError):
    """Options that do not fit together, or are out of range: wrong usage."""


class CannotWrite(DriveToolError):
    """A result that cannot be written to the disk, whatever the options."""


class NotEnoughData(DriveToolError):
    """The record is readable but contains too little data for this step."""


class Notice(UserWarning):
    """A message about the tool itself, not about a recording: the only kind of warning that is shown."""


class FindingSection(Shape):
    """Something a person should know."""

    severity: Severity
    code: Annotated[str, Meta(description="stable, for scripts")]
    text: str
    evidence: Annotated[
        dict[str, float | int | str | None], Meta(description="the numbers behind it")] = {}
    action: Annotated[str, Meta(description="what to do about it")] = ""

    def __post_init__(self) -> None:
        """The present code in the place of one that an earlier version wrote."""
        msgspec.structs.force_setattr(self, "code", RENAMED.get(self.code, self.code))


class Finding(FindingSection):
    """Something a person should know about a recording, a fit or a model.

    code       one of `finding_codes`: stable, lower case with hyphens, for scripts
    text       one sentence for a plant engineer
    evidence   the numbers behind it, name -> value in SI
    action     what to do about it; empty if nothing
    parameter  of the estimate, if it is about one alone; for the steps within a run, and in no file
    """

    parameter: str | None = None

    def __post_init__(self) -> None:
        """Refuse a code that the registry, and so the reference pages, lack."""
        if self.code not in CODES:
            raise ValueError(f"'{self.code}' is no registered finding code; enter it into drivetool/finding_codes.")

    def __eq__(self, other: object) -> bool:
        """As in a file: `parameter` alone does not make a second one."""
        if not isinstance(other, Finding):
            return NotImplemented
        return all(getattr(self, n) == getattr(other, n) for n in FindingSection.__struct_fields__)


def nearest(name: str, known: Iterable[str]) -> str:
    """The sentence part that suggests a name, or lists what there is."""
    known = list(known)
    matches = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f"Did you mean '{matches[0]}'?" if matches else f"Known are: {', '.join(known)}."
