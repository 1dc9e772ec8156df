"""The catalogue of effects, as plain values and as tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.check.causes import CAUSES
from drivetool.drive.effects import EFFECTS, Effect
from drivetool.errors import BadOption, nearest

Entry = Mapping[str, Any]
_OWNERS = {"body": "every body", "shaft": "every shaft", "motor": "the motor", "path": "the torque path",
           "sensor": "the speed sensor", "friction": "all bodies"}


def catalogue(code: str | None = None) -> list[dict[str, Any]]:
    """Every effect as plain values, then the causes of a diagnosis that are no effect of the drive.

    code    of one effect, or of one cause as diagnose names it; None: all of them
    raises  BadOption: an unknown code
    """
    entries = [_effect_entry(effect) for effect in EFFECTS]
    entries += [_cause_entry(name) for name, cause in CAUSES.items() if cause.effect is None]
    if code is None:
        return entries
    wanted = CAUSES[code].effect or code if code in CAUSES else code
    found = [entry for entry in entries if entry["code"] == wanted]
    if not found:
        known = dict.fromkeys([*(entry["code"] for entry in entries), *CAUSES])
        raise BadOption("an effect of the catalogue", f"'{code}'", nearest(code, known))
    return found


def print_catalogue(entries: Sequence[Entry], console: Console) -> None:
    """One row per effect."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False)
    for title in ("effect", "of", "law", "a record must contain", "diagnosed as"):
        table.add_column(title, overflow="fold", no_wrap=title == "effect")
    for entry in entries:
        table.add_row(*(Text(entry[key] or "-") for key in ("code", "of", "law", "needs")),
                      Text(", ".join(entry["diagnosed_as"]) or "-"))
    console.print(table)
    console.print(Text("  drivetool effects CODE describes one of them.", style="dim"))


def print_entry(entry: Entry, console: Console) -> None:
    """One effect in full."""
    rows = [("effect", entry["code"]), ("of", entry["of"]), ("law", entry["law"]), ("needs", entry["needs"]),
            ("source", entry["source"])]
    rows += [("found as", f"{code}: {words}") for code, words in entry["diagnosed_as"].items()]
    lines = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    for key, value in rows:
        if value:
            lines.add_row(Text(key, style="bold"), Text(value))
    console.print(lines)
    if not entry["parameters"]:
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False)
    for title in ("parameter", "unit", "bounds", "absent at", "meaning"):
        table.add_column(title, overflow="fold")
    for name, q in entry["parameters"].items():
        bounds = " to ".join("-" if b is None else f"{b:g}" for b in q["bounds"])
        neutral = "never" if q["neutral"] is None else str(q["neutral"])
        table.add_row(*map(Text, (name, q["unit"] or "-", bounds, neutral, q["meaning"])))
    console.print(table)


def _effect_entry(effect: Effect) -> dict[str, Any]:
    """An effect as plain values; units are those of a rotary drive in Nm."""
    return {
        "code": effect.code, "of": _OWNERS[effect.of], "law": effect.law,
        "parameters": {suffix: {
            "unit": q.unit_for("Nm", "rad"), "meaning": q.meaning, "bounds": list(q.bounds),
            "neutral": "infinite" if q.neutral is not None and math.isinf(q.neutral) else q.neutral}
            for suffix, q in effect.quantities.items()},
        "needs": effect.needs, "source": effect.source,
        "diagnosed_as": {code: c.name for code, c in CAUSES.items() if effect.code in (c.effect, *c.further)}}


def _cause_entry(code: str) -> dict[str, Any]:
    """A cause that is no effect of the drive itself, in the same form."""
    cause = CAUSES[code]
    return {"code": code, "of": cause.of, "law": cause.text,
            "parameters": {}, "needs": cause.needs, "source": "", "diagnosed_as": {code: cause.name}}
