"""Tables of a gains file for a person; several configurations side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.files.shapes import DesignSection, Figure, GainsFile
from drivetool.files.tables.result_tables import short


def print_gains(file: GainsFile, console: Console, per_unit: bool = False) -> None:
    """Settings and figures, then the published variations and the draws of the covariance.

    per_unit  figures of the ratings where the file has them
    """
    per_unit = per_unit and file.ratings is not None
    console.print(design_table(file, per_unit))
    for design in file.designs:
        console.print(robustness_table(file, design, per_unit))
    console.print(Text(f"  {file.outcome}"))


def design_table(file: GainsFile, per_unit: bool) -> Table:
    """One column per design."""
    many = len(file.designs) > 1
    table = _titled_table("controller settings and performance")
    for design in file.designs:
        table.add_column(design.configuration if many else "value", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for label, pick in _design_rows(file):
        figures = [pick(design) for design in file.designs]
        if all(figure is None for figure in figures):
            continue
        cells = [_cell_text(figure, per_unit) for figure in figures]
        unit = next((_shown_unit(figure, per_unit) for figure in figures if figure is not None), "")
        table.add_row(label, *map(Text, cells), Text(unit))
    return table


def _design_rows(file: GainsFile) -> list[tuple[str, Callable[[DesignSection], Figure | None]]]:
    """Label, and the function that picks its figure from a design."""
    def plain(value, unit: str) -> Figure:
        return Figure(value=value, unit=unit)

    rows: list[tuple[str, Callable[[DesignSection], Figure | None]]] = [
        ("Kp", lambda d: d.gains.kp), ("Ti", lambda d: d.gains.ti), ("Kp2", lambda d: d.gains.kp2),
        ("Ti2", lambda d: d.gains.ti2), ("K3", lambda d: d.gains.k3),
        (f"{file.criterion.name} (minimised)", lambda d: d.criterion_value)]
    for name, pick in (("load", lambda d: d.factors.load_speed), ("motor", lambda d: d.factors.motor_speed)):
        rows += [
            (f"{name} speed: impact drop", lambda d, pick=pick: pick(d).impact_drop),
            ("  overshoot", lambda d, pick=pick: plain(pick(d).overshoot_percent, "%")),
            ("  settling time", lambda d, pick=pick: pick(d).settling_time),
            ("  first peak", lambda d, pick=pick: pick(d).peak)]
    motors = list(dict.fromkeys(m for d in file.designs for m in d.motors))
    for motor in motors:
        rows.append((f"{motor} torque overshoot", lambda d, motor=motor: plain(
            d.factors.torque_overshoot_percent.get(motor), "%")))
    rows += [
        ("Ms", lambda d: plain(d.margins.max_sensitivity, "")),
        ("gain margin", lambda d: plain(d.margins.gain_margin, "")),
        ("phase margin", lambda d: plain(d.margins.phase_margin_deg, "deg")),
        ("delay margin", lambda d: plain(d.margins.delay_margin_s, "s")),
        ("crossover", lambda d: plain(d.margins.crossover_hz, "Hz"))]
    return rows


def robustness_table(file: GainsFile, design: DesignSection, per_unit: bool = False) -> Table:
    """The same settings on other drives: the published variations, then quantiles over the draws."""
    name = f"{design.configuration}: " if len(file.designs) > 1 else ""
    table = _titled_table(f"{name}robustness of the settings to changes of the drive")
    table.columns[0].header = "drive"
    drop = design.factors.load_speed.impact_drop
    unit, scale = _shown_unit(drop, per_unit), drop.per_unit / drop.value if per_unit and drop.per_unit else 1.0
    for title in ("Ms", f"impact drop {unit}", "overshoot %"):
        table.add_column(title, justify="right", no_wrap=True)
    for each in design.variations:
        found = (each.max_sensitivity, each.impact_drop, each.overshoot_percent)
        table.add_row(each.change, *_figure_texts(found, scale))
    spread = design.spread
    if spread:
        for level in ("0.05", "0.5", "0.95"):
            found = [spread.quantiles[key][level] for key in ("max_sensitivity", "impact_drop", "overshoot")]
            table.add_row(f"{100 * float(level):g} % quantile of {spread.draws - spread.unphysical} draws",
                          *_figure_texts(found, scale))
    return table


def _figure_texts(found: Sequence[float | None], scale: float) -> list[str]:
    """Ms, impact drop in its unit, overshoot."""
    return ["unstable" if f is None else short(f * s) for f, s in zip(found, (1.0, scale, 1.0), strict=True)]


def _titled_table(title: str) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False, title=Text(title),
                  title_justify="left")
    table.add_column("", no_wrap=True)
    return table


def _cell_text(figure: Figure | None, per_unit: bool) -> str:
    if figure is None:
        return "-"
    if per_unit and figure.per_unit is not None:
        return short(figure.per_unit)
    return "infinite" if figure.value is None else short(figure.value)


def _shown_unit(figure: Figure, per_unit: bool) -> str:
    return figure.per_unit_unit if per_unit and figure.per_unit is not None else figure.unit
