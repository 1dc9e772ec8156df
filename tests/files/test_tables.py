"""Tables of 80 columns: nothing is cut, no word is broken, and what does not fit goes to a block below."""

from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from drivetool.errors import BadParameters
from drivetool.files.results.result_file import estimate_file, validation_file
from drivetool.files.shapes import ChannelSection, InspectionFile, parameter_shapes as shapes
from drivetool.files.tables import print_both, result_tables
from drivetool.files.tables.inspection_table import print_inspection
from drivetool.files.tables.table import Column, Row, Table, numbers, short_labels
from tests.files.test_write import CHECK, ESTIMATE, VALIDATION, show

NUMBERS = [f"{i}.{i}{i}{i}e-05" for i in range(10)]


def printed(table, width=80):
    """The lines that a console of this width shows."""
    out = StringIO()
    Console(file=out, width=width, highlight=False).print(table)
    lines = [line.rstrip() for line in out.getvalue().splitlines()]
    assert all(len(line) <= width for line in lines) and "…" not in out.getvalue()
    return lines


def test_heads_fold_between_words_before_any_cell():
    columns = [Column("model"), *numbers("simulation fit %", "lags outside %"), Column("what is meant")]
    table = Table(columns, [Row(("greybox_two_mass", "99.1", "3", "several words"))], "title of the table")
    title, head, rule, row = printed(table)
    assert title == "title of the table"
    assert " ".join(head.split()) == "model simulation fit % lags outside % what is meant"
    assert rule == "─" * len(head) and row.split() == ["greybox_two_mass", "99.1", "3", "several", "words"]
    _, *heads, rule, row = printed(table, 49)
    assert [line.split() for line in heads] == [
        ["lags"], ["simulation", "outside"], ["model", "fit", "%", "%", "what", "is", "meant"]]
    assert row.split() == ["greybox_two_mass", "99.1", "3", "several", "words"]
    assert [line.split() for line in printed(table, 44)[-2:]] == [
        ["greybox_two_", "99.1", "3", "several"], ["mass", "words"]]


@pytest.mark.parametrize("name, lines", [
    ("/press_line/axis_3/joint_states.effort", ["/press_line/", "axis_3/", "joint_", "states.", "effort"]),
    ("2024-03-01_run17", ["2024-03-01_", "run17"]), ("unbreakable", ["unbreakable"]),
    ("two words of it", ["two words of", "it"])])
def test_names_fold_behind_separators_alone(name, lines):
    shown = printed(Table([Column("name"), *numbers("a")], [Row((name, "1" * 20))]), 33)[2:]
    assert [line[:12].rstrip() for line in shown] == lines


def test_a_word_that_is_longer_than_its_column_may_be_is_not_broken():
    lines = printed(Table([Column("name"), *numbers("a")], [Row(("x" * 40, "1"))]), 45)
    assert lines[-1].split() == ["x" * 40, "1"]


def test_columns_that_do_not_fit_stand_below_with_the_names_of_the_rows():
    columns = [Column("channel"), *numbers("a", "b", rank=1), *numbers("c", "d"), Column("unit", fold=False)]
    rows = [Row((name, *NUMBERS[:4], "Nm s/rad")) for name in ("one", "two")]
    assert [line.split() for line in printed(Table(columns, rows), 48) if not line.startswith("─")] == [
        ["channel", "a", "c", "d", "unit"], *[[name, *(NUMBERS[i] for i in (0, 2, 3)), "Nm", "s/rad"]
                                               for name in ("one", "two")],
        ["channel", "b"], ["one", NUMBERS[1]], ["two", NUMBERS[1]]]


def test_a_block_below_leaves_out_rows_of_dashes():
    columns = [Column("name"), *numbers("a", "b")]
    lines = printed(Table(columns, [Row(("one", "1" * 9, "-")), Row(("two", "-", "2" * 9))]), 15)
    assert [line.split()[0] for line in lines if not line.startswith("─")] == ["name", "one", "two", "name", "two"]


def test_names_get_a_line_of_their_own_where_no_column_fits_beside_them():
    lines = printed(Table([Column("name"), *numbers("mean", "std")], [Row(("x" * 35, "1" * 9, "2"))]), 40)
    assert lines == ["name:", "x" * 35, "mean: 111111111", "std: 2"]


def test_control_characters_of_names_are_escaped():
    lines = printed(Table([Column("a\x1b[2J"), Column("b")], [Row(("one\ntwo", "\x07\tthree"))], "of\x9b x"))
    assert lines == [r"of\u009b x", r"a\u001b[2J b", "─" * 24, r"one\ntwo   \u0007\tthree"]


def test_a_table_labels_files_by_unique_names():
    assert short_labels(["day/a.parquet", "b.mcap", "day/a.parquet"]) == {"day/a.parquet": "a", "b.mcap": "b"}
    assert short_labels(["x/a.parquet", "y/a.parquet", "c.yaml"]) == {
        "x/a.parquet": "x/a.parquet", "y/a.parquet": "y/a.parquet", "c.yaml": "c"}


def test_validation_of_long_names_says_met_in_full():
    checks = [CHECK.replace(model=f"{model}.yaml", file="press_2_run_17.parquet", simulation_fit_percent=fit)
              for model, fit in (("backlash", -1234.5), ("greybox2", 99.99))]
    text = show(result_tables.print_validation, validation_file(replace(VALIDATION, checks=tuple(checks))))
    assert max(map(len, text.splitlines())) <= 80
    rows = [line.split() for line in text.splitlines()]
    assert all([model, "press_2_run_17", fit, "-", "0.0123", "0.083", "4", "met"] in rows
               for model, fit in (("backlash", "-1234"), ("greybox2", "99.99")))
    assert {"simulation", "correlation", "outside"} <= {word for row in rows for word in row}


def channel(name, **other):
    """A channel of an inspection with wide numbers."""
    return ChannelSection(**{
        "name": name, "unit": "m/s^2", "role": "load_acceleration", "samples": 12345678, "missing": 1234,
        "start": 0.0, "duration": 9.0, "rate": 1234.5, "jitter": 0.0, "range": (-1.23e-5, 4.56e-5), "gaps": 1234,
        "longest_gap": 1.0, "lost": 123, "quantum": 1.25e-7, "spikes": 12345, "held": 1, "clock": "", **other})


def test_an_inspection_of_topics_with_long_names_is_whole():
    names = ["/press_line/axis_3/joint_states.effort_commanded[0]", "/press_line/axis_3/joint_states.velocity",
             "motor_current_of_the_second_drive"]
    text = show(print_inspection, InspectionFile(
        schema="drivetool/inspection/1", origin=0.0, channels=[channel(name) for name in names],
        unreadable={"no\x1bte": "string"}, experiment=None, findings=[], data=[]))
    assert max(map(len, text.splitlines())) <= 80 and "…" not in text and r"no\u001bte: not read" in text
    words = text.split()
    for whole in ("/press_line/", "axis_3/joint_", "states", "commanded[0]", "velocity", "12345678", "12345",
                  "1357", "-1.23e-5..4.56e-5", "m/s^2", "spikes", "samples"):
        assert whole in words, whole


def test_the_interval_stands_beside_the_value_or_below():
    file = estimate_file(ESTIMATE)
    narrow, wide = (show(result_tables.print_estimate, file, width) for width in (80, 160))
    assert "0.5850 .. 0.5895" in narrow and narrow.count("motor.inertia ") == 2
    assert "motor.inertia 0.5871 kg m^2 0.0012 0.20 0.5850 .. 0.5895 0.6 fitted" in (
        " ".join(line.split()) for line in wide.splitlines())
    below = narrow[narrow.index("ci95"):narrow.index("shaft.damping: ")]
    assert "shaft.damping" not in below and "3070 .. 3550" in below


def test_large_correlations_are_stated_by_name():
    names = tuple(f"p{i}" for i in range(6))
    matrix = np.full((6, 6), 0.95) + 0.05 * np.eye(6)
    matrix[0, 1] = matrix[1, 0] = -0.99
    matrix[5, :5] = matrix[:5, 5] = 0.1
    covariance = shapes.CovarianceSection(names=[*names, "none"], matrix=[
        *([*row, 0.0] for row in matrix.tolist()), [0.0] * 7])
    lines = result_tables._correlation_lines(covariance)
    assert lines[0] == "correlations above 0.9 in size:" and lines[1] == "  p0 and p1: -0.99" and len(lines) == 11
    assert not any("none" in line or "p5" in line for line in lines)
    covariance = shapes.CovarianceSection(names=list(names), matrix=[[0.95 + 0.05 * (i == j) for j in range(6)]
                                                                     for i in range(6)])
    assert result_tables._correlation_lines(covariance)[-1] == "  and 5 others"
    assert result_tables._correlation_lines(None) == []
    assert "correlations" not in show(result_tables.print_estimate, estimate_file(ESTIMATE))


def test_two_files_stand_side_by_side():
    first = estimate_file(ESTIMATE)
    entries = dict(first.parameters)
    entries["motor.inertia"] = shapes.ParameterSection(value=588.1, unit="g m^2", std=0.9)
    entries["motor.viscous"] = shapes.ParameterSection(value=0.1, unit="Nm s/rad")
    entries["shaft.stiffness"] = shapes.ParameterSection(value=3310.0)
    del entries["load.inertia"]
    second = first.replace(parameters=entries, data=[
        shapes.FileSection(file="b.parquet", sha256="cd" * 32)])

    def rows(*files):
        text = show(lambda pair, console: print_both(
            pair, ("a/greybox.yaml", "backlash.yaml"), ("12" * 32, "34" * 32), console), files)
        assert max(map(len, text.splitlines())) <= 80
        return {line.split()[0]: line.split()[1:] for line in text.splitlines() if line.strip()}, text

    found, text = rows(first, second)
    assert found["motor.inertia"] == ["0.5871", "0.0012", "0.58810", "0.00090", "kg", "m^2", "0.65"]
    assert found["load.inertia"] == ["5.179", "0.023", "-", "-", "kg", "m^2", "-"]
    assert found["shaft.stiffness"] == ["3310", "120", "3310", "-", "Nm/rad", "-"]
    assert found["motor.viscous"] == ["-", "-", "0.1", "-", "Nm", "s/rad", "-"]
    assert "greybox" in text and "backlash" in text and "share" not in text
    found, text = rows(first, first)
    assert found["motor.inertia"][-1] == "-" and "the files share a recording" in text
    chained = second.replace(inputs=[shapes.FileSection(file="a", sha256="12" * 32)])
    found, text = rows(first, chained)
    assert found["motor.inertia"][-1] == "-" and "or a parameter file" in text
    entries["motor.inertia"] = shapes.ParameterSection(value=1.0, unit="Nm")
    with pytest.raises(BadParameters, match=r"motor\.inertia in kg m"):
        rows(first, second.replace(parameters=entries))
