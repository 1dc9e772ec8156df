"""The catalogues of effects and of finding codes, as plain values and as tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console

from drivetool.check.causes import CAUSES
from drivetool.drive.effects import EFFECTS, Effect
from drivetool.errors import BadOption, nearest
from drivetool.files.tables.table import Column, Row, Table, lines, pairs
from drivetool.finding_codes import CODES, RENAMED, STAGES

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
    columns = [Column("effect", least=24), *map(Column, ("of", "law", "a record must contain", "diagnosed as"))]
    console.print(Table(columns, [Row((each["code"], each["of"], each["law"] or "-", each["needs"] or "-",
                                       ", ".join(each["diagnosed_as"]) or "-")) for each in entries]))
    console.print(lines(["drivetool effects CODE describes one of them."], "dim"))


def print_entry(entry: Entry, console: Console) -> None:
    """One effect in full."""
    shown = [(key, entry[key]) for key in ("code", "of", "law", "needs", "source") if entry[key]]
    shown += [("found as", f"{code}: {words}") for code, words in entry["diagnosed_as"].items()]
    console.print(pairs((key.replace("code", "effect"), text) for key, text in shown))
    rows = [Row((name, q["unit"] or "-", " to ".join("-" if b is None else f"{b:g}" for b in q["bounds"]),
                 "never" if q["neutral"] is None else str(q["neutral"]), q["meaning"]))
            for name, q in entry["parameters"].items()]
    if rows:
        columns = [Column(title, fold=False) for title in ("unit", "bounds", "absent at")]
        console.print(Table([Column("parameter", least=24), *columns, Column("meaning")], rows))


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


def finding_entries(code: str | None = None) -> list[dict[str, Any]]:
    """Every code as plain values, stage by stage.

    code    of one finding, also as an earlier version named it; None: all of them
    raises  BadOption: an unknown code
    """
    code = RENAMED.get(code or "", code)
    if code is not None and code not in CODES:
        raise BadOption("a registered finding code", f"'{code}'", nearest(code, CODES))
    return [{"code": name, "stage": stage, "severities": list(entry.severities), "meaning": entry.meaning,
             "action": entry.action}
            for stage, table in STAGES.items() for name, entry in table.items() if code in (None, name)]


def print_findings_list(entries: Sequence[Entry], console: Console) -> None:
    """One row per code, a table per stage."""
    columns = [Column("code", least=24), Column("severity"), Column("meaning")]
    for stage in dict.fromkeys(entry["stage"] for entry in entries):
        console.print(Table(columns, [Row((each["code"], "/".join(each["severities"]), each["meaning"]))
                                      for each in entries if each["stage"] == stage], stage))
    console.print(lines(["drivetool findings CODE gives the action for one of them."], "dim"))


def print_finding(entry: Entry, console: Console) -> None:
    """One code in full."""
    names = {"severities": "severity", "action": "what to do"}
    console.print(pairs((names.get(key, key), " or ".join(value) if key == "severities" else value)
                        for key, value in entry.items()))
