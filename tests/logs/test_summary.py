"""The summary of a site: what is read, and one sentence about what is none."""

import math
from dataclasses import replace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from drivetool.errors import BadRecording
from drivetool.logs.formats.summary import SUMMARY_COLUMNS, Row, read_summary
from tests.summaries import table_of, write_summary

ROWS = [Row("a/1.mcap", "a", 1772323200.25, 0, "steady", "motor.viscous", 0.4, "Nm s/rad", 0.01, "fitted", "x"),
        Row("a/1.mcap", "a", 1772323200.25, 0, "steady", "motor.coulomb", math.inf, "Nm", None, "held"),
        Row("b/1.mcap", "b", None, 0, "steady", None, None, "", None, "")]


def test_rows_come_back_as_they_were(tmp_path):
    assert read_summary(write_summary(tmp_path / "s.parquet", ROWS)) == ROWS


def test_other_types_of_the_same_meaning_are_read(tmp_path):
    table = table_of(ROWS)
    table = table.set_column(3, "order", table["order"].cast(pa.int64())).set_column(
        2, "start", table["start"].cast(pa.timestamp("us"))).set_column(
        1, "machine", table["machine"].dictionary_encode())
    pq.write_table(table.append_column("seconds", pa.array([1.0, 2.0, 3.0])), tmp_path / "s.parquet")
    assert read_summary(tmp_path / "s.parquet") == ROWS


@pytest.mark.parametrize("column", SUMMARY_COLUMNS)
def test_a_missing_column_is_named(tmp_path, column):
    pq.write_table(table_of(ROWS).drop_columns([column]), tmp_path / "s.parquet")
    with pytest.raises(BadRecording, match=rf"no {column} \(available: "):
        read_summary(tmp_path / "s.parquet")


@pytest.mark.parametrize("make, said", [
    (lambda p: p.write_bytes(b"recording,machine\n"), "wanted the summary of a site in Parquet"),
    (lambda p: None, "no file s.parquet"),
    (lambda p: p.mkdir(), "the folder s.parquet"),
    (lambda p: pq.write_table(table_of([]), p), "wanted rows in s.parquet; found none"),
    (lambda p: pq.write_table(pa.table({"time": [1.0]}), p), "no recording, no machine"),
    (lambda p: pq.write_table(table_of(ROWS).append_column("value", pa.array([1.0] * 3)), p), "2 value"),
    (lambda p: pq.write_table(table_of(ROWS).drop_columns(["value"]).append_column(
        "value", pa.array(["high"] * 3)), p), "a column value of type double"),
    (lambda p: write_summary(p, [replace(ROWS[0], machine=None)]), "a machine in every row"),
    (lambda p: write_summary(p, [replace(ROWS[0], start=1e12)]), "between the years 1 and 9999"),
    (lambda p: write_summary(p, [*ROWS, ROWS[0]]), "2 with motor.viscous, step steady and recording a/1.mcap"),
    (lambda p: write_summary(p, [*ROWS, ROWS[2]]), "2 with no parameter, step steady and recording b/1.mcap")])
def test_what_is_no_summary_is_said(tmp_path, make, said):
    make(tmp_path / "s.parquet")
    with pytest.raises(BadRecording) as error:
        read_summary(tmp_path / "s.parquet")
    assert said in str(error.value) and error.value.do
