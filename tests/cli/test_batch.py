"""drivetool batch: the files of the steps by hand, whoever runs them, in whatever order, however often."""

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests import sites

MANY = "drivetool/manifest/1"


def start(*words, folder=".", **more):
    """The command in a process of its own."""
    return subprocess.Popen([sys.executable, "-m", "drivetool", *map(str, words)], cwd=folder, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, **more)


def test_the_files_are_those_of_the_step_by_hand_and_a_second_run_does_nothing(here, call):
    sites.small(here)
    code, out, err = call("batch", "site.yaml", "--workers", "1")
    assert (code, out) == (0, ""), err
    assert "4 recordings; 4 results, 4 of them run now, 0 with a problem; wrote site-results" in err
    assert "ordered by name: machine press1, press2" in err
    for path in sorted(here.glob("logs/*/*.parquet")):
        log = path.relative_to(here)
        call("steady", log, "--drive", "one-body", "--out", "hand.yaml", "--quiet")
        assert (here / "site-results" / log.with_suffix("") / "steady.yaml").read_bytes() == Path(
            "hand.yaml").read_bytes()
    before = {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in here.rglob("*/steady.yaml")}
    manifest, whole = Path("site-results/manifest.jsonl").read_bytes(), sites.compared("site-results")
    code, _, err = call("batch", "site.yaml", "--explain")
    assert code == 0 and "0 of them run now" in err
    assert {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in before} == before
    assert Path("site-results/manifest.jsonl").read_bytes() == manifest
    assert sites.compared("site-results") == whole


@pytest.mark.slow
def test_the_summary_has_a_row_per_recording_step_and_parameter(here, call):
    sites.small(here, count=1)
    sites.write("logs/press1/02.parquet", 7).write_bytes(b"PAR1 cut")
    code, _, err = call("batch", "site.yaml")
    assert code == 3 and "1 with a problem" in err
    rows = sites.table("site-results")
    assert [(r["recording"], r["machine"], r["order"], r["parameter"]) for r in rows] == [
        *(("logs/press1/01.parquet", "press1", 1, f"motor.{n}") for n in ("viscous", "coulomb", "idle_torque")),
        ("logs/press1/02.parquet", "press1", 2, None),
        *(("logs/press2/01.parquet", "press2", 1, f"motor.{n}") for n in ("viscous", "coulomb", "idle_torque"))]
    good, bad = rows[1], rows[3]
    assert abs(good["value"] - 0.3) < 4 * good["std"] and good["ci95_low"] < good["value"] < good["ci95_high"]
    assert (good["unit"], good["status"], good["start"], good["problem"]) == ("Nm", "fitted", None, None)
    assert good["seconds"] > 0 and good["peak_memory_mb"] > 50
    assert bad["problem"].startswith("wanted a Parquet file in logs/press1/02.parquet; found ")
    assert not Path("site-results/logs/press1/02/steady.yaml").exists()
    page = Path("site-results/index.html").read_text()
    assert page.index("press1") < page.index("press2")
    assert 'href="logs/press2/01/steady.yaml"' in page and "1 of 3 checks failed" in page


@pytest.mark.slow
def test_one_worker_and_two_give_the_same_in_any_time_zone_and_locale(here):
    for name, workers, zone, locale in (("a", 1, "UTC", "C"), ("b", 2, "Asia/Kathmandu", "de_DE.UTF-8")):
        sites.small(here / name, count=2)
        sites.write_with_clock(here / name / "logs/press3/01.mcap", 5, 1_717_200_000_000_000_000)
        sites.write_site(here / name, [{"files": "logs/**/*.*"}])
        run = start("batch", "site.yaml", "--workers", workers, folder=here / name,
                    env=os.environ | {"TZ": zone, "LC_ALL": locale})
        _, err = run.communicate()
        assert run.returncode == 0, err
    assert sites.compared("a/site-results") == sites.compared("b/site-results")
    row = next(r for r in sites.table("b/site-results") if r["machine"] == "press3")
    assert row["start"].isoformat() == "2024-06-01T00:00:00+00:00"


def test_killed_at_any_moment_it_goes_on(here):
    for name in "whole", "killed":
        sites.small(here / name, count=2)
        sites.write_site(here / name, recipe=[*sites.RECIPE, {
            "command": "steady --drive one-body --hold motor.viscous", "name": "again", "params": ["steady"]}])
    run = start("batch", "site.yaml", folder=here / "whole")
    assert run.communicate() and run.returncode == 0
    rng, manifest = random.Random(3), here / "killed/site-results/manifest.jsonl"
    for _ in range(3):
        run = start("batch", "site.yaml", "--workers", "2", folder=here / "killed")
        time.sleep(rng.uniform(0.3, 2.5))
        run.send_signal(signal.SIGKILL)
        run.communicate()
        if manifest.exists():
            with manifest.open("ab") as file:  # what a kill in the middle of a line leaves
                file.write(b'{"output":"logs/press1/01/st')
    run = start("batch", "site.yaml", folder=here / "killed")
    _, err = run.communicate()
    assert run.returncode == 0, err
    assert sites.compared(here / "killed/site-results") == sites.compared(here / "whole/site-results")
    assert all(json.loads(line) for line in manifest.read_bytes().splitlines())


@pytest.mark.slow
def test_it_says_what_has_changed(here, call):
    sites.small(here, count=2)
    out = Path("site-results")
    call("batch", "site.yaml")
    sites.write("logs/press1/01.parquet", 55)
    (out / "logs/press1/02/steady.yaml").unlink()
    with (out / "logs/press2/01/steady.yaml").open("a") as file:
        file.write("# by hand\n")
    shutil.move("logs/press2/02.parquet", "logs/press2/03.parquet")
    code, report, _ = call("batch", "site.yaml", "--verify")
    assert code == 3
    _, explained, err = call("batch", "site.yaml", "--explain")
    assert explained.splitlines() == [
        "steady of logs/press1/01.parquet: the content of the recording",
        "steady of logs/press1/02.parquet: its file is missing",
        "steady of logs/press2/01.parquet: its file was changed",
        "steady of logs/press2/03.parquet: it has not been run"]
    assert "logs/press1/01.parquet: it has not been looked into" in report
    assert "3 of them run now" in err  # of equal content as before, the renamed one is not fitted again
    sites.write_site(here, recipe=[{"command": "steady --drive one-body --free motor.drag"}])
    _, explained, _ = call("batch", "site.yaml", "--explain")
    assert explained.count("the option --free") == 4, explained
    assert call("batch", "site.yaml", "--verify")[0] == 0
    Path("site-results/summary.csv").write_text("")
    assert call("batch", "site.yaml", "--verify")[:2] == (3, "summary.csv: its content differs from the results\n")


@pytest.mark.slow
def test_equal_content_in_two_machines_is_fitted_once_and_each_file_is_as_by_hand(here, call):
    sites.write("logs/press1/01.parquet", 1)
    for name in ("press2/01", "press2/02"):
        Path(f"logs/{name}.parquet").parent.mkdir(exist_ok=True)
        shutil.copy("logs/press1/01.parquet", f"logs/{name}.parquet")
    sites.write_site(here, recipe=[{"command": "steady --drive one-body"}, {
        "command": "steady --drive one-body --hold motor.viscous", "name": "again", "params": ["steady"]}])
    code, _, err = call("batch", "site.yaml")
    assert code == 0 and "6 results, 2 of them run now" in err
    assert "steady: 2 of equal content are fitted once and listed under both (logs/press2/01.parquet is " in err
    call("steady", "logs/press2/02.parquet", "--drive", "one-body", "--out", "steady.yaml", "-q")
    call("steady", "logs/press2/02.parquet", "--drive", "one-body", "--hold", "motor.viscous", "--params",
         "steady.yaml", "--out", "again.yaml", "-q")
    for name in ("steady", "again"):
        assert Path(f"{name}.yaml").read_bytes() == Path(f"site-results/logs/press2/02/{name}.yaml").read_bytes()
    assert {r["machine"] for r in sites.table("site-results")} == {"press1", "press2"}


@pytest.mark.slow
def test_a_full_disk_is_one_sentence_and_nothing_is_lost(here):
    sites.small(here)

    def little_room():
        resource.setrlimit(resource.RLIMIT_FSIZE, (5_000, 5_000))

    # Without the measurement of coverage, whose own file would meet the limit, too.
    unmeasured = {name: value for name, value in os.environ.items() if not name.startswith("COVERAGE_")}
    run = start("batch", "site.yaml", "--workers", "1", "--quiet", preexec_fn=little_room, env=unmeasured)
    out, err = run.communicate()
    assert (run.returncode, out) == (1, "")
    assert err.count("\n") == 1 and "error: wanted to write" in err and "completed steps are kept" in err
    lines = Path("site-results/manifest.jsonl").read_bytes().splitlines()
    assert all(json.loads(line) for line in lines) and json.loads(lines[0]) == {"schema": MANY}
    run = start("batch", "site.yaml", "--quiet")
    assert run.communicate() == ("", "") and run.returncode == 0


@pytest.mark.slow
def test_names_that_are_no_text_and_results_of_another_batch(here, call):
    sites.write("logs/press 1/a & <k>.parquet", 1)
    shutil.copy("logs/press 1/a & <k>.parquet", os.fsdecode(b"logs/press 1/w\xe4rme.parquet"))
    sites.write_site(here, [{"files": "**/*.parquet"}])
    assert call("batch", "site.yaml", "--quiet", "--out", "one")[0] in (0, 3)
    assert call("batch", "site.yaml", "--quiet", "--out", "two")[0] in (0, 3)  # the second name may not be read
    assert {r["recording"] for r in sites.table("two")} == {
        "logs/press 1/a & <k>.parquet", "logs/press 1/w\\udce4rme.parquet"}
    page = Path("two/index.html").read_text()
    assert 'href="logs/press%201/a%20%26%20%3Ck%3E/steady.yaml"' in page and "a &amp; &lt;k&gt;.parquet" in page


@pytest.mark.slow
def test_recordings_on_the_command_line_with_a_recipe(here, call):
    sites.small(here, count=1)
    Path("recipe.yaml").write_text("schema: drivetool/site/1\nrecipe: [{kind: steady, command: steady}]\n")
    code, _, err = call("batch", "logs/**/*.parquet", "--recipe", "recipe.yaml", "--out", "found")
    assert code == 0, err
    assert {r["recording"] for r in sites.table("found")} == {"logs/press1/01.parquet", "logs/press2/01.parquet"}
    assert {r["kind"] for r in sites.table("found")} == {"steady"}
    code, _, err = call("batch", "logs/press1/01.parquet")
    assert code == 2 and "recordings with --recipe" in err


def test_one_run_at_a_time(here, call):
    from drivetool.site.results import open_manifest

    sites.small(here, count=1)
    manifest = open_manifest(here / "site-results")
    code, _, err = call("batch", "site.yaml")
    manifest.close()
    assert code == 2 and "another batch running there" in err
