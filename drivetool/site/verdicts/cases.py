"""Verdicts for a CI server: JUnit XML, and Markdown for a step summary."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

from drivetool.files.yaml import visible

# Markdown and the HTML in it take these for their own. A star or a bracket within a file's name is one, too.
_MARKED = re.compile(r"([\\`*_{}\[\]<>#|~$@])")
MOST_LISTED = 200  # missed bars in a step summary, which may have 1 MiB on GitHub


@dataclass(frozen=True)
class Case:
    """One bar of one recording, or one step that was to run.

    machine, recording  whom it is about; recording is empty for a bar of the machine as a whole
    name      the bar as it was written, or 'STEP runs'
    passed    whether it is met
    text      what was wanted, what was found and what to do; empty if passed
    warnings  findings about the recording, one text each
    """

    machine: str
    recording: str
    name: str
    passed: bool
    text: str
    warnings: tuple[str, ...] = ()


def junit(cases: Sequence[Case]) -> str:
    """The cases as JUnit XML: a testsuite per machine, a testcase per bar and recording.

    cases    in any order; machines come in the order of their first case
    returns  UTF-8 text without times, so that the same cases give the same bytes. The text of a failure is its
             body, the first line also its message; warnings are in system-out. What XML cannot hold is written as
             in source code.
    source   testmoapp/junitxml, the form that GitLab, Jenkins and GitHub actions read
    """
    lines = ['<?xml version="1.0" encoding="UTF-8"?>',
             f'<testsuites name="drivetool" tests="{len(cases)}" failures="{missed(cases)}" errors="0">']
    for machine, own in _by_machine(cases).items():
        lines.append(f'  <testsuite name={_attribute(machine)} tests="{len(own)}" failures="{missed(own)}" '
                     'errors="0" skipped="0">')
        for case in own:
            lines += _testcase(case)
        lines.append("  </testsuite>")
    return "\n".join([*lines, "</testsuites>", ""])


def markdown(cases: Sequence[Case]) -> str:
    """The cases as Markdown: a table of the machines, what is missed, and the warnings folded away.

    cases    as for `junit`
    returns  UTF-8 text for the step summary of GitHub, or a comment on a merge request
    """
    bad = missed(cases)
    verdict = f"{bad} of {len(cases)} checks failed" if bad else f"{len(cases)} checks passed"
    lines = [f"# drivetool: {verdict}", "", "| machine | checks | failed | warnings |", "|---|---:|---:|---:|"]
    for machine, own in _by_machine(cases).items():
        lines.append(f"| {_marked(machine)} | {len(own)} | {missed(own)} | {len(_warnings(own))} |")
    misses = [f"- **{_marked(_who(case))}**, {_marked(case.name)}: {_marked(case.text)}"
              for case in cases if not case.passed]
    warnings = [f"- {_marked(who)}: {_marked(text)}" for who, text in _warnings(cases)]
    if misses:
        lines += ["", "## Failed", "", *_listed(misses)]
    if warnings:
        lines += ["", "<details><summary>Warnings</summary>", "", *_listed(warnings), "", "</details>"]
    return "\n".join([*lines, ""])


def missed(cases: Sequence[Case]) -> int:
    """How many cases are not passed."""
    return sum(not case.passed for case in cases)


def _by_machine(cases: Sequence[Case]) -> dict[str, list[Case]]:
    found: dict[str, list[Case]] = {}
    for case in cases:
        found.setdefault(case.machine, []).append(case)
    return found


def _testcase(case: Case) -> list[str]:
    """The lines of one testcase."""
    head = f"    <testcase classname={_attribute(case.recording or case.machine)} name={_attribute(case.name)}"
    if case.passed and not case.warnings:
        return [f"{head}/>"]
    lines = [f"{head}>"]
    if not case.passed:
        first = case.text.partition("\n")[0]
        lines.append(f'      <failure message={_attribute(first)} type="bar">{_text(case.text)}</failure>')
    if case.warnings:
        shown = "\n".join(map(_text, case.warnings))
        lines.append(f"      <system-out>{shown}</system-out>")
    return [*lines, "    </testcase>"]


def _warnings(cases: Sequence[Case]) -> list[tuple[str, str]]:
    """(whom it is about, text), each once: all bars of a recording have the same."""
    return list(dict.fromkeys((_who(case), text) for case in cases for text in case.warnings))


def _who(case: Case) -> str:
    return case.recording or case.machine


def _listed(lines: Sequence[str]) -> list[str]:
    more = len(lines) - MOST_LISTED
    return [*lines[:MOST_LISTED], *([f"- and {more} more"] if more > 0 else [])]


def _attribute(text: str) -> str:
    return quoteattr(visible(text))


def _text(text: str) -> str:
    return escape(visible(text))


def _marked(text: str) -> str:
    """A text that Markdown shows as it is, in one line."""
    return _MARKED.sub(r"\\\1", " ".join(visible(text).split()))
