"""Findings: what a person should know about a recording, a fit or a model."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from drivetool.finding_codes import CODES, RENAMED, Severity
from drivetool.results import Shape


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
