"""Verdicts for a CI server: JUnit XML, and Markdown for a step summary."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

from drivetool.files.yaml import escape_unprintable

# Characters with a meaning in Markdown or HTML; they also occur in names of files.
_MARKDOWN_SIGNS = re.compile(r"([\\`*_{}\[\]<>#|~$@])")
MAX_LINES_LISTED = 200  # GitHub limits a step summary to 1 MiB: a line may have 5 kB


@dataclass(frozen=True)
class Case:
    """One bar of one recording, or one step that was to run.

    machine, recording  its subject; recording is empty for a bar of the machine as a whole
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
             body, the first line also its message; warnings are in system-out. Characters that XML cannot hold are
             written as escapes.
    source   testmoapp/junitxml, the format that GitLab, Jenkins and GitHub Actions read
    """
    lines = ['<?xml version="1.0" encoding="UTF-8"?>',
             f'<testsuites name="drivetool" tests="{len(cases)}" failures="{missed_count(cases)}" errors="0">']
    for machine, own in _by_machine(cases).items():
        lines.append(f'  <testsuite name={_xml_attribute(machine)} tests="{len(own)}" '
                     f'failures="{missed_count(own)}" errors="0" skipped="0">')
        for case in own:
            lines += _testcase(case)
        lines.append("  </testsuite>")
    return "\n".join([*lines, "</testsuites>", ""])


def markdown(cases: Sequence[Case]) -> str:
    """The cases as Markdown: a table of the machines, the missed bars, and the warnings folded.

    cases    as for `junit`
    returns  UTF-8 text for the step summary of GitHub, or a comment on a merge request
    """
    bad = missed_count(cases)
    verdict = f"{bad} of {len(cases)} checks failed" if bad else f"{len(cases)} checks passed"
    lines = [f"# drivetool: {verdict}", "", "| machine | checks | failed | warnings |", "|---|---:|---:|---:|"]
    for machine, own in _by_machine(cases).items():
        lines.append(f"| {_markdown_text(machine)} | {len(own)} | {missed_count(own)} | {len(_warnings(own))} |")
    misses = [f"- **{_markdown_text(_recording_or_machine(case))}**, {_markdown_text(case.name)}: "
              f"{_markdown_text(case.text)}" for case in cases if not case.passed]
    warnings = [f"- {_markdown_text(who)}: {_markdown_text(text)}" for who, text in _warnings(cases)]
    if misses:
        lines += ["", "## Failed", "", *_list_start(misses)]
    if warnings:
        lines += ["", "<details><summary>Warnings</summary>", "", *_list_start(warnings), "", "</details>"]
    return "\n".join([*lines, ""])


def missed_count(cases: Sequence[Case]) -> int:
    """Number of cases that did not pass."""
    return sum(not case.passed for case in cases)


def _by_machine(cases: Sequence[Case]) -> dict[str, list[Case]]:
    found: dict[str, list[Case]] = {}
    for case in cases:
        found.setdefault(case.machine, []).append(case)
    return found


def _testcase(case: Case) -> list[str]:
    """The lines of one testcase."""
    head = (f"    <testcase classname={_xml_attribute(case.recording or case.machine)} "
            f"name={_xml_attribute(case.name)}")
    if case.passed and not case.warnings:
        return [f"{head}/>"]
    lines = [f"{head}>"]
    if not case.passed:
        first = case.text.partition("\n")[0]
        lines.append(f'      <failure message={_xml_attribute(first)} type="bar">{_xml_text(case.text)}</failure>')
    if case.warnings:
        warning_lines = "\n".join(map(_xml_text, case.warnings))
        lines.append(f"      <system-out>{warning_lines}</system-out>")
    return [*lines, "    </testcase>"]


def _warnings(cases: Sequence[Case]) -> list[tuple[str, str]]:
    """(recording or machine, text), each once: all bars of a recording have the same warnings."""
    return list(dict.fromkeys((_recording_or_machine(case), text) for case in cases for text in case.warnings))


def _recording_or_machine(case: Case) -> str:
    return case.recording or case.machine


def _list_start(lines: Sequence[str]) -> list[str]:
    more = len(lines) - MAX_LINES_LISTED
    return [*lines[:MAX_LINES_LISTED], *([f"- and {more} more"] if more > 0 else [])]


def _xml_attribute(text: str) -> str:
    return quoteattr(escape_unprintable(text))


def _xml_text(text: str) -> str:
    return escape(escape_unprintable(text))


def _markdown_text(text: str) -> str:
    """A text in one line that Markdown shows unchanged."""
    return _MARKDOWN_SIGNS.sub(r"\\\1", " ".join(escape_unprintable(text).split()))
