"""A diagnosis as a table for the terminal, at 80 columns."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from drivetool.check.outcome import CandidateSection, DiagnosisSection, GainSection, RoundSection
from drivetool.check.verdict import RULES
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.tables.number_format import short
from drivetool.files.tables.report_words import STATES, VERDICTS, detection_limits, with_std
from drivetool.files.tables.table import Column, Row, Table, lines, numbers

_VERDICT_STYLES = {"nothing-found": "green", "named": "bold green", "undetermined": "bold yellow",
            "unexplained": "bold yellow"}
_STATE_STYLES = {"named": "bold", "possible": "yellow", "no-gain": "dim", "not-shown": "dim", "in-the-model": "dim",
           "failed": "red"}


def print_diagnosis(section: DiagnosisSection, console: Console) -> None:
    """Verdict, candidates round by round, gain, and the experiment that would decide."""
    console.print(Text.assemble((f"{VERDICTS[section.verdict]}: ", _VERDICT_STYLES[section.verdict]),
                                section.sentence))
    console.print(Text(f"{section.experiment}\n".lstrip()))
    for one in section.rounds or [RoundSection(round=1)]:
        if candidates := [c for c in section.candidates if c.round == one.round]:
            decided = f"added {one.cause}" if one.cause else "nothing more"
            console.print(_candidate_table(candidates, f"round {one.round}: {decided}"))
            console.print(lines((f"{each.code}: {each.reason}" for each in candidates if each.reason), "dim"), "")
    console.print(lines(_gain_lines(section.gain) if section.gain else ()))


def print_rule(file: shapes.ParameterFile) -> None:
    """On standard error: the facts, and the first rule that they fulfil."""
    section, console = file.diagnosis, Console(stderr=True, highlight=False)
    assert section is not None
    rows = [Row((name, (", ".join(value) if isinstance(value, list) else short(value) if isinstance(value, float)
                        else "" if value is None else str(value)) or "-")) for name, value in section.facts.items()]
    rule = next(r for r in RULES if r.name == section.rule)
    console.print(Table((Column("fact", fold=False), Column("value")), rows, "facts"), lines(
        f"{word}: {text}" for word, text in (("rule", rule.name), ("when", rule.when), ("why", rule.reason),
                                             ("source", rule.source))))


def _candidate_table(candidates: Sequence[CandidateSection], title: str) -> Table:
    """Best first; those without a gain last."""
    columns = [Column("cause", least=20), *numbers("held-out gain", "log10 evidence"), Column("verdict"),
               Column("min detectable", rank=1)]
    ordered = sorted(candidates, key=lambda c: (c.gain is None, -(c.gain or 0.0)))
    return Table(columns, [Row((
        each.code, with_std(each.gain, each.gain_std), "-" if each.evidence is None else f"{each.evidence:.1f}",
        STATES[each.state], detection_limits(each, names=False) or "-"), _STATE_STYLES.get(each.state, ""))
        for each in ordered], title)


def _gain_lines(gain: GainSection) -> list[str]:
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
