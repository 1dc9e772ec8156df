"""diagnose at the command line, with a stand-in for the statistics."""

import json
import re
import types
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import jsonschema
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from drivetool.check.outcome import OUTSIDE_CATALOGUE, DiagnoseOptions
from drivetool.errors import NotEnoughData
from drivetool.files.disk import write
from drivetool.files.shapes import schema
from drivetool.finding import Finding
from tests import diagnosed

FITTED = """schema: drivetool/parameters/1
parameters:
  motor.inertia: {value: 0.587, unit: kg m^2, std: 0.002, status: fitted}
  load.inertia: {value: 51790, unit: kg cm^2, std: 100, start: 60000, status: fitted}
  shaft.stiffness: {value: 3200, unit: Nm/rad}
noise: {sensor_std.motor_speed: 0.02, torque_std: 0.3}
data: [{file: a.parquet, sha256: SHA}]
"""


@pytest.fixture
def stand_in(monkeypatch):
    """The arguments that the stand-in received; `answer` is what it returns or raises."""
    seen = types.SimpleNamespace(answer=diagnosed.diagnosis())

    def diagnose(experiments, drive, free, options, holdout, start_values, own):
        assert own == ()
        seen.experiments, seen.drive, seen.free = experiments, drive, free
        seen.options, seen.holdout, seen.start_values = options, holdout, start_values
        if isinstance(seen.answer, Exception):
            raise seen.answer
        data = tuple((e.name, e.sha256) for e in experiments)
        return seen.answer.replace(estimate=replace(seen.answer.estimate, data=data))

    monkeypatch.setattr("drivetool.check.diagnose", diagnose)
    return seen


@pytest.fixture
def folder(here):
    """A working folder with three recordings and a base that was fitted to the first."""
    import hashlib

    for k, name in enumerate("abc"):
        t = np.arange(500) * 1e-3
        columns = [t, np.sign(np.sin(20 * t)), np.cos(20 * t + k)]
        fields = [pa.field(n, pa.float64(), metadata={"unit": u})
                  for n, u in (("time", "s"), ("motor_torque", "Nm"), ("motor_speed", "rad/s"))]
        pq.write_table(pa.table(columns, schema=pa.schema(fields)), f"{name}.parquet")
    sha = hashlib.sha256(Path("a.parquet").read_bytes()).hexdigest()
    Path("base.yaml").write_text(FITTED.replace("SHA", sha))
    return here


WORDS = ["diagnose", "a.parquet", "-p", "base.yaml"]


def test_the_statistics_get_what_was_given(folder, stand_in, call):
    code, out, err = call(*WORDS, "--holdout", "b.parquet", "--holdout", "c.parquet", "--candidates",
                          "backlash, dead-time", "--error-budget", "0.05", "--rounds", 2, "--seed", 7)
    assert code == 0 and "drivetool diagnose: The simulation errs because of backlash" in err
    assert [e.name for e in stand_in.experiments] == ["a.parquet"]
    assert [e.name for e in stand_in.holdout] == ["b.parquet", "c.parquet"]
    assert stand_in.options == DiagnoseOptions(("backlash", "dead-time"), 0.05, 2, 7)
    assert stand_in.drive.values["load.inertia"] == pytest.approx(5.179)
    assert stand_in.free == ["motor.inertia", "load.inertia"]
    assert stand_in.start_values == pytest.approx({"load.inertia": 6.0})
    content = yaml.safe_load(out)
    assert content["step"] == "diagnose" and content["diagnosis"]["causes"] == ["backlash"]
    assert [entry["file"] for entry in content["options"]["holdout"]] == ["b.parquet", "c.parquet"]
    assert [f["code"] for f in content["findings"]] == ["diagnosis-named"]
    assert call(*WORDS)[0] == 0 and stand_in.holdout == () and stand_in.options.candidates == ()


def test_conditioning_reaches_all_recordings_and_is_noted(folder, stand_in, call):
    code, out, err = call(*WORDS, "--holdout", "b.parquet", "--condition", "decimate factor=2")
    assert code == 0, err
    assert [len(e.time) for e in (*stand_in.experiments, *stand_in.holdout)] == [250, 250]
    content = yaml.safe_load(out)
    assert content["options"]["condition"] == ["decimate factor=2"]
    assert sum(f["code"] == "conditioned" for f in content["findings"]) == 2


def test_the_file_is_one_that_every_step_takes(folder, stand_in, call, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert call(*WORDS, "-o", "x.yaml")[0] == 0
    content = yaml.safe_load(Path("x.yaml").read_text())
    jsonschema.validate(content, json.loads(schema.schemas()["parameters.json"]))
    section = content["diagnosis"]
    assert section["verdict"] == "named" and section["gain"]["held_out_rmse_after"] == 0.0211
    gap = section["candidates"][0]
    assert gap["smallest"] == {"shaft.half_gap": {"value": 1e-4, "unit": "rad"}} and gap["shown"] is True
    assert gap["parameters"]["shaft.half_gap"]["ci95"] == [0.00318, 0.00326]
    table = {(c["round"], c["code"]): c["shown"] for c in section["candidates"]}
    assert table[1, "imbalance"] is False and table[1, "third-mass"] is None and (2, "dead-time") in table
    assert [(r["round"], r["cause"]) for r in section["rounds"]] == [(1, "backlash"), (2, None)]
    assert content["parameters"]["shaft.half_gap"]["value"] == 0.00322
    # the next steps
    assert call("simulate", "b.parquet", "-p", "x.yaml", "-o", "s.parquet")[0] == 0
    assert call("validate", "b.parquet", "-p", "x.yaml", "-o", "v.yaml", "-q")[0] in (0, 3)
    assert call("diagnose", "b.parquet", "-p", "x.yaml", "-q")[0] == 0
    assert stand_in.drive.values["shaft.half_gap"] == 0.00322
    code, out, _ = call("show", "x.yaml")
    assert code == 0 and "Cause found" in out and "1234 +- 41" in out and "shaft.half_gap" in out
    assert max(map(len, out.splitlines())) <= 80


def test_json_and_table_and_the_same_bytes(folder, stand_in, call):
    first = call(*WORDS, "--json", "-q")[1]
    assert json.loads(first) == yaml.safe_load(call(*WORDS, "-q")[1])
    assert call(*WORDS, "--json", "-q")[1] == first and str(folder) not in first
    table = call(*WORDS, "-q", terminal=True)[1]
    assert "round 1: added backlash" in table and "as good as" not in table and "schema:" not in table


def test_the_base_is_refused_or_suspect(folder, stand_in, call):
    held = FITTED.replace("status: fitted", "status: held").replace("SHA", "ab")
    Path("held.yaml").write_text(held)
    code, out, err = call("diagnose", "a.parquet", "-p", "held.yaml")
    assert code == 1 and not out and "wanted a base that was fitted" in err and "Run greybox" in err
    Path("few.yaml").write_text(re.sub(r"  load.*\n", "", FITTED))
    assert "load.inertia for a diagnosis" in call("diagnose", "a.parquet", "-p", "few.yaml")[2]
    code, out, err = call("diagnose", "b.parquet", "-p", "base.yaml", "-o", "x.yaml")
    assert code == 0 and "warning biased-base" in err and "b.parquet" in err
    assert call("diagnose", "b.parquet", "-p", "base.yaml", "-o", "x.yaml", "--strict")[0] == 3
    code, _, err = call("diagnose", "b.parquet", "-p", "base.yaml", "--holdout", "a.parquet")
    assert code == 0 and "warning not-held-out" in err
    Path("late.yaml").write_text(Path("base.yaml").read_text() + """
findings:
- {severity: warning, code: torque-shifted, text: It is late., evidence: {shift: -0.001}, action: Write it.}
""")
    code, out, err = call("diagnose", "a.parquet", "-p", "late.yaml")
    found, = [f for f in yaml.safe_load(out)["findings"] if f["code"] == "biased-base"]
    assert code == 0 and found["text"].startswith("It is late.") and found["action"] == "First: Write it."


@pytest.mark.parametrize("words, code, message", [
    (["--holdout", "a.parquet"], 2, "a.parquet, which is also a training recording"),
    (["--holdout", "copy.parquet"], 2, "the same recording as a.parquet"),
    (["--holdout", "none.parquet"], 1, "no file none.parquet"),
    (["--candidates", "baklash"], 2, "Did you mean 'backlash'?"),
    (["--candidates", ","], 2, "at least one cause"),
    (["--error-budget", "2"], 2, "--error-budget"),
    (["--report", "a.parquet/r.html"], 2, "a.parquet, which is no folder"),
    (["--report", "a.parquet"], 2, "inputs are never changed"),
    (["--report", "x.html", "--out", "./x.html"], 2, "two files for --out and --report"),
    (["--out", "copy.parquet", "--holdout", "copy.parquet"], 2, "inputs are never changed"),
])
def test_wrong_words_write_nothing(folder, stand_in, call, words, code, message):
    Path("copy.parquet").write_bytes(Path("a.parquet").read_bytes())
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    found, out, err = call(*WORDS, *words)
    assert found == code and message in out + err and "Traceback" not in err
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_catalogue_restricted_to_nothing(folder, stand_in, call):
    Path("one.yaml").write_text(FITTED.replace("SHA", "ab").replace("parameters:\n", (
        "drive: {name: one-body}\nparameters:\n"), 1).replace("  load", "  #").replace("  shaft", "  #"))
    code, _, err = call("diagnose", "a.parquet", "-p", "one.yaml", "--candidates", "backlash,third-mass")
    assert code == 2 and "backlash, third-mass, which the one-body drive cannot have" in err
    assert call("diagnose", "a.parquet", "-p", "one.yaml", "--candidates", "backlash,dead-time")[0] == 0
    assert stand_in.options.candidates == ("dead-time",)


def test_failures_of_the_statistics(folder, stand_in, call):
    stand_in.answer = NotEnoughData("at least 4 s to split", "0.5 s", "Record longer.")
    code, out, err = call(*WORDS, "--plot", "p", "--report", "r.html", "-o", "x.yaml")
    assert code == 1 and out == "" and "at least 4 s to split" in err
    assert [path.name for path in Path("p").iterdir()] == ["diagnose-a-recording.png"]
    assert not Path("x.yaml").exists() and not Path("r.html").exists()


@pytest.mark.parametrize("finding, code", [("diagnosis-nothing-found", 0), ("diagnosis-named", 0),
                                           ("diagnosis-undetermined", 3), ("diagnosis-unexplained", 3)])
def test_what_is_found_is_no_failure(folder, stand_in, call, finding, code):
    verdict = finding.removeprefix("diagnosis-")
    findings = (Finding("note", "torque-source", "It is."),)
    made = diagnosed.diagnosis(verdict=verdict, between=("backlash", "dead-time"), experiment="Load it more.")
    stand_in.answer = made.replace(estimate=replace(made.estimate, findings=findings))
    assert call(*WORDS, "-o", "x.yaml")[0] == 0
    found, _, err = call(*WORDS, "-o", "x.yaml", "--strict")
    assert found == code and finding in err and "Load it more." in err
    assert "Load it more." in call("show", "x.yaml")[1]


class Page(HTMLParser):
    """Tags, their nesting and the text of a page."""

    EMPTY = ("meta", "br")

    def __init__(self, text):
        super().__init__()
        self.open, self.words, self.tags, self.attributes = [], [], [], []
        self.feed(text)
        assert not self.open, self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, *pair) for pair in attrs]
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, *pair) for pair in attrs]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.words.append(" ".join(data.split()))


def test_the_page_makes_its_folder(folder, stand_in, call):
    assert call(*WORDS, "--report", "new/r.html", "-q")[0] == 0
    assert Path("new/r.html").read_text().startswith("<!")


@pytest.mark.slow
def test_the_page_needs_nothing_else(folder, stand_in, call):
    stand_in.answer = diagnosed.with_pictures(diagnosed.diagnosis())
    code, _, err = call(*WORDS, "-o", "x.yaml", "--report", "r.html")
    text = Path("r.html").read_text()
    page = Page(text)
    assert code == 0 and "wrote r.html" in err and str(folder) not in text
    assert page.tags.count("svg") == page.tags.count("figure") == len(stand_in.answer.exhibits)
    assert page.tags.count("figcaption") == len({e.kind for e in stand_in.answer.exhibits})
    assert not {"script", "link", "img", "iframe", "object"} & set(page.tags)
    targets = [value for _, name, value in page.attributes if name in ("src", "href", "xlink:href")]
    assert all(target.startswith("#") for target in targets) and "@import" not in text
    assert not re.search(r"url\((?!#)", text)
    ids = [value for _, name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    used = {t[1:] for t in targets} | set(re.findall(r"url\(#([^)]+)\)", text))
    assert used and used <= set(ids)
    assert ("meta", "name", "viewport") in page.attributes and "@media print" in text
    words = " ".join(page.words)
    assert "There is play in the drive train" in words and "shaft.half_gap 0.003220 ± 0.000020 rad" in words
    assert "the load does not turn often enough <here> & now" in words and "<here>" not in text
    assert "0.221 → 0.0211 rad/s" in words and "1234 ± 41" in words
    assert "On a further record of this length the error decreases by 0.106 to 0.364 rad/s (95 %)." in words
    assert "0.5870 ± 0.0020" in words and "5.179 ± 0.010" in words  # before, in the drive's unit
    for word in ("nan", "None", "inf ", "/home", "2026"):
        assert word not in words
    Path("r.html").unlink()
    call(*WORDS, "-o", "x.yaml", "--report", "r.html", "-q")
    assert Path("r.html").read_text() == text


def test_pages_of_other_verdicts(folder, stand_in, call):
    made = diagnosed.diagnosis()
    nan = float("nan")
    gain = made.gain.replace(noise_floor=nan, unexplained_percent=nan, rmse_std=nan)
    stand_in.answer = diagnosed.diagnosis(verdict="nothing-found", causes=(), evidence={}, gain=gain,
                                       rounds=made.rounds[1:], sentence="Nothing was found.")
    call(*WORDS, "--report", "r.html", "-q")
    words = " ".join(Page(Path("r.html").read_text()).words)
    assert "No cause of the catalogue" in words and "nan" not in words and "0.02" in words
    between = ("backlash", "hardening-stiffness")
    stand_in.answer = diagnosed.diagnosis(verdict="undetermined", causes=(), between=between,
                                       experiment="Sweep the preload.")
    call(*WORDS, "--report", "r.html", "-q")
    words = " ".join(Page(Path("r.html").read_text()).words)
    assert words.count("one of the possible causes") == 2 and "Sweep the preload." in words
    assert "stiffer the more torque" in words
    known = made.rounds[0].candidates[0].replace(state="in-the-model", gain=None, parameters={})
    later = made.rounds[1].replace(candidates=(known, *made.rounds[1].candidates))
    stand_in.answer = diagnosed.diagnosis(verdict="undetermined", causes=(),
                                          between=("backlash", OUTSIDE_CATALOGUE),
                                          rounds=(made.rounds[0], later))
    call(*WORDS, "--report", "r.html", "-q")
    words = " ".join(Page(Path("r.html").read_text()).words)
    assert words.count("part of the cause, or the whole cause") == 1
    assert "outside the catalogue (one of the possible" in words
    assert "The fit gives shaft.half_gap 0.003220" in words  # by the round that found it
    stand_in.answer = diagnosed.diagnosis(verdict="unexplained", causes=(), closest=("backlash",))
    call(*WORDS, "-o", "x.yaml", "--report", "r.html", "-q")
    words = " ".join(Page(Path("r.html").read_text()).words)
    assert words.count("comes closest") == 1 and "No cause of the catalogue" not in words
    section = yaml.safe_load(Path("x.yaml").read_text())["diagnosis"]
    assert (section["causes"], section["closest"]) == ([], ["backlash"])


def test_nothing_is_left_when_the_page_cannot_be_written(folder, stand_in, call, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(write.os, "fsync", full)
    before = sorted(path.name for path in folder.iterdir())
    code, out, err = call(*WORDS, "-o", "x.yaml", "--report", "r.html")
    assert code == 1 and out == "" and "No space left" in err
    assert sorted(path.name for path in folder.iterdir()) == before


def test_validate_says_when_to_diagnose(folder, call, monkeypatch):
    from drivetool.check.validation import result as validation

    finding = Finding("warning", "residual-depends-on-input", "It does.")

    def validate(experiments, models, options, **_):
        lacks = options.seed == 1
        return validation.Validation((), "passed", (finding,) if lacks else (), unexplained=lacks)

    monkeypatch.setattr("drivetool.check.validation.validate", validate)
    words = ["validate", "a.parquet", "-p", "base.yaml", "-o", "v.yaml"]
    hint = "run diagnose: drivetool diagnose a.parquet --params base.yaml\n"
    assert hint in call(*words)[2] and hint not in call(*words, "--seed", 2)[2]
    assert call(*words, "-q")[2] == ""
