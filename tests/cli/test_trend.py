"""drivetool trend: a summary in; file, table, pictures and exit code out."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import jsonschema
import numpy as np
import pytest
import yaml

from tests.check.trends.sites import site, step
from tests.places import SCHEMAS
from tests.summaries import write_summary

CHANGED = {(2, "shaft.half_gap"): step(9.0, 15), (3, "motor.viscous"): 0.4 * np.arange(25)}


@pytest.fixture
def summary(here):
    return write_summary(here / "summary.parquet", site(4, machines=3, changed=CHANGED))


def test_alarms_with_dates_and_units_in_a_file_that_keeps_to_its_schema(call, summary):
    code, out, err = call("trend", summary, "--out", "trends.yaml")
    assert code == 0 and not out
    file = yaml.safe_load(summary.with_name("trends.yaml").read_text(encoding="utf-8"))
    jsonschema.validate(file, json.loads((SCHEMAS / "trends.json").read_text()))
    change, drift = file["findings"]
    assert drift["code"] == change["code"] == "trend-alarm" and drift["severity"] == "warning"
    assert change["text"].startswith("Half gap of press 2 grew from 2.0")
    assert "mrad between 29 March and 31 March 2026; that is" in change["text"]
    assert drift["text"].startswith("Motor viscous friction of press 3 grew slowly from 0.")
    assert "between 1 March and 18 April 2026. The slope is" in drift["text"]
    assert "Nm s/rad per day (95 % interval" in drift["text"]
    assert file["outcome"] == "15 series of 3 machines: 2 alarms, no smaller changes, no outlying recordings"
    assert file["outcome"] in err
    series, = (s for s in file["series"] if (s["machine"], s["parameter"]) == ("press 2", "shaft.half_gap"))
    assert [c["began"] for c in series["changes"]] == [["2026-03-29T00:00:00Z", "2026-03-31T00:00:00Z"]]
    assert [part["recordings"] for part in series["parts"]] == [15, 10] and series["mean"]["days"] == 25
    assert file["inputs"][0]["file"] == "summary.parquet" and file["options"] == {"alarm": 5.0}


def test_strict_makes_an_alarm_count(call, summary):
    assert call("trend", summary, "--strict", "--out", "t.yaml", "--quiet") == (3, "", "")
    assert call("trend", summary, "--strict", "--alarm", "100", "--out", "t.yaml")[0] == 0


def test_json_has_the_same_content_and_show_its_table(call, summary):
    _, printed, _ = call("trend", summary)
    _, text, _ = call("trend", summary, "--json")
    assert json.loads(text) == yaml.safe_load(printed)
    (summary.parent / "t.yaml").write_text(printed, encoding="utf-8")
    code, table, _ = call("show", "t.yaml")
    assert code == 0 and "s_R: between days" in table and "warning trend-alarm: Half gap of press 2" in table
    rows = [line.split() for line in table.splitlines()]
    assert next(r for r in rows if r[:3] == ["press", "2", "shaft.half_gap"])[-1] == "alarm"
    assert next(r for r in rows if r[:3] == ["press", "1", "shaft.half_gap"])[-1] == "-"


@pytest.mark.slow
def test_a_picture_per_machine(call, summary, tmp_path):
    assert call("trend", summary, "--plot", "one", "--out", "t.yaml")[0] == 0
    assert sorted(p.name for p in (tmp_path / "one").iterdir()) == [f"trend-press {i}-trend.png" for i in (1, 2, 3)]
    assert call("trend", summary, "--plot", "two", "--out", "t.yaml")[0] == 0
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()


@pytest.mark.slow
def test_the_same_bytes_in_any_time_zone_and_language(summary):
    texts = set()
    for zone, language in (("UTC", "C"), ("America/New_York", "de_DE.UTF-8"), ("Asia/Tokyo", "tr_TR.UTF-8")):
        done = subprocess.run([sys.executable, "-m", "drivetool", "trend", str(summary), "--quiet"],
                              capture_output=True, env={**os.environ, "TZ": zone, "LC_ALL": language})
        assert done.returncode == 0 and not done.stderr
        texts.add(done.stdout)
    assert len(texts) == 1


def test_the_order_of_the_rows_is_no_matter(call, summary):
    _, first, _ = call("trend", summary)
    rows = site(4, machines=3, changed=CHANGED)
    mixed = [row for i in (1, 0, 2) for row in rows if (row.order % 3) == i]
    rows = sorted(mixed, key=lambda row: row.machine)  # machines stay in their order, recordings do not
    write_summary(summary, rows)
    _, second, _ = call("trend", summary)
    assert yaml.safe_load(first)["series"] == yaml.safe_load(second)["series"]


def codes_of(call, path, rows, *words):
    write_summary(path, rows)
    code, out, err = call("trend", path, *words)
    assert code == 0 and "Traceback" not in err and "Warning" not in err
    file = yaml.safe_load(out)
    return [f["code"] for f in file["findings"]], file


def test_recordings_without_dates_have_their_names(call, summary):
    codes, file = codes_of(call, summary, site(4, machines=3, changed=CHANGED, dated=False))
    assert codes == ["trend-alarm", "trend-alarm", "undated-recordings"]
    texts = " ".join(f["text"] for f in file["findings"])
    assert "between the recordings press 2/14.parquet and press 2/15.parquet" in texts and "per recording" in texts
    assert all(s["mean"]["days"] is None and s["drift"]["per_day"] is None for s in file["series"])


def test_one_recording_per_machine_has_means_only(call, summary):
    codes, file = codes_of(call, summary, [r for r in site(4, machines=3) if r.order == 0])
    assert codes == ["few-recordings"]
    assert all(s["mean"]["ci95"] is None and s["drift"] is None and s["reason"].startswith("fewer")
               for s in file["series"])
    code, _, _ = call("trend", summary, "--plot", "p", "--out", "t.yaml")
    assert code == 0 and call("show", "t.yaml")[0] == 0


def test_values_that_are_none_are_left_out_and_counted(call, summary):
    rows = site(4, machines=2)
    odd = {3: {"value": float("nan")}, 5: {"value": float("inf")}, 7: {"value": None},
           9: {"status": "not-identifiable"}, 11: {"std": float("nan")}, 13: {"std": None}, 15: {"std": -1.0},
           17: {"std": None, "status": "at-bound"}}
    rows = [replace(r, **odd.get(r.order, {})) for r in rows]
    codes, file = codes_of(call, summary, rows)
    assert codes == ["values-missing"] and {s["left_out"] for s in file["series"]} == {7}
    assert {s["mean"]["recordings"] for s in file["series"]} == {18}
    _, file = codes_of(call, summary, [replace(r, std=None) for r in rows])  # where none has one, none lacks it
    assert {s["left_out"] for s in file["series"]} == {4}


def test_equal_values_have_no_trend(call, summary):
    rows = [replace(r, value=2.0, std=None) for r in site(4, machines=2)]
    codes, file = codes_of(call, summary, rows, "--plot", "p")
    assert codes == [] and {s["reason"] for s in file["series"]} == {"all values are equal"}
    assert all(s["mean"]["ci95"] == [2.0, 2.0] for s in file["series"])


def test_a_copied_recording_counts_once(call, summary):
    rows = site(4, machines=2)
    copies = [replace(r, recording=f"{r.machine}/copy.parquet", order=25) for r in rows
              if r.order == 3 and r.machine == "press 1"]
    codes, file = codes_of(call, summary, rows + copies)
    assert codes == ["copied-recordings"]
    assert "press 1/copy.parquet repeats press 1/03.parquet" in file["findings"][0]["text"]
    assert {s["mean"]["recordings"] for s in file["series"]} == {25}


def test_two_steps_that_fit_one_parameter_are_separate(call, summary):
    rows = site(4, machines=1, changed={(1, "motor.coulomb"): step(9.0, 15)})
    rows += [replace(r, step="steady") for r in site(5, machines=1)]
    _, file = codes_of(call, summary, rows)
    assert [f["text"].split(" grew")[0] for f in file["findings"]] == [
        "Motor Coulomb friction of press 1, by greybox,"]


def test_kinds_of_recordings_are_series_of_their_own_and_a_joint_fit_is_none(call, summary):
    rows = [replace(r, kind="steps") for r in site(4, machines=1, changed={(1, "motor.coulomb"): step(9.0, 15)})]
    rows += [replace(r, kind="gap", recording=f"gap {r.recording}") for r in site(5, machines=1)]
    rows += [replace(r, recording="", order=0) for r in site(6, machines=1, n=1)]
    _, file = codes_of(call, summary, rows)
    assert len(file["series"]) == 10 and {s["mean"]["recordings"] for s in file["series"]} == {25}
    assert [f["text"].split(" grew")[0] for f in file["findings"]] == [
        "Motor Coulomb friction of press 1, by greybox of steps,"]


def test_a_name_with_dollar_signs_is_no_formula(call, summary):
    write_summary(summary, [replace(r, machine="A$B^{$") for r in site(4, machines=1)])
    assert call("trend", summary, "--plot", "p", "--out", "t.yaml")[0] == 0


def test_too_few_of_one_kind_of_one_unit_or_with_a_value_are_said(call, summary):
    rows = site(4, machines=3, n=10)
    rows = [replace(r, kind="a" if r.order % 2 else "b") if r.machine == "press 1" else
            replace(r, unit=r.unit + " old", value=2 * r.value) if r.machine == "press 2" and r.order < 3 else
            replace(r, value=None) if r.machine == "press 3" else r for r in rows]
    rows.append(replace(rows[0], machine="", recording="lost", parameter=None, value=None, std=None))
    codes, file = codes_of(call, summary, rows)
    assert codes == ["few-recordings", "units-mixed"]
    assert "too few: press 1 has 5, press 3 has 0. " in file["findings"][0]["text"]
    assert "of press 2 in rad old and rad" in file["findings"][1]["text"]


def test_what_is_no_summary_is_one_sentence(call, summary, tmp_path):
    (tmp_path / "no.parquet").write_text("no")
    for words in (["no.parquet"], ["missing.parquet"], ["."]):
        code, out, err = call("trend", *words)
        assert code == 1 and not out and err.count("\n") == 1 and "wanted the summary of a site" in err
    before = summary.read_bytes()
    assert call("trend", summary, "--out", summary)[0] == 2 and summary.read_bytes() == before
    assert call("trend", summary, "--alarm", "0")[0] == call("trend", summary, "--alarm", "nan")[0] == 2
