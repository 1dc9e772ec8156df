"""--record FILE WORD: what differs in one of the recordings, from the command line to the next step's file."""

import pytest
import yaml

from drivetool.cli.options.job import WORD_SEPARATOR
from drivetool.cli.options.record_option import join_record_words
from drivetool.errors import BadParameters
from drivetool.files.yaml import load_parameters
from tests.cli.test_inverse import logged
from tests.identify.test_by_record import record

ONE = ("--drive", "one-body", "--set", "motor.inertia=0.03")


@pytest.fixture(scope="module")
def made():
    return {"a": record("a", 1), "b": record("b", 2, inertia=0.026), "c": record("c", 3, coulomb=0.42)}


@pytest.fixture
def site(tmp_path, made):
    for name, each in made.items():
        logged(tmp_path, f"{name}.parquet", each)
    return tmp_path


def content_of(path):
    return yaml.safe_load(path.read_text())


def fitted(call, site, *words):
    b, c = site / "b.parquet", site / "c.parquet"
    return call("greybox", site / "a.parquet", b, c, *ONE, "--record", b, "motor.added_inertia=60 kg cm^2",
                f"--record={c}", "free=motor.coulomb", "--out", site / "fit.yaml", *words)


@pytest.mark.slow
def test_the_file_says_what_differs_and_later_steps_read_it(call, site):
    code, _, err = fitted(call, site)
    assert code == 0, err
    fit = content_of(site / "fit.yaml")
    assert {entry["file"]: entry["sha256"] for entry in fit["records"]} == {
        entry["file"]: entry["sha256"] for entry in fit["data"] if entry["file"] != "a.parquet"}
    lines = fit["parameters"]
    assert lines["motor.added_inertia@b.parquet"]["value"] == 0.006
    assert lines["motor.added_inertia@b.parquet"]["status"] == "held"
    assert abs(lines["motor.coulomb@c.parquet"]["value"] - 0.42) < 0.01
    assert abs(lines["motor.coulomb"]["value"] - 0.3) < 0.01
    assert "motor.coulomb@c.parquet" in fit["covariance"]["names"]
    assert fit["options"]["record"] == [["b.parquet", "motor.added_inertia=60 kg cm^2"],
                                        ["c.parquet", "free=motor.coulomb"]]
    assert str(site) not in (site / "fit.yaml").read_text()
    code, _, err = call("validate", site / "c.parquet", site / "b.parquet", "--params", site / "fit.yaml",
                        "--out", site / "check.yaml")
    assert code == 0, err
    assert all(check["simulation_fit_percent"] > 98.0 for check in content_of(site / "check.yaml")["checks"])
    code, _, err = call("greybox", site / "a.parquet", "--params", site / "fit.yaml", "--out", site / "next.yaml")
    assert code == 0, err
    after = content_of(site / "next.yaml")
    assert after["records"] == fit["records"]
    assert after["parameters"]["motor.coulomb@c.parquet"]["value"] == lines["motor.coulomb@c.parquet"]["value"]


def test_a_known_change_is_validated(call, site):
    call("greybox", site / "a.parquet", *ONE, "--out", site / "fit.yaml")
    fits = []
    for words in ([], ["--record", site / "b.parquet", "motor.added_inertia=0.006"]):
        call("validate", site / "b.parquet", "--params", site / "fit.yaml", *words, "--out", site / "check.yaml")
        fits.append(content_of(site / "check.yaml")["checks"][0]["simulation_fit_percent"])
    assert fits[0] < 90.0 < 98.0 < fits[1]
    assert content_of(site / "check.yaml")["options"]["record"] == [["b.parquet", "motor.added_inertia=0.006"]]


@pytest.mark.slow
def test_a_diagnosis_knows_what_differs(call, site):
    fitted(call, site)
    b, c = site / "b.parquet", site / "c.parquet"
    call("diagnose", b, c, "--params", site / "fit.yaml", "--candidates", "quadratic-drag",
         "--out", site / "diagnosis.yaml")
    found = content_of(site / "diagnosis.yaml")
    assert found["diagnosis"]["verdict"] == "nothing-found"
    assert abs(found["parameters"]["motor.coulomb@c.parquet"]["value"] - 0.42) < 0.01


@pytest.mark.slow
def test_a_start_of_one_recording(call, site):
    a, b = site / "a.parquet", site / "b.parquet"
    code, _, err = call("greybox", a, b, *ONE, "--record", a, "start=rest", "--record", b, "start=free",
                        "--record", b, "motor.added_inertia=0.006", "--out", site / "fit.yaml")
    assert code == 0, err
    known = content_of(site / "fit.yaml")["details"]["known_start"]
    assert known == {"a.parquet": {"motor.speed": 0.0}, "b.parquet": {}}


@pytest.mark.parametrize("step, file, word, said", [
    ("greybox", "x.parquet", "motor.coulomb=1", "available: {site}/a.parquet, {site}/b.parquet"),
    ("greybox", "b.parquet", "motor.culomb=1", "Did you mean 'motor.coulomb'"),
    ("greybox", "b.parquet", "free=", "names after free="),
    ("greybox", "b.parquet", "free=motor.culomb", "Did you mean 'motor.coulomb'"),
    ("greybox", "b.parquet", "motor.coulomb=1 kg", "found unit 'kg'"),
    ("greybox", "b.parquet", "motor.coulomb=-1", "motor.coulomb@b.parquet between 0 and 1e+12"),
    ("greybox", "b.parquet", "start=turning", "'turning'"),
    ("greybox", "b.parquet", "motor.coulomb", "NAME=VALUE after --record"),
    ("validate", "b.parquet", "free=motor.coulomb", "known changes after --record of validate")])
def test_what_is_wrong_is_said_in_one_sentence(call, site, step, file, word, said):
    (site / "fit.yaml").write_text("schema: drivetool/parameters/1\ndrive: {bodies: [motor]}\n"
                                   "parameters: {motor.inertia: 0.02}\n")
    before = sorted(site.iterdir())
    code, _, err = call(step, site / "a.parquet", site / "b.parquet", "--params", site / "fit.yaml",
                        "--record", site / file, word, "--out", site / "new.yaml")
    assert code == 2 and said.format(site=site) in err and "Traceback" not in err
    assert sorted(site.iterdir()) == before


def test_a_frequency_response_is_of_all_recordings(call, site):
    b = site / "b.parquet"
    code, _, err = call("greybox", site / "a.parquet", b, *ONE, "--criterion", "frequency", "--record", b,
                        "motor.added_inertia=0.006")
    assert code == 2 and "recordings that differ" in err


@pytest.mark.parametrize("word", ["free=total.viscous", "total.viscous=0.01"])
def test_a_sum_is_not_named_where_its_parts_are_known(call, site, word):
    code, _, err = call("greybox", site / "a.parquet", *ONE, "--record", site / "a.parquet", word)
    assert code == 2 and "Name motor.viscous" in err


def test_the_advice_can_be_copied(call, site):
    call("greybox", site / "a.parquet", *ONE, "--out", site / "fit.yaml")
    b = site / "b.parquet"
    _, _, err = call("validate", b, "--params", site / "fit.yaml", "--record", b, "motor.added_inertia=0.001",
                     "--out", site / "check.yaml")
    assert "run diagnose" in err and f"--record {b} motor.added_inertia=0.001" in err


def file_with(folder, name, records, **parameters):
    content = {"schema": "drivetool/parameters/1", "drive": {"bodies": ["motor"]}, "parameters": parameters,
               "records": [{"file": f, "sha256": s} for f, s in records]}
    (folder / name).write_text(yaml.safe_dump(content))
    return folder / name


A, B = 64 * "a", 64 * "b"


def test_a_recording_goes_by_its_last_name_and_keeps_its_values(tmp_path):
    one = file_with(tmp_path, "one.yaml", [("x", A), ("y", B)], **{
        "motor.inertia": 1.0, "motor.coulomb@x": 0.9, "motor.viscous@x": 0.2, "motor.coulomb@y": 0.5})
    two = file_with(tmp_path, "two.yaml", [("renamed", A), ("y", 64 * "c")], **{"motor.coulomb@renamed": 0.3})
    drive = load_parameters([one, two]).stated().start
    assert drive.records == {"renamed": A, "y": 64 * "c"}
    assert {n: v for n, v in drive.values.items() if "@" in n} == {
        "motor.coulomb@renamed": 0.3, "motor.viscous@renamed": 0.2}


@pytest.mark.parametrize("records, parameters, said", [
    ([("x", "abc")], {}, "64 hexadecimal digits"), ([("x", A), ("z", A)], {}, "every recording once"),
    ([("x", A), ("x", B)], {}, "every recording once"),
    ([], {"motor.coulomb@x": 1.0}, "recording that has parameters"),
    ([("x", A)], {"total.viscous": 0.1, "motor.viscous@x": 0.2}, "either total.viscous or its parts")])
def test_what_is_wrong_in_a_file_is_said(tmp_path, records, parameters, said):
    path = file_with(tmp_path, "bad.yaml", records, **{"motor.inertia": 1.0, **parameters})
    with pytest.raises(BadParameters) as error:
        load_parameters([path]).stated()
    assert said in str(error.value)


def test_two_recordings_of_one_content_cannot_differ(call, site):
    (site / "copy.parquet").write_bytes((site / "b.parquet").read_bytes())
    code, _, err = call("greybox", site / "copy.parquet", site / "b.parquet", *ONE, "--record", site / "b.parquet",
                        "free=motor.coulomb")
    assert code == 2 and "with one content" in err


@pytest.mark.slow
def test_recordings_of_one_name_are_distinguished(call, site):
    other = site / "other"
    other.mkdir()
    (other / "a.parquet").write_bytes((site / "c.parquet").read_bytes())
    code, _, err = call("greybox", site / "a.parquet", other / "a.parquet", *ONE, "--record", site / "a.parquet",
                        "free=motor.coulomb", "--record", other / "a.parquet", "free=motor.coulomb",
                        "--out", site / "fit.yaml")
    assert code == 0, err
    lines = content_of(site / "fit.yaml")["parameters"]
    assert abs(lines["motor.coulomb@a.parquet"]["value"] - 0.3) < 0.01
    assert abs(lines["motor.coulomb@a.parquet (2)"]["value"] - 0.42) < 0.01


def test_the_words_behind_the_option_are_joined():
    pair = f"f{WORD_SEPARATOR}x=1"
    assert join_record_words(["a", "--record", "f", "x=1", "b"]) == ["a", "--record", pair, "b"]
    assert join_record_words(["--record=f", "x=1"]) == ["--record", pair]
    assert join_record_words(["--record", "f"]) == ["--record", "f"]
    assert join_record_words(["--", "--record", "f", "x=1"]) == ["--", "--record", "f", "x=1"]
