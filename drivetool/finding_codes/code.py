"""The form of an entry of the registry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["note", "warning", "failure"]
Says = Literal["", "doubt", "shift", "sum"]


@dataclass(frozen=True)
class Code:
    """What a finding code stands for, whatever the numbers of a single finding.

    severities  that it may have, the mildest first
    meaning     what was seen, and what that says about the record, the fit or the model
    action      what to do about it
    says        what is read back from it in a file, which has no other place for that. doubt: the structure is not
                the machine's; shift: the torque is logged some samples off; sum: a friction is that of two
    """

    severities: tuple[Severity, ...]
    meaning: str
    action: str
    says: Says = ""


NOTE: tuple[Severity, ...] = ("note",)
WARNING: tuple[Severity, ...] = ("warning",)
FAILURE: tuple[Severity, ...] = ("failure",)
NOTE_OR_WARNING: tuple[Severity, ...] = ("note", "warning")
WARNING_OR_FAILURE: tuple[Severity, ...] = ("warning", "failure")
NOTE_OR_FAILURE: tuple[Severity, ...] = ("note", "failure")
