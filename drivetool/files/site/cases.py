"""The verdicts of a site: a case per bar and recording."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """One bar and one recording.

    name      the bar, or "STEP runs"
    text      what was wanted, found, and what to do; empty if passed
    warnings  of the files that were judged
    """

    machine: str
    recording: str
    name: str
    passed: bool
    text: str
    warnings: tuple[str, ...] = ()


def junit(cases: Iterable[Case]) -> str:
    """The cases as JUnit XML."""
    raise NotImplementedError


def markdown(cases: Iterable[Case]) -> str:
    """The cases as Markdown."""
    raise NotImplementedError
