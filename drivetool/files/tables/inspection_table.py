"""An inspection as a table for the terminal: what each channel is, and what a step receives."""

from __future__ import annotations

from rich.console import Console

from drivetool.files.shapes import InspectionFile, PartSection
from drivetool.files.tables.number_format import narrow
from drivetool.files.tables.table import Column, Row, Table, lines, numbers


def print_inspection(file: InspectionFile, console: Console) -> None:
    """One row per channel below its topic, then what a step would get."""
    columns = [Column("channel", least=14), Column("role"), Column("unit", fold=False),
               *numbers("Hz", "samples", "range"), *numbers("step", "gaps", "spikes", "lost", rank=1)]
    rows, topic = [], ""
    for each in file.channels:
        own, dot, field = each.name.partition(".") if each.name.startswith("/") else ("", "", each.name)
        rows += [Row((own, *[""] * 9))] if dot and own != topic else []
        topic = own
        cells = (f"  {field}" if dot else field, each.role or "-", each.unit or "?", narrow(each.rate),
                 str(each.samples), f"{narrow(each.range[0], 3)}..{narrow(each.range[1], 3)}",
                 narrow(each.quantum or None, 2), str(each.gaps), str(each.spikes), str(each.missing + each.lost))
        rows.append(Row(cells, "" if each.role else "dim"))
    console.print(Table(columns, rows))
    console.print(lines((f"{name}: not read, {why}" for name, why in file.unreadable.items()), "yellow"))
    if e := file.experiment:
        more = "".join(f"; {role} in {unit}" for role, unit in (e.input_units or {}).items())
        parts: list[PartSection] = [e, *e.others]
        counts = " and ".join(f"{p.samples} samples of {p.step:.6g} s in {p.segments} "
                              f"segment{'s' if p.segments > 1 else ''}" for p in parts)
        console.print(lines([f"a step receives {', '.join(e.roles)}: {counts}, torque in {e.torque_unit} "
                             f"({e.torque_is}{more}), motion in {e.motion_unit}"]))
    else:
        console.print(lines(["no step can use this recording; see the findings"], "yellow"))
