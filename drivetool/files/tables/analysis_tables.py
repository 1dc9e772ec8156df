"""Tables for a person: what is in a spectra or comparison file, at 80 columns."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.files.shapes import ComparisonFile, SpectraFile
from drivetool.files.tables.result_tables import rounded, short, short_labels
from drivetool.identify.several import SwapLineSection, SwapSection


def print_analysis(file: SpectraFile | ComparisonFile, console: Console) -> None:
    """The tables of a file; colours only on a terminal."""
    if isinstance(file, SpectraFile):
        _print_spectra(file, console)
    elif isinstance(file.swap, SwapSection):
        _print_swap_comparison(file.swap, console)
        if not file.findings:  # which have the same sentence
            console.print(Text(f"  {file.outcome}"))
    else:
        _print_comparison(file, console)


def _plain_table(*columns: str, title: str = "") -> Table:
    """The first column to the left, numbers to the right."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False, title_justify="left",
                  title=Text(title) if title else None)
    for i, name in enumerate(columns):
        table.add_column(name, justify="right" if i else "left", overflow="fold")
    return table


def _print_spectra(file: SpectraFile, console: Console) -> None:
    table = _plain_table("peak", "Hz", "+- bin width/2", f"magnitude {file.unit}", "prominence dB",
                   title=f"{file.output} over {file.input}")
    for p in file.peaks:
        table.add_row(p.kind, short(p.hz, 5), short(p.resolution_hz / 2, 3), short(p.magnitude),
                      short(p.prominence_db, 3))
    console.print(table)
    for d in file.distortion:
        level = ("not above the noise" if d.below_signal_db is None
                 else f"{d.below_signal_db:.0f} dB below the signal")
        console.print(Text(f"  {d.kind} distortion: {level} ({d.lines} lines)"))
    c = file.coherence
    console.print(Text(f"  coherence: median {short(c['median'], 3)}, minimum {short(c['least'], 3)}"))
    for name, value in file.uncertainty.items():
        if value is not None:
            console.print(Text(f"  std over magnitude, {name.replace('_', ' ')}: {100 * value:.2g} % (median)"))
    console.print(Text(f"  {file.outcome}"))


def _print_comparison(file: ComparisonFile, console: Console) -> None:
    short_names = short_labels(name for c in file.cross for name in (c.fitted_on, c.checked_on))
    for structure in dict.fromkeys(c.structure for c in file.cross):
        columns = list(dict.fromkeys(c.checked_on for c in file.cross if c.structure == structure))
        table = _plain_table("fitted on", *(short_names[name] for name in columns),
                       title=f"{structure}: simulation fit %, checked on")
        fits = {(c.fitted_on, c.checked_on): c for c in file.cross if c.structure == structure}
        for row in dict.fromkeys(a for a, _ in fits):
            cells = [fits.get((row, name)) for name in columns]
            table.add_row(short_names[row], *("unstable" if c and c.simulation_fit_percent is None else
                                         short(c.simulation_fit_percent, 3) if c else "-" for c in cells))
        console.print(table)
    if file.spread:
        table = _plain_table("figure", "structure", "mean", "std", "unit", title="mean and std over recordings")
        for s in file.spread:
            mean, std = rounded(s.mean, s.std)
            table.add_row(s.name, s.structure, mean, std, s.unit)
        console.print(table)
    if any(d.differs for d in file.differences):
        table = _plain_table("differs", "structure", "from", "to", "change", "+-", "unit", "p",
                       title=f"differences {_compared_with(file)}")
        for d in (d for d in file.differences if d.differs):
            change, std = rounded(d.change, d.std)
            table.add_row(d.name, d.structure, short_names.get(d.first, d.first),
                          short_names.get(d.second, d.second),
                          change, std, d.unit, short(d.p, 2))
        console.print(table)
    elif file.differences:
        console.print(Text(f"  no differences {_compared_with(file)}", style="dim"))
    if file.differences and not file.options.get("machines"):
        console.print(Text(
            "  One record per machine does not separate differences between machines from differences between "
            "days, see --machine.", style="dim"))
    console.print(Text(f"  {file.outcome}"))


def _compared_with(file: ComparisonFile) -> str:
    """The compared records or machines, and the scatter that a difference must exceed."""
    if file.options.get("machines"):
        return "between machines beyond the scatter of their recordings"
    return "between records beyond their noise"


def _print_swap_comparison(found: SwapSection, console: Console) -> None:
    """Two rows per figure; the second one has the name of the second file, where that is another."""
    lines = [*found.lines, *found.derived]
    compared = [line for line in lines if line.difference is not None]
    table = _plain_table("parameter", "value", "+- (std)", "unit", "difference", "+- (std)", "diff/std",
                   title=f"first row {found.first}, second row {found.second} (own names)")
    for line in compared:
        style = "dim" if line.ratio is None else "yellow" if line.differs else ""
        for row in _swap_rows(line):
            table.add_row(*map(Text, row), style=style)
    if compared:
        console.print(table)
    for reason in dict.fromkeys(line.reason for line in lines if line.reason):
        names = ", ".join(line.first or line.second for line in lines if line.reason == reason)
        console.print(Text(f"  {names}: {reason}", style="dim"))


def _swap_rows(line: SwapLineSection) -> list[tuple[str, ...]]:
    """First value; second value with the difference."""
    (one, one_std), (two, two_std) = map(rounded, line.values, line.stds)
    change, std = rounded(line.difference, line.std)
    other = f"  {line.second}" if line.second != line.first else ""
    return [(line.first, one, one_std, line.unit, "", "", ""),
            (other, two, two_std, "", change, std, short(line.ratio, 2))]
