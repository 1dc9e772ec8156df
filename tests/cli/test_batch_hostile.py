"""drivetool batch where names, files and folders are not as one would like them, or change meanwhile."""

import json
import os
import shutil
from pathlib import Path

import pytest

from drivetool.cli.command_line import parsed
from drivetool.errors import BadOption, BadParameters
from drivetool.files.shapes import RecordingsSection
from drivetool.site import batch as site
from drivetool.site.plan import (
    Machine,
    Recording,
    RunOptions,
    find_recordings,
    load_site,
    machines_of,
    retry_reasons,
    schedule,
    steps_of,
)
from drivetool.site.plan.recipe import RecipeStep
from drivetool.site.plan.tasks import TaskBuilder
from drivetool.site.pool.worker import run_task
from drivetool.site.results import MANIFEST_FILE, Manifest, open_manifest, read_manifest
from drivetool.site.site_run import run_site
from tests import sites


def recording(path, **more):
    section = RecordingsSection(files="*", machine=more.pop("machine", None), map=more.get("map_sha256"))
    return Recording(path, section, more.pop("sha256", path), more.pop("map_sha256", None), path, **more)


def test_a_link_back_does_not_multiply_recordings_and_another_link_counts(here):
    sites.small(here)
    shutil.move("logs/press2", "log")  # the beginning of the other name
    os.symlink("../log", "logs/press2")
    os.symlink("..", "logs/press1/back")
    paths = [r.path for r in find_recordings(load_site("site.yaml"), here, here / "out")]
    assert paths == [f"logs/press{i}/0{k}.parquet" for i in (1, 2) for k in (1, 2)]


def test_a_name_with_signs_of_a_pattern_stands_for_itself(here):
    for name in "a[1]", "a1", "b":
        sites.write(f"{name}.parquet", 1)
    sites.write_site(here, [{"files": "a[1].parquet"}])
    assert [r.path for r in find_recordings(load_site("site.yaml"), here, here / "out")] == ["a[1].parquet"]
    with pytest.raises(BadParameters, match="but in that of the results"):
        find_recordings(load_site("site.yaml"), here, here)


def test_no_folder_takes_the_place_of_a_file_of_the_site(here):
    sites.write("index.html.parquet", 1)
    sites.write("a.html.parquet", 1)
    sites.write_site(here, [{"files": "*.parquet"}])
    assert [r.folder for r in find_recordings(load_site("site.yaml"), here, here / "out")] == ["a.html",
                                                                                               "index.html.parquet"]


def test_a_name_that_no_library_reads_spoils_no_recording_of_equal_content(here, call):
    """One name begins with a dash, one is no text, and one is that of another format."""
    for name in "b/01.parquet", "b/02.parquet", "-c.parquet", "d/0.mcap":
        sites.write(name, 1)
    Path("a").mkdir()
    shutil.copy("b/01.parquet", os.fsdecode(b"a/w\xe4rme.parquet"))
    sites.write_site(here, [{"files": "**/*.*"}])
    code, out, err = call("batch", "site.yaml", "--explain", "--workers", "1")
    assert code == 3 and "5 results, 3 of them run now, 2 with a problem" in err
    assert "steady of a/w\\udce4rme.parquet: it has not been run" in out
    assert [r["recording"] for r in sites.table("site-results") if r["problem"]] == [
        "a/w\\udce4rme.parquet", "d/0.mcap"]
    code, _, err = call("batch", "site.yaml", "--verify")
    assert code == 3 and "all 5 results are current" in err
    assert "2 of them run now, 2 with a problem" in call("batch", "site.yaml", "--retry")[2]


def test_a_recording_that_is_gone_meanwhile_is_done_once_it_is_back(here, call, monkeypatch):
    sites.small(here, count=1)

    def found(*words):
        recordings = find_recordings(*words)
        os.rename("logs/press1/01.parquet", "kept")
        return recordings

    with monkeypatch.context() as patch:
        patch.setattr(site, "find_recordings", found)
        assert call("batch", "site.yaml")[0] == 3
    os.rename("kept", "logs/press1/01.parquet")
    assert "its recording was missing or changed during the last run" in call("batch", "site.yaml", "--verify")[1]
    code, _, err = call("batch", "site.yaml")
    assert code == 0 and "1 of them run now" in err


def test_a_computer_that_does_not_see_the_folder_makes_no_lasting_problem(here):
    answer = run_task({"folder": str(here / "nowhere"), "words": ["steady"]}, "")
    assert retry_reasons({"limit": 0.0, **answer}, {"time": 1.0}, False) == [
        "its recording was missing or changed during the last run"]


def test_a_recording_that_cannot_be_read_is_a_row(here, call):
    if not Path("/proc/self/mem").exists():
        pytest.skip("a file that is there and cannot be read is one of Linux")
    sites.write("logs/press/01.parquet", 1)
    os.symlink("/proc/self/mem", "logs/press/02.parquet")
    sites.write_site(here)
    code, _, err = call("batch", "site.yaml")
    assert code == 3 and "2 results, 2 of them run now, 1 with a problem" in err and "unexpected" not in err


def test_what_a_limit_kept_from_being_seen_is_looked_at_again(here, call):
    sites.write("a.parquet", 1, metadata={"serial": "7"})
    sites.write_site(here, [{"files": "*.parquet", "machine": {"metadata": "serial"}}])
    assert "to name the machine" in call("batch", "site.yaml", "--time-limit", "0.001")[2]
    assert call("batch", "site.yaml", "--time-limit", "0.001", "--verify")[1] == ""
    assert "it has not been looked into" in call("batch", "site.yaml", "--verify")[1]
    assert call("batch", "site.yaml")[0] == 0
    [line] = [line for line in read_manifest(here / "site-results").headers.values()]
    assert (line["metadata"], line["ended"]) == ({"serial": "7"}, None)


def test_verdicts_are_written_by_verify_too_and_nothing_else(here, call, monkeypatch):
    sites.small(here, count=1)
    trend_files = site._trend_files

    def locked(outcome, cases, out, say):
        with pytest.raises(BadOption, match="another batch running"):  # until all files are written
            open_manifest(out)
        return trend_files(outcome, cases, out, say)

    with monkeypatch.context() as patch:
        patch.setattr(site, "_trend_files", locked)
        assert call("batch", "site.yaml", "--junit", "a.xml")[0] == 0
    code, _, err = call("batch", "site.yaml", "--junit", "v", "--markdown", "v")
    assert code == 2 and "different files" in err and not Path("v").exists()
    monkeypatch.setattr(site, "check_folder", None)  # of results that cannot be written to
    code, out, _ = call("batch", "site.yaml", "--verify", "--junit", "new/b.xml", "--markdown", "-")
    assert code == 0 and out.startswith("# drivetool: 2 checks passed")
    assert Path("new/b.xml").read_bytes() == Path("a.xml").read_bytes()
    Path("site-results/trends.yaml").write_bytes(b"\xff")
    assert call("batch", "site.yaml", "--verify")[1] == "trends.yaml: its content differs from the results\n"


@pytest.mark.parametrize("content", [b'{"a": 1}\n{"b"', b"no line end", b'{"schema":"drivetool/manifest/2"}\n'])
def test_a_file_that_is_no_manifest_is_left_alone(tmp_path, content):
    (tmp_path / MANIFEST_FILE).write_bytes(content)
    for reader in read_manifest, open_manifest:
        with pytest.raises(BadOption, match="this version of batch did not write"):
            reader(tmp_path)
    assert (tmp_path / MANIFEST_FILE).read_bytes() == content


def test_lines_that_were_edited_by_hand_are_passed_over(tmp_path):
    manifest = open_manifest(tmp_path)
    look = {"look": "sha", "map": None, "drivetool": "1", "start": None, "metadata": {}, "ended": None, "limit": 0}
    manifest.append(look)
    manifest.close()
    with (tmp_path / MANIFEST_FILE).open("ab") as file:
        file.write(b'garbage\n[1]\n5\n{"output":"a"}\n{"look":"x"}\n\xff\n{"look": "sha", "map"')
    open_manifest(tmp_path).close()
    found = read_manifest(tmp_path)
    assert (found.steps, found.headers) == ({}, {("sha", ""): look})
    assert (tmp_path / MANIFEST_FILE).read_bytes().endswith(b"\xff\n")


def test_names_of_machines_that_are_one_as_a_folder_matter_to_joint_fits_alone():
    found = [recording("a", machine="S 7/2"), recording("b", machine="S 7_2")]
    assert [machine.name for machine in machines_of(found, {}, False)[0]] == ["S 7/2", "S 7_2"]
    with pytest.raises(BadParameters, match="the same folder"):
        machines_of(found, {}, True)


def test_the_order_of_parameter_files_by_hand_is_an_input(here):
    for name in "a", "b":
        Path(f"{name}.yaml").write_text("x")
    sites.write_site(here, recipe=[{"command": "steady --params a.yaml --params b.yaml", "name": "one"},
                                   {"command": "steady --params b.yaml --params a.yaml", "name": "two"}])
    one, two = steps_of(load_site("site.yaml"), here, "site.yaml", parsed)
    assert one.files == two.files and one.options != two.options


def test_a_recording_that_judges_with_another_map_is_no_judge():
    step = RecipeStep(name="diagnose", command="diagnose", params=("steady",), judge="next", words=(), options={})
    steady = step.replace(name="steady", command="steady", params=(), judge=None)
    first, second = recording("a", order=1, map_sha256="m1"), recording("b", order=2, map_sha256="m2")
    maker = TaskBuilder("out", {"steady": steady}, {}, {
        ("steady", "m", "a"): {"output": "a/steady.yaml", "sha256": "file", "content": ""}})
    assert "wanted one channel map for diagnose of a; found 2" in maker.tasks(
        step, Machine("m", (first, second)))[0].problem


def test_ten_times_the_machines_cost_ten_times_the_looks_at_what_can_begin(tmp_path, monkeypatch):
    steps = tuple(RecipeStep(name=name, command="steady", params=params, words=(), options={})
                  for name, params in (("a", ()), ("b", ("a",)), ("c", ("a", "b"))))
    calls = []
    can_begin = schedule.Schedule._can_begin
    monkeypatch.setattr(schedule.Schedule, "_can_begin", lambda self,
                        stage: calls.append(1) or can_begin(self, stage))
    monkeypatch.setattr(schedule, "store_result", lambda task, line, text, out, manifest: manifest.append({
        "output": task.output, "key": "", "content": task.content, "inputs": task.inputs, "sha256": "", **line}))
    monkeypatch.setattr(Manifest, "append", lambda self, line: self._take(json.loads(json.dumps(line))))

    class Executor:
        def serve(self, more):
            given = list(more())
            while given:
                number, task = given.pop(0)
                yield number, {"text": "", "told": {}} if "words" in task else {"start": None}
                given += more()

    machines = 100
    setting = RunOptions(tmp_path, tmp_path / "out", steps, {}, {"drivetool": "1"}, Executor(), lambda text: None)
    outcome = run_site(setting, [recording(f"m{i}/r") for i in range(machines)], Manifest(tmp_path / MANIFEST_FILE))
    assert outcome.run_count == 3 * machines and len(calls) <= 7 * machines
