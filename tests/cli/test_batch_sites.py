"""Site files: machines, kinds, earlier files, held-out recordings and limits; one sentence for each error."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from drivetool.files.shapes import BarSection, RecordingsSection
from drivetool.site.plan import Machine, Recording
from drivetool.site.plan.recipe import RecipeStep
from drivetool.site.plan.tasks import TaskBuilder, find_newest_output, holdout_recording
from drivetool.site.results import Entry, StepResult
from drivetool.site.verdicts import evaluate_bars
from tests import sites

STEADY = RecipeStep(name="steady", kind="a", command="steady", words=(), options={})


def machine(*kinds):
    """A machine whose recordings are of these kinds, in this order."""
    return Machine("press", tuple(
        Recording(f"{i}.parquet", RecordingsSection(files="*", kind=kind), f"sha{i}", None, f"{i}", "m", order=i)
        for i, kind in enumerate(kinds, 1)))


def test_a_recording_takes_the_newest_file_before_it_else_the_first_after():
    press = machine("a", "b", "a", "b", "a")
    have = {("steady", "press", f"{i}.parquet"): {"sha256": f"file{i}"} for i in (3, 5)}
    assert [find_newest_output(have, STEADY, press, order)["sha256"] for order in range(1, 6)] == [
        "file3", "file3", "file3", "file3", "file5"]
    assert find_newest_output({}, STEADY, press, 1) is None
    joint = STEADY.replace(joint=True)
    have = {("steady", "press", ""): {"sha256": "all"}}
    assert find_newest_output(have, joint, press, 1)["sha256"] == "all"


def test_which_recording_judges_another():
    press = machine("a", "b", "a", "b")
    first, second, third, fourth = press.recordings

    def judges(word):
        return [holdout_recording(word, press, r) for r in press.recordings]

    assert judges("next") == [third, fourth, first, second]
    assert judges("previous") == [third, fourth, first, second]
    assert judges("b") == [second, fourth, second, second]
    alone = machine("a", "b")
    assert holdout_recording("next", alone, alone.recordings[0]) is None
    copy = replace(third, sha256=first.sha256)
    twins = Machine("press", (first, copy))
    assert holdout_recording("next", twins, first) is None


@pytest.mark.parametrize("command, words", [
    ("validate", ["validate", "--segment", "1", "--params", "out/1/steady.yaml", "--", "3.parquet"]),
    ("diagnose", ["diagnose", "--segment", "1", "--params", "out/1/steady.yaml", "--holdout", "3.parquet",
                  "--", "1.parquet"])])
def test_the_words_of_a_step_that_another_recording_judges(command, words):
    step = RecipeStep(name="judged", kind="a", command=command, words=("--segment", "1"), params=("steady",),
                      judge="next", options={})
    have = {("steady", "m", "1.parquet"): {"output": "1/steady.yaml", "sha256": "file", "content": "made of"}}
    maker = TaskBuilder("out", {"steady": STEADY}, {}, have)
    press = replace(machine("a", "b", "a"), name="m")
    task = maker.tasks(step, press)[0]
    assert task.words == words and task.output == "1/judged.yaml"
    assert task.inputs["recordings"] == (["sha3"] if command == "validate" else ["sha1", "sha3"])
    assert (task.inputs["params"], task.origins) == ([["steady.yaml", "file"]], ["made of"])
    joint = maker.tasks(step.replace(joint=True, judge=None), press)
    assert [t.words[-3:] for t in joint] == [["--", "1.parquet", "3.parquet"]]


def test_bars():
    verdict = StepResult((("shaft.half_gap", 0.004, "rad", None, None, None, "fitted"),
                 ("motor.coulomb", None, "Nm", None, None, None, "not-identifiable")),
                {"simulation_fit_percent": 91.0}, None, True,
                (("warning", "w", "A warning."), ("note", "n", "A note.")))
    entries = [Entry("a", "press", "k", None, 1, "greybox", verdict),
               Entry("b", "press", "k", None, 2, "greybox", None, "no")]

    def text(**limits):
        return {(c.recording, c.name): c.text for c in evaluate_bars(entries, [BarSection(**limits)])
                if "runs" not in c.name}

    from drivetool.files.shapes import MeasureSection

    name = "shaft.half_gap at most 5 mrad"
    assert text(figure="shaft.half_gap", at_most=MeasureSection(value=5, unit="mrad")) == {("a", name): ""}
    missed = text(figure="shaft.half_gap", at_most=MeasureSection(value=3, unit="mrad"))
    assert "found 0.004 rad in the file of greybox" in missed["a", "shaft.half_gap at most 3 mrad"]
    assert text(figure="simulation_fit_percent", at_least=90.0) == {("a", "simulation_fit_percent at least 90"): ""}
    assert "found no value" in text(figure="motor.coulomb", at_most=1.0)["a", "motor.coulomb at most 1"]
    alone = text(figure="shaft.half_gap", at_most=5.0)["a", "shaft.half_gap at most 5"]  # 5 mrad, meant one
    assert alone == ("wanted a unit with shaft.half_gap at most 5, a figure in rad; found none. Write it as in "
                     "'{value: 5, unit: rad}'.")
    nowhere = text(figure="shaft.gap", at_most=1.0)
    assert "available: motor.coulomb, shaft.half_gap" in nowhere["", "shaft.gap at most 1"]
    assert "A warning." in text(findings="no-warning")["a", "no findings of severity failure or warning"]
    assert text(findings="no-failure") == {("a", "no findings of severity failure"): ""}
    none = evaluate_bars([entries[1]], [BarSection(findings="no-failure")])[-1]
    assert none.text == ("wanted no findings of severity failure; found no file of any step. See the problems in "
                         "the summary.")
    ran = {c.recording: (c.passed, c.text, c.warnings) for c in evaluate_bars(entries, [])
           if c.name == "greybox runs"}
    assert ran == {"a": (True, "", ("w: A warning.",)), "b": (False, "no", ())}


@pytest.mark.slow
def test_machines_by_name_metadata_and_files_beside_the_site_file(here, call):
    sites.write("flat/press3_01.parquet", 1)
    sites.write("noted/a.parquet", 2, metadata={"serial": "S 7/2"})
    sites.write("noted/b.parquet", 3)
    sites.write_with_clock("noted/c.mcap", 4, 1_717_200_000_000_000_000, {"serial": "M1"})
    sites.write("here.parquet", 5)
    sites.write_site(here, [
        {"files": "flat/*", "machine": {"file": "{machine}_*.parquet"}}, {"files": "*.parquet"},
        {"files": "noted/*", "machine": {"metadata": "serial"}}],
        [*sites.RECIPE, {"command": "steady --drive one-body", "name": "all", "joint": True}])
    code, _, err = call("batch", "site.yaml")
    assert code == 3
    rows = sites.table("site-results")
    found = {r["recording"]: r["machine"] for r in rows if r["step"] == "steady" or r["problem"]}
    assert found == {"flat/press3_01.parquet": "press3", "here.parquet": "machine", "noted/a.parquet": "S 7/2",
                     "noted/b.parquet": "", "noted/c.mcap": "M1"}
    assert "wanted the metadata 'serial' to name the machine of noted/b.parquet; found only nothing there" in err
    assert Path("site-results/S 7_2/all.yaml").exists()
    assert {(r["recording"], r["order"]) for r in rows if r["step"] == "all" and not r["problem"]} == {("", 0)}


@pytest.mark.slow
def test_a_machine_whose_earlier_step_failed_or_that_has_no_judge(here, call):
    for name in ("press1/01", "press1/02", "press2/01"):
        sites.write(f"logs/{name}.parquet", hash(name) % 97)
    Path("logs/press2/01.parquet").write_bytes(b"nothing")
    sites.write("logs/press3/01.parquet", 5)
    sites.write_site(here, recipe=[
        *sites.RECIPE, {"command": "steady --drive one-body", "name": "then", "params": ["steady"]},
        {"command": "validate --criterion inverse", "params": ["then"], "judge": "next"}])
    code, _, _ = call("batch", "site.yaml", "--quiet")
    assert code == 3
    problems = {(r["recording"], r["step"]): r["problem"] for r in sites.table("site-results") if r["problem"]}
    assert problems["logs/press2/01.parquet", "then"].startswith(
        "wanted a file of steady for press2; found none, because no recording of the machine produced one.")
    assert problems["logs/press3/01.parquet", "validate"] == (
        "wanted another recording of press3 to validate the fit of logs/press3/01.parquet; found none. Add one to "
        "the machine, or change judge in the recipe.")
    content = yaml.safe_load(Path("site-results/logs/press1/01/then.yaml").read_text())
    assert [entry["file"] for entry in content["inputs"]] == ["steady.yaml"]
    judged = Path("site-results/logs/press1/01/validate.yaml")
    assert not judged.exists() or "logs/press1/02.parquet" in judged.read_text()


WRONG = {
    "no schema": ({"schema": "drivetool/sites/1"}, ["schema drivetool/site/1", "drivetool init"]),
    "unknown key": ({"recordings": [{"file": "*"}]}, ["'file' in site.yaml", "Did you mean 'files'?"]),
    "unknown key of machine": ({"recordings": [{"files": "*", "machine": {"folders": 1}}]},
                               ["recordings[0].machine", "Did you mean 'folder'?"]),
    "two ways to identify a machine": ({"recordings": [{"files": "*", "machine": {"folder": 1, "metadata": "x"}}]},
                                   ["one of folder, file and metadata"]),
    "pattern without a machine": ({"recordings": [{"files": "*", "machine": {"file": "x_*"}}]}, ["{machine} once"]),
    "nothing to do": ({"recipe": []}, ["at least one step"]),
    "unknown step": ({"recipe": [{"command": "steddy"}]}, ["'steddy'", "Did you mean 'steady'?"]),
    "a step that a batch does not do": ({"recipe": [{"command": "tune"}]}, ["a step that a batch can do"]),
    "unknown option": ({"recipe": [{"command": "steady --sead 2"}]}, ["--sead", "drivetool steady --help"]),
    "value of an option": ({"recipe": [{"command": "steady --seed x"}]}, ["'steady --seed x'"]),
    "help": ({"recipe": [{"command": "steady --help"}]}, ["'steady --help'", "drivetool steady --help."]),
    "no such parameter file": ({"recipe": [{"command": "steady --params p.yaml"}]},
                               ["to read p.yaml at recipe[0] of site.yaml", "from the folder of the site file"]),
    "a folder of parameters": ({"recipe": [{"command": "steady --params logs"}]}, ["Is a directory"]),
    "no such held out recording": ({"recipe": [
        {"command": "steady"}, {"command": "diagnose --holdout h.parquet", "params": ["steady"]}]},
                                   ["to read h.parquet at recipe[1]"]),
    "a map that is none": ({"recordings": [{"files": "logs/*/*.parquet", "map": "site.yaml"}]},
                           ["a known key in site.yaml"]),
    "a map of a command that is none": ({"recipe": [{"command": "steady --map site.yaml"}]},
                                        ["a known key in site.yaml"]),
    "name of a step": ({"recipe": [{"command": "steady", "name": "a/b"}]},
                       ["a word of letters, digits, dots, - and _ at recipe[0].name", "'a/b'"]),
    "no such map of a command": ({"recipe": [{"command": "steady --map m.yaml"}]}, ["to read m.yaml at recipe[0]"]),
    "an output": ({"recipe": [{"command": "steady --out x"}]}, ["no --out at recipe[0]"]),
    "a recording": ({"recipe": [{"command": "steady a.parquet"}]}, ["'a.parquet' in it"]),
    "open quotation": ({"recipe": [{"command": "steady --set 'x"}]}, ["Close the quotation mark"]),
    "later step": ({"recipe": [{"command": "steady", "params": ["greybox"]}]},
                   ["'greybox'", "No step comes before"]),
    "unknown earlier step": ({"recipe": [{"command": "steady"}, {"command": "greybox", "params": ["stedy"]}]},
                             ["Did you mean 'steady'?"]),
    "unknown kind": ({"recipe": [{"command": "steady", "kind": "recordin"}]}, ["Did you mean 'recording'?"]),
    "one name twice": ({"recipe": [{"command": "steady"}, {"command": "steady"}]}, ["'steady' twice"]),
    "a judge of a fit": ({"recipe": [{"command": "steady", "judge": "next"}]}, ["judge with validate or diagnose"]),
    "unknown judge": ({"recipe": [
        {"command": "steady"}, {"command": "validate", "params": ["steady"], "judge": "nex"}]},
                      ["Did you mean 'next'?"]),
    "limit without a value": ({"bars": [{"figure": "x"}]}, ["one of at_most and at_least at bars[0]"]),
    "limit without a name": ({"bars": [{"figure": "", "at_most": 1}]}, ["either figure or findings"]),
    "limit that is no number": ({"bars": [{"figure": "x", "at_most": float("nan")}]},
                                ["a finite number of at_most"]),
    "limit on two things": ({"bars": [{"figure": "x", "at_most": 1, "findings": "no-failure"}]},
                          ["either figure or findings"]),
    "unit of a limit": ({"bars": [{"figure": "x", "at_most": {"value": 1, "unit": "mrd"}}]}, ["'mrd'"]),
    "step of a limit": ({"bars": [{"figure": "x", "at_most": 1, "step": "stead"}]}, ["Did you mean 'steady'?"]),
    "nothing matches": ({"recordings": [{"files": "log/*.parquet"}]},
                        ["that match 'log/*.parquet'", "counts from the folder"]),
    "no such map": ({"recordings": [{"files": "logs/*/*.parquet", "map": "m.yaml"}]},
                    ["to read the channel map m.yaml"]),
    "no recordings": ({"recordings": []}, ["recordings in the site file"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_one_sentence_before_anything_runs(here, call, case):
    changes, words = WRONG[case]
    sites.write("logs/press/01.parquet", 1)
    content = yaml.safe_load(sites.write_site(here).read_text())
    Path("site.yaml").write_text(yaml.safe_dump(content | changes))
    code, out, err = call("batch", "site.yaml")
    assert code in (1, 2) and out == "" and err.count("\n") == 1, err
    assert all(word in err for word in words), err
    assert not Path("site-results").exists()


def test_what_changed_is_said_on_the_page_and_its_machine_comes_first(here, call):
    """The friction of the second press steps by far; of a recording of the first the torque is doubled."""
    for machine, steps in (("press1", False), ("press2", True)):
        for k in range(9):
            scale = 2.0 if (machine, k) == ("press1", 3) else 1.0
            coulomb = scale * (0.4 if steps and k > 5 else 0.3)
            sites.write(f"logs/{machine}/{k}.parquet", 10 * steps + k, coulomb=coulomb, viscous=scale * 0.05)
    sites.write_site(here)
    code, _, err = call("batch", "site.yaml")
    page = (here / "site-results/index.html").read_text()
    assert code == 0 and page.index("<td>press2</td>") < page.index("<td>press1</td>")
    assert "Motor Coulomb friction of press2 grew from 0.3" in page and "trends.yaml" in page
    assert "logs/press1/3.parquet is an outlier: " in page
    assert "warning: logs/press1/3.parquet is an outlier: " in err
