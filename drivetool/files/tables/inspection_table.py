"""An inspection as a table for the terminal: what each channel is, and what a step receives."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.files.shapes import ExperimentSection, InspectionFile, PartSection


def print_inspection(file: InspectionFile, console: Console) -> None:
    """One row per channel below its topic, then what a step would get."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False)
    table.add_column("channel", overflow="fold", min_width=12)
    table.add_column("role", overflow="fold", max_width=12)  # of motor_torque
    table.add_column("unit", overflow="fold")
    for title in ("Hz", "samples", "range", "step", "gaps", "spikes", "lost"):
        table.add_column(title, justify="right", no_wrap=True)
    topic = ""
    for each in file.channels:
        own, dot, field = each.name.partition(".") if each.name.startswith("/") else ("", "", each.name)
        if dot and own != topic:
            table.add_row(Text(own))
        topic = own
        cells = (f"  {field}" if dot else field, each.role or "-", each.unit or "?", _narrow(each.rate),
                 str(each.samples), f"{_narrow(each.range[0], 3)}..{_narrow(each.range[1], 3)}",
                 _narrow(each.quantum or None, 2), str(each.gaps), str(each.spikes), str(each.missing + each.lost))
        table.add_row(*map(Text, cells), style="" if each.role else "dim")
    console.print(table)
    for name, why in file.unreadable.items():
        console.print(Text(f"  {name}: not read, {why}", style="yellow"))
    if file.experiment:
        e = file.experiment
        more = "".join(f"; {role} in {unit}" for role, unit in (e.input_units or {}).items())
        parts: list[ExperimentSection | PartSection] = [e, *e.others]
        counts = " and ".join(f"{p.samples} samples of {p.step:.6g} s in {p.segments} "
                              f"segment{'s' if p.segments > 1 else ''}" for p in parts)
        console.print(Text(f"  a step receives {', '.join(e.roles)}: {counts}, torque in {e.torque_unit} "
                           f"({e.torque_is}{more}), motion in {e.motion_unit}"))
    else:
        console.print(Text("  no step can use this recording; see the findings", style="yellow"))


def _narrow(value: float | None, digits: int = 4) -> str:
    """A number in a few digits, its exponent without what only costs width."""
    text = "-" if value is None else f"{value:.{digits}g}"
    return text.replace("e+0", "e").replace("e+", "e").replace("e-0", "e-")
