"""A diagnosis as a table for the terminal, at 80 columns."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.check.verdict import RULES
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.tables.report_words import STATES, VERDICTS, detection_limits, gain_text
from drivetool.files.tables.result_tables import short

_VERDICT_STYLES = {"nothing-found": "green", "named": "bold green", "undetermined": "bold yellow",
            "unexplained": "bold yellow"}
_STATE_STYLES = {"named": "bold", "possible": "yellow", "no-gain": "dim", "not-shown": "dim", "in-the-model": "dim",
           "failed": "red"}


def print_diagnosis(section: shapes.DiagnosisSection, console: Console) -> None:
    """Verdict, candidates round by round, gain, and the experiment that would decide."""
    console.print(Text.assemble((f"{VERDICTS[section.verdict]}: ", _VERDICT_STYLES[section.verdict]),
                                section.sentence))
    if section.experiment:
        console.print(Text(section.experiment))
    console.print()
    for one in section.rounds or [shapes.RoundSection(round=1)]:
        candidates = [c for c in section.candidates if c.round == one.round]
        if candidates:
            decided = f"added {one.cause}" if one.cause else "nothing more"
            console.print(candidate_table(candidates, f"round {one.round}: {decided}"))
            _print_reasons(candidates, console)
    if section.gain is not None:
        for line in gain_lines(section.gain):
            console.print(Text(f"  {line}"))


def print_rule(file: shapes.ParameterFile) -> None:
    """On standard error: the facts, and the first rule that they fulfil."""
    section, console = file.diagnosis, Console(stderr=True, highlight=False)
    assert section is not None
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False, title=Text("facts"),
                  title_justify="left")
    table.add_column("fact", no_wrap=True)
    table.add_column("value", overflow="fold")
    for name, value in section.facts.items():
        text_of_value = ", ".join(value) if isinstance(value, list) else (
            short(value) if isinstance(value, float) else value)
        table.add_row(name, Text("-" if text_of_value in (None, "") else str(text_of_value)))
    console.print(table)
    rule = next(r for r in RULES if r.name == section.rule)
    for word, text in (("rule", rule.name), ("when", rule.when), ("why", rule.reason), ("source", rule.source)):
        console.print(Text(f"  {word}: {text}"))


def candidate_table(candidates: Sequence[shapes.CandidateSection], title: str) -> Table:
    """Best first; those without a gain last."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False, title=Text(title),
                  title_justify="left")
    table.add_column("cause", overflow="fold", min_width=20)
    for name in ("held-out gain", "log10 E"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("verdict", overflow="fold", min_width=20)
    table.add_column("min detectable", overflow="fold")
    ordered = sorted(candidates, key=lambda c: (c.gain is None, -(c.gain or 0.0)))
    for each in ordered:
        evidence = "-" if each.evidence is None else f"{each.evidence:.1f}"
        cells = (each.code, gain_text(each), evidence, STATES[each.state],
                 detection_limits(each, names=False) or "-")
        table.add_row(*map(Text, cells), style=_STATE_STYLES.get(each.state, ""))
    return table


def gain_lines(gain: shapes.GainSection) -> list[str]:
    """Before and after, on held-out data."""
    free = f"free runs of {short(gain.segment)} s over data held out" if gain.of == "motion" else (
        "torque that the motion requires, over data held out")
    fresh = "" if gain.rmse_gain_ci95 is None else (
        " (reduction on a further record: {} to {}, 95 %)".format(*(short(end, 3) for end in gain.rmse_gain_ci95)))
    lines = [
        f"{free}: rmse {short(gain.held_out_rmse_before)} -> {short(gain.held_out_rmse_after)} {gain.unit}{fresh}",
        f"fit {short(gain.held_out_fit_before)} -> {short(gain.held_out_fit_after)} %" + (
            "" if gain.noise_floor is None else f"; noise of the sensor {short(gain.noise_floor)} {gain.unit}")]
    if gain.unexplained_percent is not None:
        lines.append(f"remaining: {short(gain.unexplained_percent, 3)} % of the base model's unexplained log "
                     "likelihood")
    return lines


def _print_reasons(candidates: Sequence[shapes.CandidateSection], console: Console) -> None:
    """The reasons of candidates without a gain."""
    for each in candidates:
        if each.reason:
            console.print(Text(f"  {each.code}: {each.reason}", style="dim"))
    console.print()
