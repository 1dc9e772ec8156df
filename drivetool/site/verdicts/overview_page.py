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
from drivetool.logs.formats.tables import natural
from drivetool.site.results import FIT, Entry
from drivetool.site.verdicts.cases import Case

OWN_CSS = "body { max-width: 72rem; } td.missed { border-left: 3px solid #d9730d; padding-left: 0.6rem; }"
Outputs = Mapping[tuple[str, str, str], str]  # (machine, recording, step) -> file from the folder of the page
HEADS = ("Machine", "Recording", "Began (UTC)", "Files", "Fit", "Findings", "Missed")


def index_page(entries: Sequence[Entry], cases: Sequence[Case], outputs: Outputs,
               changed: Sequence[Finding] = ()) -> str:
    """The page as text; the same results give the same bytes.

    entries  of the summary, in its order
    cases    of the bars
    changed  what the trends of the site say, alarms first
    """
    missed: dict[tuple[str, str], list[Case]] = {}
    for case in cases:
        if not case.passed:
            missed.setdefault((case.machine, case.recording), []).append(case)
    groups: dict[str, dict[str, list[Entry]]] = {}
    for entry in entries:
        groups.setdefault(entry.machine, {}).setdefault(entry.recording, []).append(entry)
    rows = [_row(machine, recording, groups[machine][recording], missed.get((machine, recording), []), outputs)
            for machine in _worst_first(groups, missed, changed) for recording in groups[machine]]
    recordings = sum(bool(recording) for group in groups.values() for recording in group)
    bad = sum(map(len, missed.values()))
    everywhere = "".join(f"<p>{escape(case.text)}</p>" for (machine, _), several in missed.items()
                         if machine not in groups for case in several)
    kind = "nothing-found" if not bad else "unexplained"
    said = f"{bad} of {len(cases)} verdicts are missed" if bad else f"All {len(cases)} verdicts are met"
    heads = "".join(f'<th{" class=n" if head == "Fit" else ""}>{head}</th>' for head in HEADS)
    return ("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
            f"<title>Site of recordings</title>\n<style>\n{CSS}\n{OWN_CSS}\n</style>\n</head>\n<body>\n"
            f"<h1>Site of recordings</h1>\n<div class=\"verdict {kind}\"><strong>{said}</strong>"
            f"<p>{recordings} recordings of {len(groups)} machines; the machine with most missed comes first. "
            f"All values are in <a href=\"summary.csv\">summary.csv</a>.</p>{everywhere}</div>\n{_changed(changed)}"
            f"<div class=\"scroll\"><table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n" + "\n".join(rows)
            + "\n</tbody>\n</table></div>\n</body>\n</html>\n")


def _changed(changed: Sequence[Finding]) -> str:
    """The alarms and the recordings far from all others, in words; nothing where there are none."""
    if not changed:
        return ""
    told = "\n".join(f"<li>{escape(finding.text)}</li>" for finding in changed)
    return ("<h2>What changed</h2>\n"
            f"<ul>\n{told}\n</ul>\n<p>Means, drifts and steps of all series are in "
            '<a href="trends.yaml">trends.yaml</a>.</p>\n')


def _worst_first(groups: Mapping[str, Mapping[str, Sequence[Entry]]],
                 missed: Mapping[tuple[str, str], Sequence[Case]], changed: Sequence[Finding]) -> list[str]:
    """Machines by missed bars, then by what changed, then failure findings, then warnings, then name."""
    alarms = Counter(finding.evidence["machine"] for finding in changed)
    bars = Counter(machine for (machine, _), several in missed.items() for _ in several)

    def badness(machine: str) -> tuple[int, int, int, int]:
        severities = [severity for several in groups[machine].values() for entry in several
                      if entry.told is not None for severity, _, _ in entry.told.findings]
        return -bars[machine], -alarms[machine], -severities.count("failure"), -severities.count("warning")

    return sorted(groups, key=lambda machine: (badness(machine), natural(Path(machine))))


def _row(machine: str, recording: str, several: Sequence[Entry], missed: Sequence[Case], outputs: Outputs) -> str:
    files, codes, fit = [], [], None
    for entry in several:
        path = outputs.get((machine, recording, entry.step))
        link = "" if path is None else f'<a href="{quote(os.fsencode(path))}">{escape(entry.step)}</a>'
        files.append(link or escape(entry.step))
        if entry.told is not None:
            codes += [code for _, code, _ in entry.told.findings]
            fit = (entry.told.fit or {}).get(FIT, fit)
    texts = "<br>".join(escape(f"{case.name}: {case.text}") for case in missed)
    shown = escape(recording) if recording else "all together"
    cells = [f"<td>{escape(machine) or 'not known'}</td>", f"<td>{shown}</td>",
             f"<td>{escape((several[0].start or '')[:19].replace('T', ' '))}</td>", f"<td>{' '.join(files)}</td>",
             f'<td class="n">{"" if fit is None else f"{fit:.2f} %"}</td>',
             f"<td>{' '.join(f'<code>{escape(code)}</code>' for code in dict.fromkeys(codes))}</td>",
             f'<td{" class=missed" if missed else ""}>{texts}</td>']
    return f"<tr>{''.join(cells)}</tr>"
