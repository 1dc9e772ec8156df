"""Bars against results: a case per bar and recording, and one for the run of each step."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from drivetool.check.outcome import SizeSection
from drivetool.errors import BadParameters
from drivetool.files.shapes import BarSection, MeasureSection
from drivetool.files.yaml import units
from drivetool.site.results import Entry, StepResult
from drivetool.site.verdicts.cases import Case

ALL_MACHINES = "all machines"  # of a bar to which no recording applies
DIMENSIONLESS_UNITS = (None, "", "1", "%")  # with these units a limit is a plain number
FORBIDDEN_SEVERITIES = {"no-failure": ("failure",), "no-warning": ("failure", "warning")}


def evaluate_bars(entries: Sequence[Entry], bars: Sequence[BarSection]) -> list[Case]:
    """The cases in the order of the entries, those of the bars after those of the runs.

    entries  of the summary
    returns  Cases; a bar on a figure that no file has is missed for all machines
    """
    cases = []
    groups: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        groups.setdefault((entry.machine, entry.recording), []).append(entry)
    evaluated: set[int] = set()
    for (machine, recording), group in groups.items():
        cases += [_step_case(entry) for entry in group]
        for i, bar in enumerate(bars):
            found = _check_figure(bar, group) if bar.figure else _check_findings(bar, group)
            if found is not None:
                evaluated.add(i)
                cases.append(Case(machine, recording, bar_name(bar), not found, found))
    return cases + [Case(ALL_MACHINES, "", bar_name(bar), False, _no_file_sentence(bar, entries))
                    for i, bar in enumerate(bars) if i not in evaluated]


def bar_name(bar: BarSection) -> str:
    """A bar in words, as in 'shaft.half_gap at most 5 mrad'."""
    step = f"{bar.step}: " if bar.step else ""
    if bar.findings:
        return f"{step}no findings of severity {' or '.join(FORBIDDEN_SEVERITIES[bar.findings])}"
    word, limit = ("at most", bar.at_most) if bar.at_least is None else ("at least", bar.at_least)
    size = f"{limit.value:g} {limit.unit}" if isinstance(limit, MeasureSection) else f"{limit:g}"
    return f"{step}{bar.figure} {word} {size}"


def _step_case(entry: Entry) -> Case:
    """Whether a step gave a file that met the limits of its command; its warnings."""
    result, text = entry.result, entry.problem or ""
    if result is not None and not result.passed:
        text = (f"wanted the limits of {entry.step} to be met; found them missed. See the findings of its file: "
                f"{' '.join(code for _, code, _ in result.findings) or 'none'}.")
    warnings = () if result is None else tuple(f"{code}: {said}" for severity, code, said in result.findings
                                             if severity == "warning")
    return Case(entry.machine, entry.recording, f"{entry.step} runs", not text, text, warnings)


def _step_results(bar: BarSection, group: Iterable[Entry]) -> list[tuple[str, StepResult]]:
    return [(e.step, e.result) for e in group if e.result is not None and bar.step in (None, e.step)]


def _check_findings(bar: BarSection, group: Sequence[Entry]) -> str | None:
    """Why a bar on findings is missed; empty if it is met; None where no step gave a file."""
    results = _step_results(bar, group)
    if not results:
        return None
    bad = [f"{step}: {text}" for step, each in results for severity, _, text in each.findings
           if severity in FORBIDDEN_SEVERITIES[bar.findings or "no-failure"]]
    return f"wanted {bar_name(bar)}; found {len(bad)}. {' '.join(bad)}" if bad else ""


def _check_figure(bar: BarSection, group: Sequence[Entry]) -> str | None:
    """Why a bar on a figure is missed; empty if it is met; None where no file has the figure."""
    name = bar.figure or ""
    values = [(step, each, figure) for step, each in _step_results(bar, group)
              for figure in [figures(each).get(name)] if figure]
    if not values:
        return None
    step, result, figure = values[-1]
    if name in result.unidentified:
        return (f"wanted {bar_name(bar)}; found no value that is known in the file of {step}: no recording "
                "identifies it. See the reason in that file.")
    if figure.value is None:
        return f"wanted {bar_name(bar)}; found no value in the file of {step}. See the reason in that file."
    limit = bar.at_most if bar.at_least is None else bar.at_least
    bound = limit.value if isinstance(limit, MeasureSection) else float(limit or 0.0)
    if isinstance(limit, MeasureSection):
        try:
            bound *= units.conversion_factor(limit.unit, figure.unit or "", name)
        except BadParameters as error:
            return f"{error}"
    elif figure.unit not in DIMENSIONLESS_UNITS:
        return (f"wanted a unit with {bar_name(bar)}, a figure in {figure.unit}; found none. Write it as in "
                f"'{{value: {bound:g}, unit: {figure.unit}}}'.")
    met = figure.value <= bound if bar.at_least is None else figure.value >= bound
    unit = f" {figure.unit}" if figure.unit else ""
    return "" if met else (f"wanted {bar_name(bar)}; found {figure.value:.5g}{unit} in the file of {step}. Check "
                           "the machine, the recording or the limit.")


def figures(result: StepResult) -> Mapping[str, SizeSection]:
    """Every figure of a file by name."""
    found = {name: SizeSection(value, "%" if name.endswith("percent") else None)
             for name, value in (result.fit or {}).items()}
    return found | {row[0]: SizeSection(row[1], row[2]) for row in result.parameters}


def _no_file_sentence(bar: BarSection, entries: Sequence[Entry]) -> str:
    if bar.findings:
        return (f"wanted {bar_name(bar)}; found no file of {bar.step or 'any step'}. See the problems in the "
                "summary.")
    known = sorted({name for e in entries if e.result is not None for name in figures(e.result)})
    return (f"wanted {bar_name(bar)}; found no file with it (available: {', '.join(known) or 'none'}). "
            "Correct the limit, or add the step that gives the figure.")
