"""The page of a diagnosis: one HTML file that needs nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from html import escape

from drivetool.check.outcome import OUTSIDE_CATALOGUE, Diagnosis
from drivetool.files.figures import svg
from drivetool.files.pages.rendering import rendered
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.tables import report_words as words, short

_DIMMED_STATES = ("no-gain", "not-shown", "in-the-model", "failed")


def diagnosis_page(diagnosis: Diagnosis, file: shapes.ParameterFile,
                   base: Mapping[str, shapes.ParameterSection]) -> str:
    """The page as text; the same diagnosis gives the same bytes.

    file  what `diagnosis_file` made of the diagnosis
    base  the parameters as they were before, by name
    """
    section, after = file.diagnosis, file.parameters
    pairs = ((name, base.get(name), after.get(name)) for name in dict.fromkeys([*base, *after]))
    return rendered(
        "diagnosis.html", diagnosis=diagnosis, file=file, gain=diagnosis.gain, words=words, short=short,
        records=", ".join(entry.file for entry in file.data) or "the records",
        causes=list(_causes(diagnosis)), pictures=list(_pictures(diagnosis)),
        rounds=[(one, sorted((c for c in section.candidates if c.round == one.round),
                             key=lambda c: (c.gain is None, -(c.gain or 0.0)))) for one in section.rounds],
        dimmed=_DIMMED_STATES,
        parameters=[(name, old, new) for name, old, new in pairs if old is not None or new.status != "held"],
        sources=", ".join(f"{entry.file} (SHA-256 {entry.sha256[:16]})" for entry in (*file.data, *file.inputs)))


def _causes(diagnosis: Diagnosis) -> Iterator[tuple[str, str, str, str]]:
    """(name, qualifier, sentences, law) of each cause."""
    final = {p.name: p for p in diagnosis.estimate.parameters}
    for found in words.reported_candidates(diagnosis):
        is_found, is_closest = found.code in diagnosis.causes, found.code in diagnosis.closest
        # In the extended drive, with the others.
        is_part = OUTSIDE_CATALOGUE in diagnosis.between and found.code != OUTSIDE_CATALOGUE
        name, text, look = words.cause_words(found, final if is_found or is_closest or is_part else {})
        qualifier = "" if is_found else " (comes closest)" if is_closest else (
            " (part of the cause, or the whole cause)" if is_part else " (one of the possible causes)")
        yield name, qualifier, f"{text} {look}".strip(), found.law


def _pictures(diagnosis: Diagnosis) -> Iterator[tuple[str, str]]:
    """(picture, how to read it) of every figure; the first of its kind is explained."""
    plots = [e for kind in words.CAPTIONS for e in diagnosis.exhibits if e.kind == kind]
    for n, plot in enumerate(plots):
        explained = any(other.kind == plot.kind for other in plots[:n])
        yield _inline_svg(svg(plot), n + 1, plot.title), "" if explained else words.CAPTIONS[plot.kind]


def _inline_svg(text: str, number: int, title: str) -> str:
    """An SVG that fills its column, with ids that are unique in the page."""
    text = re.sub(r'(?<=[ "(])(id="|xlink:href="#|url\(#|href="#)', rf"\g<1>f{number}-", text)
    text = re.sub(r' d="[^"]*"', lambda d: re.sub(r"(\.\d\d)\d+", r"\1", d[0]), text)  # hundredths of a point
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    head, close, rest = text.partition(">")
    head = re.sub(r'\s(width|height)="[^"]*"', "", head)
    return f'{head} role="img" aria-label="{escape(title)}"{close}{rest}'
