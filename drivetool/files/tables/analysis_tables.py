"""Tables for a person: what is in a spectra or comparison file, at 80 columns."""

from __future__ import annotations

from rich.console import Console

from drivetool.files.shapes import ComparisonFile, SpectraFile
from drivetool.files.tables.number_format import rounded, short
from drivetool.files.tables.table import Column, Row, Table, lines, numbers, short_labels
from drivetool.identify.several import SwapLineSection, SwapSection


def print_spectra(file: SpectraFile, console: Console) -> None:
    """The peaks, then distortion, coherence and uncertainty."""
    rows = [Row((p.kind, short(p.hz, 5), short(p.resolution_hz / 2, 3), short(p.magnitude),
                 short(p.prominence_db, 3))) for p in file.peaks]
    heads = ("Hz", "+- bin width/2", f"magnitude {file.unit}", "prominence dB")
    console.print(Table([Column("peak"), *numbers(*heads)], rows, f"{file.output} over {file.input}"))
    levels = [(d, "not above the noise" if d.below_signal_db is None
               else f"{d.below_signal_db:.0f} dB below the signal") for d in file.distortion]
    c = file.coherence
    console.print(lines([
        *(f"{d.kind} distortion: {level} ({d.lines} lines)" for d, level in levels),
        f"coherence: median {short(c['median'], 3)}, minimum {short(c['least'], 3)}",
        *(f"std over magnitude, {name.replace('_', ' ')}: {100 * value:.2g} % (median)"
          for name, value in file.uncertainty.items() if value is not None), file.outcome]))


def print_comparison(file: ComparisonFile, console: Console) -> None:
    """Of structures on recordings, or of two sides of one drive."""
    if isinstance(file.swap, SwapSection):
        _print_swap_comparison(file.swap, console)
        console.print(lines([] if file.findings else [file.outcome]))  # findings have the same sentence
        return
    short_names = short_labels(name for c in file.cross for name in (c.fitted_on, c.checked_on))
    for structure in dict.fromkeys(c.structure for c in file.cross):
        names = list(dict.fromkeys(c.checked_on for c in file.cross if c.structure == structure))
        fits = {(c.fitted_on, c.checked_on): "unstable" if c.simulation_fit_percent is None
                else short(c.simulation_fit_percent, 3) for c in file.cross if c.structure == structure}
        rows = [Row((short_names[row], *(fits.get((row, name), "-") for name in names)))
                for row in dict.fromkeys(a for a, _ in fits)]
        console.print(Table([Column("fitted on"), *numbers(*(short_names[name] for name in names))], rows,
                            f"{structure}: simulation fit %, checked on"))
    if file.spread:
        console.print(Table(
            [Column("figure", least=24), Column("structure"), *numbers("mean", "std"), Column("unit", fold=False)],
            [Row((s.name, s.structure, *rounded(s.mean, s.std), s.unit)) for s in file.spread],
            "mean and std over recordings", 2))
    compared = "between machines beyond the scatter of their recordings" if file.options.get("machines") else (
        "between records beyond their noise")
    if differing := [d for d in file.differences if d.differs]:
        console.print(Table(
            [Column("differs"), Column("structure"), Column("from"), Column("to"), *numbers("change", "+-"),
             Column("unit", fold=False), *numbers("p")],
            [Row((d.name, d.structure, short_names.get(d.first, d.first), short_names.get(d.second, d.second),
                  *rounded(d.change, d.std), d.unit, short(d.p, 2))) for d in differing],
            f"differences {compared}", 4))
    elif file.differences:
        console.print(lines([f"no differences {compared}"], "dim"))
    if file.differences and not file.options.get("machines"):
        console.print(lines(["One record per machine does not separate differences between machines from "
                             "differences between days, see --machine."], "dim"))
    console.print(lines([file.outcome]))


def _print_swap_comparison(found: SwapSection, console: Console) -> None:
    """Two rows per figure; the second one has the name of the second file, where that is another."""
    figures = [*found.lines, *found.derived]
    rows = [row for line in figures if line.difference is not None for row in _swap_rows(line)]
    columns = [Column("parameter", least=24), *numbers("value", "+- (std)"), Column("unit", fold=False),
               *numbers("difference", "+- (std)", "diff/std")]
    if rows:
        console.print(Table(columns, rows, f"first row {found.first}, second row {found.second} (own names)"))
    for reason in dict.fromkeys(line.reason for line in figures if line.reason):
        names = ", ".join(line.first or line.second for line in figures if line.reason == reason)
        console.print(lines([f"{names}: {reason}"], "dim"))


def _swap_rows(line: SwapLineSection) -> list[Row]:
    """First value; second value with the difference."""
    (one, one_std), (two, two_std) = map(rounded, line.values, line.stds)
    style = "dim" if line.ratio is None else "yellow" if line.differs else ""
    other = f"  {line.second}" if line.second != line.first else ""
    return [Row((line.first, one, one_std, line.unit, "", "", ""), style),
            Row((other, two, two_std, "", *rounded(line.difference, line.std), short(line.ratio, 2)), style)]
