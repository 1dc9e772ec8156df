"""What the steps write: parameter and validation files, schemas, tables, pictures."""

import json
import os
import re
from dataclasses import replace
from io import StringIO
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from rich.console import Console

from drivetool.check.validation import CheckSection, Validation
from drivetool.drive import two_mass
from drivetool.errors import BadOption, CannotWrite
from drivetool.files.disk import write
from drivetool.files.figures import plots, thinning
from drivetool.files.results.result_file import dump, estimate_file, validation_file
from drivetool.files.shapes import schema
from drivetool.files.tables import result_tables as tables
from drivetool.files.tables.number_format import rounded
from drivetool.files.yaml.parameter_file import load_parameters, load_result
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance, Estimate, Parameter, PlotData
from tests.places import SCHEMAS

DRIVE = two_mass().with_values({
    "motor.inertia": 0.5871234567, "load.inertia": 5.179, "shaft.stiffness": 3310.0,
    "shaft.damping": 1.5e-5, "shaft.half_gap": 0.075, "total.viscous": 0.00184})
ESTIMATE = Estimate(
    "greybox", DRIVE,
    (Parameter(name="load.inertia", value=5.179, unit="kg m^2", start=5, std=np.float64(0.023), ci95=(5.13, 5.22)),
     Parameter(name="motor.inertia", value=0.5871234567, unit="kg m^2", start=0.6, std=0.0012,
               ci95=(0.585, 0.5895)),
     Parameter(name="shaft.stiffness", value=3310.0, unit="Nm/rad", start=3445.0, std=123.0, ci95=(3069.0, 3551.0)),
     Parameter(name="shaft.damping", value=1.5e-5, unit="Nm s/rad", start=1e-5, std=None, ci95=None,
               status="not-identifiable", reason="no resonance"),
     Parameter(name="shaft.half_gap", value=0.075, unit="rad", status="held"),
     Parameter(name="converter.bandwidth", value=float("inf"), unit="rad/s", status="held")),
    "converged", {"simulation_fit_percent": 93.1, "one_step_fit_percent": 99.2, "rmse": float("nan"),
                  "n": 12},
    Covariance(("motor.inertia", "load.inertia", "shaft.damping"),
               np.array([[1.44e-6, 2e-7, 0], [2e-7, 5.29e-4, 0], [0, 0, np.nan]])),
    {"motor_speed_std": 0.02}, {"poles_hz": [[-1.0, 12.6], [-1.0, -12.6]]},
    (Finding("warning", "torque-source", "Torque noise is coloured [sic].", {"p": 1e-9, "lags": 20},
             "Diagnose."),),
    (("steps.parquet", "ab" * 32),), {"seed": 1, "hold": ("shaft.half_gap",)})
CHECK = CheckSection("greybox.yaml", "gap.parquet", "motor_speed", "rad/s", 93.12, None, 0.0123, 0.001, 0.99,
                    9000, 0.083, 0.03, 4.2, 0.31, None, True)
VALIDATION = Validation((CHECK, CHECK.replace(file="b.parquet", passed=False)), "missed on b.parquet",
                        data=(("gap.parquet", "ab" * 32), ("b.parquet", "cd" * 32)))


def dump_estimate(estimate, inputs=(), form="yaml"):
    """The parameter file of an estimate as text."""
    return dump(estimate_file(estimate, inputs), form)


def load(tmp_path, text):
    """What load_parameters makes of a text."""
    path = tmp_path / "x.yaml"
    path.write_text(text)
    return load_parameters([path])


def test_round_trip(tmp_path):
    loaded = load(tmp_path, dump_estimate(ESTIMATE))
    assert loaded.stated().start == DRIVE
    assert loaded.stated(two_mass()).start == DRIVE
    covariance = loaded.covariance(DRIVE)
    assert covariance.names == ("motor.inertia", "load.inertia")
    np.testing.assert_allclose(covariance.matrix, [[1.44e-6, 2e-7], [2e-7, 5.29e-4]], rtol=1e-9)
    assert loaded.noise == ESTIMATE.noise and loaded.sources[0].file.details == ESTIMATE.details


def test_a_total_and_its_part_are_not_both_written(tmp_path):
    part = Parameter(name="motor.viscous", value=0.001, unit="Nm s/rad", status="not-identifiable")
    text = dump_estimate(replace(ESTIMATE, parameters=(*ESTIMATE.parameters, part)))
    entry = yaml.safe_load(text)["parameters"]["motor.viscous"]
    assert entry["value"] is None and entry["reason"] == "stated as total.viscous"
    assert load(tmp_path, text).stated().start == DRIVE


def test_a_part_of_a_std_that_is_not_finite_is_left_out(tmp_path):
    known = ESTIMATE.parameters[0].replace(std=float("nan"), std_noise=float("inf"), repeatability=0.5)
    text = dump_estimate(replace(ESTIMATE, parameters=(known,)))
    entry = yaml.safe_load(text)["parameters"][known.name]
    assert (entry["std"], entry["reason"]) == (None, "the standard deviation is not finite")
    assert "std_noise" not in entry and entry["repeatability"] == 0.5
    assert load(tmp_path, text).stated().start.values[known.name] == known.value


def test_edited_unit_converts_value_and_covariance(tmp_path):
    content = yaml.safe_load(dump_estimate(ESTIMATE))
    content["parameters"]["load.inertia"] |= {"value": 5179.0, "unit": "g m^2"}
    loaded = load(tmp_path, yaml.safe_dump(content))
    assert loaded.stated().start.value("load.inertia") == pytest.approx(5.179)
    assert loaded.covariance(DRIVE).matrix[0] == pytest.approx([1.44e-6, 2e-10])


def test_same_estimate_same_bytes_and_json_has_the_same():
    text = dump_estimate(ESTIMATE, [("steady.yaml", "cd" * 32)])
    assert text == dump_estimate(replace(ESTIMATE), [("steady.yaml", "cd" * 32)])
    assert text.isascii() and "&id" not in text and not re.search(r"[ .](nan|inf)\b", text)
    assert json.loads(dump_estimate(ESTIMATE, form="json")) == yaml.safe_load(dump_estimate(ESTIMATE))
    assert "ci95: [0.585, 0.5895]" in text and "- [1.44e-06, 2.0e-07]" in text and "std: 123.0" in text
    assert "start: 5.0" in text and "value: 1.5e-05" in text


def test_keys_other_tools_read():
    content = yaml.safe_load(dump_estimate(ESTIMATE, [("steady.yaml", "cd" * 32)]))
    assert content["schema"] == "drivetool/parameters/1" and content["step"] == "greybox"
    assert list(content["parameters"])[:2] == ["motor.inertia", "load.inertia"]
    for entry in content["parameters"].values():
        assert list(entry) == ["value", "unit", "std", "ci95", "start", "status", "reason"]
    assert content["parameters"]["converter.bandwidth"]["value"] is None
    assert "infinite" in content["parameters"]["converter.bandwidth"]["reason"]
    assert content["parameters"]["total.viscous"]["value"] == 0.00184
    assert content["fit"]["rmse"] is None and content["fit"]["n"] == 12
    assert content["data"] == [{"file": "steps.parquet", "sha256": "ab" * 32}]
    assert content["inputs"][0]["file"] == "steady.yaml"
    assert list(content["findings"][0]) == ["severity", "code", "text", "evidence", "action"]
    assert content["tool"]["name"] == "drivetool"


def test_files_follow_their_schemas():
    texts = schema.schemas()
    for name, text in (("parameters.json", dump_estimate(ESTIMATE)),
                       ("validation.json", dump(validation_file(VALIDATION))),
                       ("parameters.json", "schema: drivetool/parameters/1\nparameters: {motor.inertia: 4}")):
        jsonschema.validate(yaml.safe_load(text), json.loads(texts[name]))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"schema": "drivetool/parameters/1", "parmeters": {}},
                            json.loads(texts["parameters.json"]))


def test_schemas_have_not_drifted():
    texts = schema.schemas()
    assert set(texts) == {path.name for path in SCHEMAS.iterdir()}
    for name, text in texts.items():
        assert (SCHEMAS / name).read_text() == text, f"run `make schemas`: {name} has drifted"


def show(print_it, file, width=80, terminal=False):
    """What a console of this width shows."""
    out = StringIO()
    print_it(file, Console(file=out, width=width, force_terminal=terminal, highlight=False))
    return out.getvalue()


def test_parameter_table_fits_80_columns():
    text = show(tables.print_estimate, estimate_file(ESTIMATE))
    assert "\x1b" not in text and "…" not in text
    assert max(map(len, text.splitlines())) <= 80
    rows = {line.split()[0]: line.split() for line in reversed(text.splitlines()) if line.strip()}
    assert rows["motor.inertia"] == [
        "motor.inertia", "0.5871", "kg", "m^2", "0.0012", "0.20", "0.6", "fitted"]
    assert rows["shaft.stiffness"][1:5] == ["3310", "Nm/rad", "120", "3.7"]
    assert rows["shaft.damping"][4:] == ["-", "-", "1e-05", "not", "identifiable"]
    assert "shaft.damping: no resonance" in text
    assert "simulation fit          93.1 %" in text and "one-step fit            99.2 %" in text
    assert "\x1b[2m" in show(tables.print_estimate, estimate_file(ESTIMATE), terminal=True)


def test_findings_are_listed_with_what_to_do():
    text = show(lambda file, console: tables.print_findings(file.findings, console), estimate_file(ESTIMATE))
    assert text == "warning torque-source: Torque noise is coloured [sic]. Diagnose.\n"


def test_validation_table_and_cross_table():
    text = show(tables.print_validation, validation_file(VALIDATION))
    assert "missed on b.parquet" in text and "93.12" in text and "model (row)" not in text
    both = replace(VALIDATION, checks=VALIDATION.checks + tuple(
        check.replace(model="backlash.yaml", simulation_fit_percent=97.5) for check in VALIDATION.checks))
    text = show(tables.print_validation, validation_file(both))
    assert "model (row)" in text and "…" not in text and max(map(len, text.splitlines())) <= 80
    assert [line.split() for line in text.splitlines()][-2] == ["backlash", "97.5", "97.5"]


def test_figures_that_a_constant_torque_leaves_out_are_dashes(tmp_path):
    nan = float("nan")
    check = CHECK.replace(max_correlation=nan, band=nan, lags_outside_percent=nan, correlation_p=nan)
    path = tmp_path / "v.yaml"
    path.write_text(dump(validation_file(replace(VALIDATION, checks=(check,)))))
    assert yaml.safe_load(path.read_text())["checks"][0]["lags_outside_percent"] is None
    row = show(tables.print_validation, load_result(path)).splitlines()[-2].split()
    assert row == ["greybox", "gap", "93.12", "-", "0.0123", "-", "-", "met"]


@pytest.mark.parametrize("value, std, expected", [
    (0.58712, 0.00123, ("0.5871", "0.0012")), (3310.4, 123.0, ("3310", "120")),
    (5.0, 0.0996, ("5.00", "0.10")),
    (12345.6, 45678.0, ("12000", "46000")), (1.2345e-8, 3.4e-10, ("1.235e-08", "3.4e-10")),
    (4.5e9, 2.2e7, ("4.500e+09", "2.2e+07")), (0.0, 1e-9, ("0.0e+00", "1.0e-09")), (2.0, None, ("2", "-")),
    (2.0, 0.0, ("2", "0")), (None, None, ("-", "-")), (-15.14, 0.2, ("-15.14", "0.20")),
])
def test_value_and_std_end_at_the_same_digit(value, std, expected):
    assert rounded(value, std) == expected


def test_show_reads_both_kinds(tmp_path):
    path = tmp_path / "v.yaml"
    path.write_text(dump(validation_file(VALIDATION)))
    assert load_result(path) == validation_file(VALIDATION)
    path.write_text("schema: drivetool/parameters/1\ndrive: {torque_unit: A}\nparameters: {motor.inertia: 4}")
    assert load_result(path).parameters["motor.inertia"].unit == "A s^2/rad"
    path.write_text(dump_estimate(ESTIMATE))
    assert dump(load_result(path)) == dump_estimate(ESTIMATE)


def full(*_):
    raise OSError(28, "No space left on device")


def test_files_are_written_whole(tmp_path, monkeypatch):
    target = tmp_path / "x.yaml"
    write.write_whole(target, "old")
    target.chmod(0o640)
    with monkeypatch.context() as disk, pytest.raises(CannotWrite, match="No space left"):
        disk.setattr(os, "fsync", full)
        write.write_whole(target, "new")
    assert target.read_text() == "old" and os.listdir(tmp_path) == ["x.yaml"]
    write.write_whole(target, b"new")
    assert target.read_text() == "new" and target.stat().st_mode & 0o777 == 0o640
    with pytest.raises(BadOption, match=r"x\.yaml, which is no folder"):
        write.write_whole(target / "none" / "x", "")
    with pytest.raises(BadOption, match="Add a file name"):
        write.write_whole(tmp_path, "")


def test_missing_folders_are_made_with_the_file_and_stay_away_without_it(tmp_path, monkeypatch):
    there, target = tmp_path / "there", tmp_path / "there" / "new" / "one" / "x.yaml"
    there.mkdir()
    write.check_target(target)
    assert not list(there.iterdir())  # the check creates nothing
    with monkeypatch.context() as disk, pytest.raises(CannotWrite, match="No space left"):
        disk.setattr(os, "replace", full)
        write.write_whole(target, "new")
    assert there.is_dir() and not list(there.iterdir())
    write.write_whole(target, "new")
    assert target.read_text() == "new"


def test_what_a_link_points_to_is_written_and_a_pipe_is_fed(tmp_path):
    target, link, pipe = tmp_path / "there" / "x.yaml", tmp_path / "link.yaml", tmp_path / "pipe"
    target.parent.mkdir()
    target.write_text("old")
    link.symlink_to(target)
    write.write_whole(link, "new")
    assert link.is_symlink() and target.read_text() == "new"
    astray = tmp_path / "astray.yaml"
    astray.symlink_to(tmp_path / "nowhere" / "x.yaml")
    with pytest.raises(BadOption, match="nowhere"):  # before the work, not after it
        write.check_target(astray)
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write.write_whole(pipe, "fed")
    assert os.read(reader, 9) == b"fed" and pipe.is_fifo()
    os.close(reader)
    if hasattr(os, "mkfifo") and Path("/dev/null").is_char_device():
        write.write_whole("/dev/null", "gone")
        assert Path("/dev/null").is_char_device()


def test_a_suspect_structure_marks_the_intervals():
    finding = Finding("warning", "innovations-correlated", "Still correlated.")
    file = estimate_file(replace(ESTIMATE, findings=(finding,)))
    reasons = {name: entry.reason for name, entry in file.parameters.items()}
    stated = {p.name for p in ESTIMATE.parameters if p.std is not None}
    assert {n for n, r in reasons.items() if "assumes a complete model" in r} == stated
    assert show(tables.print_estimate, file).count("assumes a complete model") == 1
    assert "assumes a complete model" not in show(tables.print_estimate, estimate_file(ESTIMATE))


TIME = np.arange(6000) * 1e-3
SPEED = np.sin(TIME)
FIVE = np.linspace(1.0, 3.0, 5)
EXHIBITS = [
    PlotData("record", "Fit", "time [s]", "motor speed [rad/s]", {
        "measured": (TIME, np.where(TIME > 5, np.nan, SPEED)), "simulated": (TIME, SPEED + 0.1),
        "residual": (TIME, SPEED * 0), "torque [Nm]": (TIME, SPEED)}),
    PlotData("record", "Fit", "time [s]", "motor speed [rad/s]", {"measured": (TIME, SPEED)}),
    PlotData("steady", "Friction", "speed [rad/s]", "torque [Nm]", {
        "plateaus": (FIVE, FIVE), "std": (FIVE, FIVE / 9), "line": (FIVE, FIVE)}),
    PlotData("correlation", "Residual", "lag", "", {
        "correlation": (FIVE, FIVE), "band": (FIVE, FIVE), "limit": (FIVE, FIVE)}),
    PlotData("profile", "Gap", "half gap [rad]", "loss", {"profile": (FIVE, FIVE), "95 % level": (FIVE, FIVE)}),
    PlotData("bode", "Response", "Hz", "", {"measured": (FIVE - 1, FIVE), "model": (FIVE, FIVE)}),
    PlotData("something-new", "New", "x", "y", {str(i): (FIVE, FIVE) for i in range(9)}),
    PlotData("record", "Empty", "x", "y", {}),
]


def test_every_kind_is_drawn_with_the_same_bytes(tmp_path):
    names = plots.draw_all(EXHIBITS, tmp_path / "a" / "b", "greybox", ["x.parquet"])
    assert names[:3] == ["greybox-1-record.png", "greybox-2-record.png", "greybox-x-steady.png"]
    assert sorted(names) == sorted(os.listdir(tmp_path / "a" / "b"))
    for exhibit, name in zip(EXHIBITS[:3], names, strict=False):
        content = (tmp_path / "a" / "b" / name).read_bytes()
        assert content == plots.png(exhibit) and content.startswith(b"\x89PNG")
        assert b"atplotlib" not in content


def test_a_letter_that_the_font_lacks_is_no_warning():
    """Warnings are errors here; a page draws the same way."""
    plain, foreign = (plots.png(PlotData("record", title, "time [s]", "", {"measured": (TIME, SPEED)}))
                      for title in ("record", "試験"))
    assert foreign.startswith(b"\x89PNG") and foreign != plain


def test_names_follow_the_records(tmp_path):
    assert plots.picture_names(EXHIBITS[:2], "steady", ["a.parquet", "b.mcap"]) == [
        "steady-a-record.png", "steady-b-record.png"]
    assert plots.picture_names(EXHIBITS[:2], "steady", ["a.parquet", "a.mcap"])[0] == "steady-1-record.png"
    rounds = [PlotData("diagnosis-candidates", "Causes", "x", "y", {})] * 2  # as many as records, but not theirs
    assert plots.picture_names(rounds, "diagnose", ["a.parquet", "b.mcap"]) == [
        "diagnose-round-1-diagnosis-candidates.png", "diagnose-round-2-diagnosis-candidates.png"]
    (tmp_path / "file").touch()
    with pytest.raises(BadOption, match="another folder"):
        plots.draw_all([], tmp_path / "file" / "x", "s")


def test_thinning_keeps_every_peak():
    y = np.zeros(100_003)
    y[[5, 77_777, 100_002]] = 9.0, -9.0, 3.0
    x, thin = thinning.decimated(np.arange(y.size), y)
    assert len(x) <= 2400 and np.all(np.diff(x) >= 0)
    assert thin.max() == 9.0 and thin.min() == -9.0 and thin[-1] == 3.0


@pytest.mark.parametrize("size", [300, 100_000])
def test_no_line_is_drawn_over_a_gap(size):
    time = np.delete(np.arange(size) * 1e-3, np.arange(size // 3, size // 2))
    x, y = thinning.decimated(time, np.cos(time))
    gap = np.flatnonzero(np.isnan(y))
    assert len(gap) == 1 and x[gap[0]] == time[size // 3 - 1]
    assert x[0] == time[0] and abs(x[gap[0] - 1] - time[size // 3 - 1]) < 0.2 and np.all(np.diff(x) >= 0.0)
    whole, curve = thinning.decimated(np.geomspace(1.0, 1e3, 400), np.ones(400))
    assert len(whole) == 400 and np.all(np.isfinite(curve))
