"""index.html of a site: one table, the worst machine first, with links to the files."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from drivetool.files.pages import rendered
from drivetool.finding import Finding
from drivetool.logs import natural_order
from drivetool.site.results import FIT_FIGURE, Entry
from drivetool.site.verdicts.cases import Case


def index_page(entries: Sequence[Entry], cases: Sequence[Case], changed: Sequence[Finding] = ()) -> str:
    """The page as text; deterministic.

    entries  of the summary, in its order
    cases    of the bars
    changed  findings of the trends of the site, alarms first
    """
    missed: dict[tuple[str, str], list[Case]] = {}
    for case in cases:
        if not case.passed:
            missed.setdefault((case.machine, case.recording), []).append(case)
    groups: dict[str, dict[str, list[Entry]]] = {}
    for entry in entries:
        groups.setdefault(entry.machine, {}).setdefault(entry.recording, []).append(entry)
    rows = [_recording_row(machine, recording, groups[machine][recording], missed.get((machine, recording), ()))
            for machine in _worst_first(groups, missed, changed) for recording in groups[machine]]
    return rendered(
        "overview.html", rows=rows, changed=changed, checks=len(cases), failed=sum(map(len, missed.values())),
        recordings=sum(bool(row["recording"]) for row in rows), machines=len(groups),
        elsewhere=[case for (machine, _), several in missed.items() if machine not in groups for case in several])


def _worst_first(groups: Mapping[str, Mapping[str, Sequence[Entry]]],
                 missed: Mapping[tuple[str, str], Sequence[Case]], changed: Sequence[Finding]) -> list[str]:
    """Machines by missed bars, then trend findings, failure findings, warnings and name."""
    alarms = Counter(finding.evidence["machine"] for finding in changed)
    bars = Counter(machine for (machine, _), several in missed.items() for _ in several)

    def badness(machine: str) -> tuple[int, int, int, int]:
        severities = [severity for several in groups[machine].values() for entry in several
                      if entry.result is not None for severity, _, _ in entry.result.findings]
        return -bars[machine], -alarms[machine], -severities.count("failure"), -severities.count("warning")

    return sorted(groups, key=lambda machine: (badness(machine), natural_order(Path(machine))))


def _recording_row(machine: str, recording: str, several: Sequence[Entry],
                   missed: Sequence[Case]) -> dict[str, Any]:
    """The cells of a recording, or of all of a machine together."""
    results = [entry.result for entry in several if entry.result is not None]
    fits = [result.fit[FIT_FIGURE] for result in results if FIT_FIGURE in (result.fit or {})]
    return {"machine": machine, "recording": recording, "missed": missed,
            "began": (several[0].start or "")[:19].replace("T", " "),
            "files": [(entry.step, entry.output and quote(os.fsencode(entry.output))) for entry in several],
            "fit": "" if not fits or fits[-1] is None else f"{fits[-1]:.2f} %",
            "codes": dict.fromkeys(code for result in results for _, code, _ in result.findings)}
