"""Tables of a gains file for a person; several configurations side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.console import Console

from drivetool.files.shapes import DesignSection, Figure, GainsFile
from drivetool.files.tables.number_format import short
from drivetool.files.tables.table import Column, Row, Table, lines, numbers


def print_gains(file: GainsFile, console: Console, per_unit: bool = False) -> None:
    """Settings and figures, then the published variations and the draws of the covariance.

    per_unit  figures of the ratings where the file has them
    """
    per_unit = per_unit and file.ratings is not None
    console.print(_design_table(file, per_unit), *(_robustness_table(file, design, per_unit)
                                                   for design in file.designs), lines([file.outcome]))


def _design_table(file: GainsFile, per_unit: bool) -> Table:
    """One column per design."""
    many = len(file.designs) > 1
    picked = [(label, [pick(design) for design in file.designs]) for label, pick in _design_rows(file)]
    rows = [Row((label, *(_cell_text(figure, per_unit) for figure in figures),
                 next(_shown_unit(figure, per_unit) for figure in figures if figure is not None)))
            for label, figures in picked if any(figure is not None for figure in figures)]
    columns = numbers(*(design.configuration if many else "value" for design in file.designs))
    return Table([Column(least=30), *columns, Column("unit", fold=False, rank=-1)], rows,
                 "controller settings and performance")


def _design_rows(file: GainsFile) -> list[tuple[str, Callable[[DesignSection], Figure | None]]]:
    """Label, and the function that picks its figure from a design."""
    def plain(value, unit: str) -> Figure:
        return Figure(value=value, unit=unit)

    speeds = [row for name, pick in (("load", lambda d: d.factors.load_speed),
                                     ("motor", lambda d: d.factors.motor_speed)) for row in (
        (f"{name} speed: impact drop", lambda d, pick=pick: pick(d).impact_drop),
        ("  overshoot", lambda d, pick=pick: plain(pick(d).overshoot_percent, "%")),
        ("  settling time", lambda d, pick=pick: pick(d).settling_time),
        ("  first peak", lambda d, pick=pick: pick(d).peak))]
    motors = [(f"{motor} torque overshoot", lambda d, motor=motor: plain(
        d.factors.torque_overshoot_percent.get(motor), "%"))
        for motor in dict.fromkeys(m for d in file.designs for m in d.motors)]
    return [
        ("Kp", lambda d: d.gains.kp), ("Ti", lambda d: d.gains.ti), ("Kp2", lambda d: d.gains.kp2),
        ("Ti2", lambda d: d.gains.ti2), ("K3", lambda d: d.gains.k3),
        (f"{file.criterion.name} (minimised)", lambda d: d.criterion_value), *speeds, *motors,
        ("Ms", lambda d: plain(d.margins.max_sensitivity, "")),
        ("gain margin", lambda d: plain(d.margins.gain_margin, "")),
        ("phase margin", lambda d: plain(d.margins.phase_margin_deg, "deg")),
        ("delay margin", lambda d: plain(d.margins.delay_margin_s, "s")),
        ("crossover", lambda d: plain(d.margins.crossover_hz, "Hz"))]


def _robustness_table(file: GainsFile, design: DesignSection, per_unit: bool) -> Table:
    """The same settings on other drives: the published variations, then quantiles over the draws."""
    name = f"{design.configuration}: " if len(file.designs) > 1 else ""
    drop = design.factors.load_speed.impact_drop
    unit, scale = _shown_unit(drop, per_unit), drop.per_unit / drop.value if per_unit and drop.per_unit else 1.0
    found = [(each.change, (each.max_sensitivity, each.impact_drop, each.overshoot_percent))
             for each in design.variations]
    if spread := design.spread:
        found += [(f"{100 * float(level):g} % quantile of {spread.draws - spread.unphysical} draws",
                   [spread.quantiles[key][level] for key in ("max_sensitivity", "impact_drop", "overshoot")])
                  for level in ("0.05", "0.5", "0.95")]
    return Table([Column("drive", least=30), *numbers("Ms", f"impact drop {unit}", "overshoot %")],
                 [Row((label, *_figure_texts(figures, scale))) for label, figures in found],
                 f"{name}robustness of the settings to changes of the drive")


def _figure_texts(found: Sequence[float | None], scale: float) -> list[str]:
    """Ms, impact drop in its unit, overshoot."""
    return ["unstable" if f is None else short(f * s) for f, s in zip(found, (1.0, scale, 1.0), strict=True)]


def _cell_text(figure: Figure | None, per_unit: bool) -> str:
    if figure is None:
        return "-"
    if per_unit and figure.per_unit is not None:
        return short(figure.per_unit)
    return "infinite" if figure.value is None else short(figure.value)


def _shown_unit(figure: Figure, per_unit: bool) -> str:
    return figure.per_unit_unit if per_unit and figure.per_unit is not None else figure.unit
