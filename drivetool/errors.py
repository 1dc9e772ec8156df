"""Errors: each states wanted, found, available, do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


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


class ImpossibleValues(BadParameters):
    """Values that no drive has together; in a fit they end a trial, not the fit."""


class BadOption(DriveToolError):
    """Options that do not fit together, or are out of range: wrong usage."""


class CannotWrite(DriveToolError):
    """A result that cannot be written to the disk, whatever the options."""


class NotEnoughData(DriveToolError):
    """The record is readable but contains too little data for this step."""


class Notice(UserWarning):
    """A message about the tool itself, not about a recording: the only kind of warning that is shown."""


def nearest(name: str, known: Iterable[str]) -> str:
    """The sentence part that suggests a name, or lists what there is."""
    known = list(known)
    matches = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f"Did you mean '{matches[0]}'?" if matches else f"Known are: {', '.join(known)}."
