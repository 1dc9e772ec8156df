"""Five sequences of a real actuator: half sum and half difference of the current in both directions."""

import csv
import os
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from drivetool.logs.formats import Row
from drivetool.site.trends import trends_of
from tests.check.trends.sites import reported

FOLDER = os.environ.get("DRIVETOOL_RECORDS", "")
pytestmark = pytest.mark.skipif(not FOLDER, reason="DRIVETOOL_RECORDS is not set")
MOVING = 0.5  # of the highest speed of a stroke


def figures_of(path):
    """Name -> (value, std) in A; the current is a magnitude, positive in both directions."""
    table = {name: column.to_numpy() for name, column in zip(
        ("time", "position", "current"), pq.read_table(path, columns=["time", "position", "current"]), strict=True)}
    speed = np.gradient(table["position"], table["time"])
    fast = np.abs(speed) > MOVING * np.abs(speed).max()
    up, down = (table["current"][fast & (sign * speed > 0)] for sign in (1, -1))
    std = 0.5 * np.sqrt(up.var() / len(up) + down.var() / len(down))
    return {"motor.sum": (0.5 * (up.mean() + down.mean()), std),
            "motor.difference": (0.5 * (up.mean() - down.mean()), std)}


@cache
def examined_site():
    """(findings, machine and parameter -> trend) of all 445 recordings."""
    site, rows = Path(FOLDER) / "actuator-site", []
    for folder in sorted(site.glob("rig-*")):
        for i, path in enumerate(sorted(folder.glob("*.parquet"))):
            rows += [Row(f"{folder.name}/{path.name}", folder.name, None, i, "steady", name, float(value), "A",
                         float(std), "fitted") for name, (value, std) in figures_of(path).items()]
    findings, trends = trends_of(rows)
    return findings, {(t.series.machine, t.series.parameter): t for t in trends}


def test_rig_a_has_one_change_of_its_friction():
    _, by = examined_site()
    change, = by["rig-a", "motor.sum"].changes
    assert 49 <= change.place <= 51 and change.alarm and change.ratio >= 5.0  # recording 51 is place 50
    assert not by["rig-a", "motor.sum"].drift.significant and not by["rig-a", "motor.difference"].changes


@pytest.mark.parametrize("rig", ["rig-c", "rig-e"])
def test_rigs_without_a_change_have_none(rig):
    findings, by = examined_site()
    assert {parameter for machine, parameter in by if machine == rig} == {"motor.sum", "motor.difference"}
    assert not [f.text for f in reported(findings) if f.evidence["machine"] == rig]


@pytest.mark.parametrize("rig, parameter, least", [
    ("rig-b", "motor.sum", 2.0), ("rig-d", "motor.difference", 2.0), ("rig-d", "motor.sum", 2.0)])
def test_smaller_changes_are_listed_with_their_figures(rig, parameter, least):
    findings, _ = examined_site()
    found = [f for f in reported(findings) if (f.evidence["machine"], f.evidence["parameter"]) == (rig, parameter)]
    assert found and max(f.evidence["ratio"] for f in found) >= least
    assert all(" A " in f.text and "rig-" in f.text for f in found)


def test_recordings_without_dates_are_in_their_order():
    findings, by = examined_site()
    assert "undated-recordings" in {f.code for f in findings}
    text = next(f.text for f in findings if f.code == "trend-alarm")
    assert "between the recordings rig-a/0050.parquet and rig-a/0051.parquet" in text
    assert all(t.mean.days is None and t.drift.per_day is None for t in by.values())


def test_the_truth_says_the_same():
    """What was changed in the machine, opened after the trends were found."""
    _, by = examined_site()
    with (Path(FOLDER) / "actuator-site" / "truth.csv").open(encoding="utf-8") as stream:
        truth = list(csv.DictReader(stream))
    faults = {row["recording"].partition("/")[0]: row["recording"] for row in reversed(truth)
              if row["state"] != "normal"}
    found = {machine: trend.series.recordings[change.place] for (machine, _), trend in by.items()
             for change in trend.changes if change.ratio > 2.0}
    # Less lubricant at the other load is half a standard deviation.
    assert found == {machine: name for machine, name in faults.items() if machine != "rig-c"}
