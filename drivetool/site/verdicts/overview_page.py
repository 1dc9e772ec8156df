"""index.html of a site: one table, the worst machine first, with links to the files."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from drivetool.errors import Finding
from drivetool.files.pages import CSS
from drivetool.logs.formats.tables import natural_order
from drivetool.site.results import FIT_FIGURE, Entry
from drivetool.site.verdicts.cases import Case

PAGE_CSS = "body { max-width: 72rem; } td.missed { border-left: 3px solid #d9730d; padding-left: 0.6rem; }"
Outputs = Mapping[tuple[str, str, str], str]  # (machine, recording, step) -> file from the folder of the page
COLUMN_TITLES = ("Machine", "Recording", "Began (UTC)", "Files", "Fit", "Findings", "Missed")


def index_page(entries: Sequence[Entry], cases: Sequence[Case], outputs: Outputs,
               changed: Sequence[Finding] = ()) -> str:
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
    rows = [_recording_row(machine, recording, groups[machine][recording], missed.get((machine, recording), []),
                           outputs)
            for machine in _worst_first(groups, missed, changed) for recording in groups[machine]]
    recordings = sum(bool(recording) for group in groups.values() for recording in group)
    missed_bars = sum(map(len, missed.values()))
    everywhere = "".join(f"<p>{escape(case.text)}</p>" for (machine, _), several in missed.items()
                         if machine not in groups for case in several)
    kind = "nothing-found" if not missed_bars else "unexplained"
    headline = (f"{missed_bars} of {len(cases)} checks failed" if missed_bars
                else f"All {len(cases)} checks passed")
    heads = "".join(f'<th{" class=n" if head == "Fit" else ""}>{head}</th>' for head in COLUMN_TITLES)
    return ("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
            f"<title>Site of recordings</title>\n<style>\n{CSS}\n{PAGE_CSS}\n</style>\n</head>\n<body>\n"
            f"<h1>Site of recordings</h1>\n<div class=\"verdict {kind}\"><strong>{headline}</strong>"
            f"<p>{recordings} recordings of {len(groups)} machines; the machine with most failed checks comes "
            f"first. All values are in <a href=\"summary.csv\">summary.csv</a>.</p>{everywhere}</div>\n"
            f"{_changes_section(changed)}"
            f"<div class=\"scroll\"><table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n" + "\n".join(rows)
            + "\n</tbody>\n</table></div>\n</body>\n</html>\n")


def _changes_section(changed: Sequence[Finding]) -> str:
    """The alarms and outlying recordings as a list; empty if there are none."""
    if not changed:
        return ""
    items = "\n".join(f"<li>{escape(finding.text)}</li>" for finding in changed)
    return ("<h2>What changed</h2>\n"
            f"<ul>\n{items}\n</ul>\n<p>Means, drifts and steps of all series are in "
            '<a href="trends.yaml">trends.yaml</a>.</p>\n')


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


def _recording_row(machine: str, recording: str, several: Sequence[Entry], missed: Sequence[Case],
                   outputs: Outputs) -> str:
    files, codes, fit = [], [], None
    for entry in several:
        path = outputs.get((machine, recording, entry.step))
        link = "" if path is None else f'<a href="{quote(os.fsencode(path))}">{escape(entry.step)}</a>'
        files.append(link or escape(entry.step))
        if entry.result is not None:
            codes += [code for _, code, _ in entry.result.findings]
            fit = (entry.result.fit or {}).get(FIT_FIGURE, fit)
    texts = "<br>".join(escape(f"{case.name}: {case.text}") for case in missed)
    label = escape(recording) if recording else "all together"
    cells = [f"<td>{escape(machine) or 'not known'}</td>", f"<td>{label}</td>",
             f"<td>{escape((several[0].start or '')[:19].replace('T', ' '))}</td>", f"<td>{' '.join(files)}</td>",
             f'<td class="n">{"" if fit is None else f"{fit:.2f} %"}</td>',
             f"<td>{' '.join(f'<code>{escape(code)}</code>' for code in dict.fromkeys(codes))}</td>",
             f'<td{" class=missed" if missed else ""}>{texts}</td>']
    return f"<tr>{''.join(cells)}</tr>"
