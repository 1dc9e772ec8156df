"""The page of a diagnosis: one HTML file that needs nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape as _escape

from drivetool.check.outcome import OUTSIDE_CATALOGUE, Diagnosis, Gain
from drivetool.files.figures import svg
from drivetool.files.pages.report_style import CSS
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.tables import report_words as words, rounded, short

Sections = Mapping[str, shapes.ParameterSection]
_DIMMED_STATES = ("no-gain", "not-shown", "in-the-model", "failed")
_PICTURE_ORDER = ("diagnosis-record", "diagnosis-candidates", "diagnosis-residual-time",
                  "diagnosis-residual-reversal",
          "diagnosis-residual-speed", "diagnosis-residual-torque", "diagnosis-residual-order",
          "diagnosis-order-map")


def diagnosis_page(diagnosis: Diagnosis, file: shapes.ParameterFile, base: Sections) -> str:
    """The page as text; the same diagnosis gives the same bytes.

    file  what `diagnosis_file` made of the diagnosis
    base  the parameters as they were before, by name
    """
    records = ", ".join(entry.file for entry in file.data) or "the records"
    parts = [
        f"<h1>Diagnosis of {escape(records)}</h1>", _verdict_html(diagnosis), _gain_html(diagnosis.gain),
        _causes_html(diagnosis), _pictures_html(diagnosis), _candidates_html(file.diagnosis),
        _parameters_html(base, file.parameters), _findings_html(file.findings), _footer_html(file)]
    body = "\n".join(part for part in parts if part)
    return ("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
            f"<title>Diagnosis of {escape(records)}</title>\n<style>\n{CSS}\n</style>\n</head>\n<body>\n"
            f"{body}\n</body>\n</html>\n")


def escape(text: str) -> str:
    """Text for HTML, with the plus-minus sign."""
    return _escape(text).replace("+-", "&plusmn;")


def _verdict_html(diagnosis: Diagnosis) -> str:
    """The verdict, at the top of the page."""
    experiment = f"<p>{escape(diagnosis.experiment)}</p>" if diagnosis.experiment else ""
    return (f'<div class="verdict {diagnosis.verdict}"><strong>{words.VERDICTS[diagnosis.verdict]}</strong>'
            f"<p>{escape(diagnosis.sentence)}</p>{experiment}</div>")


def _gain_html(gain: Gain) -> str:
    """The figures of the gain, each with its name."""
    def change(before: float, after: float, unit: str) -> str:
        return f"{short(before, 4)} &rarr; {short(after, 4)} {escape(unit)}"

    rows = [(change(gain.held_out_rmse_before, gain.held_out_rmse_after, gain.unit), "error on data held out"),
            (change(gain.held_out_fit_before, gain.held_out_fit_after, "%"), "fit on data held out"),
            (f"{short(gain.noise_floor, 3)} {escape(gain.unit)}", "noise of the sensor alone"),
            (f"{short(gain.unexplained_percent, 3)} %", "of the base model's unexplained log likelihood remains")]
    boxes = "".join(f"<div><b>{value}</b><span>{label}</span></div>" for value, label in rows if "nan" not in value)
    fresh = "" if gain.further_record_interval is None else (
        " On a further record of this length the error decreases by {} to {}".format(
            *(short(end, 3) for end in gain.further_record_interval)) + f" {escape(gain.unit)} (95 %).")
    what = f"Free runs of {gain.segment:g} s each" if gain.of == "motion" else "Torque that the motion requires"
    return (f'<div class="figures">{boxes}</div>\n<p class="small">{what}, on held-out data.'
            f"{fresh}</p>")


def _causes_html(diagnosis: Diagnosis) -> str:
    """A paragraph per cause, and the decision of each round."""
    lines = ["<h2>What was found</h2>"]
    final = {p.name: p for p in diagnosis.estimate.parameters}
    for found in words.reported_candidates(diagnosis):
        is_found, is_closest = found.code in diagnosis.causes, found.code in diagnosis.closest
        # In the extended drive, with the others.
        is_part = OUTSIDE_CATALOGUE in diagnosis.between and found.code != OUTSIDE_CATALOGUE
        name, text, look = words.cause_words(found, final if is_found or is_closest or is_part else {})
        qualifier = "" if is_found else " (comes closest)" if is_closest else (
            " (part of the cause, or the whole cause)" if is_part else " (one of the possible causes)")
        law = f' <span class="small">Law: <code>{escape(found.law)}</code></span>' if found.law else ""
        lines.append(f"<h3>{escape(name)}{qualifier}</h3>\n<p>{escape(text)} {escape(look)}{law}</p>")
    if len(lines) == 1:
        lines.append("<p>No cause of the catalogue has a significant gain. The table below states the smallest "
                     "size of each that is detectable in this record.</p>")
    lines.append(_list_html(words.round_words(n, one) for n, one in enumerate(diagnosis.rounds, 1)))
    return "\n".join(lines)


def _pictures_html(diagnosis: Diagnosis) -> str:
    """Every figure with how to read it."""
    plots = [e for kind in _PICTURE_ORDER for e in diagnosis.exhibits if e.kind == kind]
    if not plots:
        return ""
    lines, explained = ["<h2>Plots</h2>"], set()
    for n, plot in enumerate(plots, 1):
        lines.append(f"<figure>\n{_inline_svg(svg(plot), n, plot.title)}")
        if plot.kind not in explained:  # once is enough
            lines.append(f"<figcaption>{escape(words.CAPTIONS[plot.kind])}</figcaption>")
        lines.append("</figure>")
        explained.add(plot.kind)
    return "\n".join(lines)


def _inline_svg(text: str, number: int, title: str) -> str:
    """An SVG that fills its column, with ids that are unique in the page."""
    text = re.sub(r'(?<=[ "(])(id="|xlink:href="#|url\(#|href="#)', rf"\g<1>f{number}-", text)
    text = re.sub(r' d="[^"]*"', lambda d: re.sub(r"(\.\d\d)\d+", r"\1", d[0]), text)  # hundredths of a point
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    head, close, rest = text.partition(">")
    head = re.sub(r'\s(width|height)="[^"]*"', "", head)
    return f'{head} role="img" aria-label="{escape(title)}"{close}{rest}'


def _candidates_html(section: shapes.DiagnosisSection) -> str:
    """All candidates of all rounds."""
    lines = ["<h2>What was looked for</h2>",
             '<p class="small">Gain: log likelihood gained on data held out, with its standard error. Evidence: '
             "log10 of the likelihood ratio, with the cause over without it.</p>"]
    for one in section.rounds:
        rows = []
        mine = [c for c in section.candidates if c.round == one.round]
        for each in sorted(mine, key=lambda c: (c.gain is None, -(c.gain or 0.0))):
            style = each.state if each.state == "named" else "faint" if each.state in _DIMMED_STATES else ""
            reason = f'<br><span class="small">{escape(each.reason)}</span>' if each.reason else ""
            rows.append((style, (
                f"{escape(each.code)}{reason}", escape(words.gain_text(each)),
                "-" if each.evidence is None else f"{each.evidence:.1f}", escape(words.STATES[each.state]),
                escape(words.detection_limits(each)) or "-")))
        lines.append(_table_html(f"Round {one.round}", (
            "cause", "gain", "evidence", "verdict", "detection limit"), (1, 2), rows))
    return "\n".join(lines)


def _parameters_html(base: Sections, after: Sections) -> str:
    """Every value before and after."""
    rows = []
    for name in dict.fromkeys([*base, *after]):
        old, new = base.get(name), after.get(name)
        if old is None and new.status == "held":
            continue
        style = "named" if old is None or old.value is None else "faint" if new and new.status == "held" else ""
        status = "removed" if new is None else new.status.replace("-", " ")
        unit = (new or old).unit or ""
        rows.append((style,
                     (f"<code>{escape(name)}</code>", _value_html(old), _value_html(new), escape(unit), status)))
    return "<h2>Parameters</h2>\n" + _table_html(
        "Value &plusmn; one standard deviation", ("parameter", "before", "after", "unit", "status"), (1, 2), rows)


def _value_html(entry: shapes.ParameterSection | None) -> str:
    """'0.5871 +- 0.0012'."""
    if entry is None or entry.value is None:
        return "-"
    value, std = rounded(entry.value, entry.std)
    return value if entry.std is None else f"{value} &plusmn; {std}"


def _findings_html(findings: Sequence[shapes.FindingSection]) -> str:
    """The findings about the recordings and the fit."""
    if not findings:
        return ""
    return "<h2>Also noticed</h2>\n" + _list_html(
        f"{f.severity.capitalize()}: {f.text} {f.action}".strip() for f in findings)


def _footer_html(file: shapes.ParameterFile) -> str:
    """The program and the files behind this page."""
    entries = [f"{entry.file} (SHA-256 {entry.sha256[:16]})" for entry in (*file.data, *file.inputs)]
    return (f'<footer class="small"><p>{escape(file.tool.name)} {escape(file.tool.version)}, from '
            f"{escape(', '.join(entries)) or 'no file'}.</p></footer>")


def _table_html(caption: str, titles: Sequence[str], numbers: Sequence[int],
           rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """A table that scrolls sideways where it must; cells are HTML."""
    def cell(tag: str, k: int, text: str) -> str:
        return f'<{tag}{" class=" + chr(34) + "n" + chr(34) if k in numbers else ""}>{text}</{tag}>'

    head = "".join(cell("th", k, title) for k, title in enumerate(titles))
    lines = [(style, "".join(cell("td", k, text) for k, text in enumerate(cells))) for style, cells in rows]
    body = "\n".join(f'<tr class="{style or "plain"}">{cells}</tr>' for style, cells in lines)
    return (f'<div class="scroll"><table>\n<caption>{caption}</caption>\n<thead><tr>{head}</tr></thead>\n'
            f"<tbody>\n{body}\n</tbody>\n</table></div>")


def _list_html(lines: Iterable[str]) -> str:
    """Bullets; the lines are plain text."""
    items = "\n".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<ul>\n{items}\n</ul>" if items else ""
