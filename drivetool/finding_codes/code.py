"""The form of an entry of the registry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["note", "warning", "failure"]


@dataclass(frozen=True)
class Code:
    """What a finding code stands for, whatever the numbers of a single finding.

    severities  that it may have, the mildest first
    meaning     what was seen, and what that says about the record, the fit or the model
    action      what to do about it
    """

    severities: tuple[Severity, ...]
    meaning: str
    action: str


NOTE: tuple[Severity, ...] = ("note",)
WARNING: tuple[Severity, ...] = ("warning",)
FAILURE: tuple[Severity, ...] = ("failure",)
NOTE_OR_WARNING: tuple[Severity, ...] = ("note", "warning")
WARNING_OR_FAILURE: tuple[Severity, ...] = ("warning", "failure")
