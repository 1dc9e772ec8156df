"""Bars against results: a case per bar and recording, and one for each step that it ran."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from drivetool.errors import BadParameters
from drivetool.files.shapes import BarSection, MeasureSection
from drivetool.files.yaml import units
from drivetool.site.results import Entry, Told
from drivetool.site.verdicts.cases import Case

EVERYWHERE = "all machines"  # of a bar that no recording can meet or miss
UNITLESS = (None, "", "1", "%")  # a limit of these is a number alone
FORBIDDEN = {"no-failure": ("failure",), "no-warning": ("failure", "warning")}


@dataclass(frozen=True)
class Figure:
    """A value that a file states, with its unit; None where it has none to state."""

    value: float | None
    unit: str | None


def judge(entries: Sequence[Entry], bars: Sequence[BarSection]) -> list[Case]:
    """The cases in the order of the entries, those of a bar after those that the steps ran.

    entries  of the summary
    returns  Cases; a bar on a figure that no file has is missed under the name of all machines
    """
    cases = []
    groups: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        groups.setdefault((entry.machine, entry.recording), []).append(entry)
    judged: set[int] = set()
    for (machine, recording), group in groups.items():
        cases += [_ran(entry) for entry in group]
        for i, bar in enumerate(bars):
            found = _of_figure(bar, group) if bar.figure else _of_findings(bar, group)
            if found is not None:
                judged.add(i)
                cases.append(Case(machine, recording, bar_name(bar), not found, found))
    return cases + [Case(EVERYWHERE, "", bar_name(bar), False, _nowhere(bar, entries))
                    for i, bar in enumerate(bars) if i not in judged]


def bar_name(bar: BarSection) -> str:
    """A bar in words, as in 'shaft.half_gap at most 5 mrad'."""
    step = f"{bar.step}: " if bar.step else ""
    if bar.findings:
        return f"{step}no findings of severity {' or '.join(FORBIDDEN[bar.findings])}"
    word, limit = ("at most", bar.at_most) if bar.at_least is None else ("at least", bar.at_least)
    size = f"{limit.value:g} {limit.unit}" if isinstance(limit, MeasureSection) else f"{limit:g}"
    return f"{step}{bar.figure} {word} {size}"


def _ran(entry: Entry) -> Case:
    """Whether a step gave a file that met the bars of its own command; its warnings."""
    told, text = entry.told, entry.problem or ""
    if told is not None and not told.passed:
        text = (f"wanted the limits of {entry.step} to be met; found them missed. See the findings of its file: "
                f"{' '.join(code for _, code, _ in told.findings) or 'none'}.")
    warnings = () if told is None else tuple(f"{code}: {said}" for severity, code, said in told.findings
                                             if severity == "warning")
    return Case(entry.machine, entry.recording, f"{entry.step} runs", not text, text, warnings)


def _told(bar: BarSection, group: Iterable[Entry]) -> list[tuple[str, Told]]:
    return [(e.step, e.told) for e in group if e.told is not None and bar.step in (None, e.step)]


def _of_findings(bar: BarSection, group: Sequence[Entry]) -> str | None:
    """Why a bar on findings is missed; empty if it is met; None where nothing was found at all."""
    told = _told(bar, group)
    if not told:
        return None
    bad = [f"{step}: {text}" for step, each in told for severity, _, text in each.findings
           if severity in FORBIDDEN[bar.findings or "no-failure"]]
    return f"wanted {bar_name(bar)}; found {len(bad)}. {' '.join(bad)}" if bad else ""


def _of_figure(bar: BarSection, group: Sequence[Entry]) -> str | None:
    """Why a bar on a figure is missed; empty if it is met; None where no file has the figure."""
    name = bar.figure or ""
    stated = [(step, figure) for step, each in _told(bar, group) for figure in [figures(each).get(name)] if figure]
    if not stated:
        return None
    step, figure = stated[-1]
    if figure.value is None:
        return f"wanted {bar_name(bar)}; found no value in the file of {step}, which says why. Look at it."
    limit = bar.at_most if bar.at_least is None else bar.at_least
    bound = limit.value if isinstance(limit, MeasureSection) else float(limit or 0.0)
    if isinstance(limit, MeasureSection):
        try:
            bound *= units.factor(limit.unit, figure.unit or "", name)
        except BadParameters as error:
            return f"{error}"
    elif figure.unit not in UNITLESS:
        return (f"wanted a unit with {bar_name(bar)}, a figure in {figure.unit}; found none. Write it as in "
                f"'{{value: {bound:g}, unit: {figure.unit}}}'.")
    met = figure.value <= bound if bar.at_least is None else figure.value >= bound
    unit = f" {figure.unit}" if figure.unit else ""
    return "" if met else (f"wanted {bar_name(bar)}; found {figure.value:.5g}{unit} in the file of {step}. Look at "
                           "the machine, the recording, or the bar.")


def figures(told: Told) -> Mapping[str, Figure]:
    """Every figure of a file by name."""
    found = {name: Figure(value, "%" if name.endswith("percent") else None)
             for name, value in (told.fit or {}).items()}
    return found | {row[0]: Figure(row[1], row[2]) for row in told.parameters}


def _nowhere(bar: BarSection, entries: Sequence[Entry]) -> str:
    if bar.findings:
        return (f"wanted {bar_name(bar)}; found no file of {bar.step or 'any step'}. See the problems in the "
                "summary.")
    known = sorted({name for e in entries if e.told is not None for name in figures(e.told)})
    return (f"wanted {bar_name(bar)}; found no file with it (available: {', '.join(known) or 'none'}). "
            "Correct the bar, or add the step that gives the figure.")
