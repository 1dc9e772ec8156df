"""What the pages give a user to build a site with: make rules, a Snakemake stage, files for two CI servers."""

import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from drivetool.logs.formats import read_summary
from tests.places import FIXTURES, RIG, ROOT
from tests.summaries import site_of_the_pages

DOCS = ROOT / "docs"
MAKEFILE = """SITE := $(wildcard site/*/*.steps.parquet)
all: $(SITE:.steps.parquet=.validate.yaml) $(SITE:.steps.parquet=.diagnose.yaml)
include site.mk
"""
STEPS = ("steady", "blackbox", "greybox", "validate", "diagnose")
RECORDINGS = 9  # of each press
SITE = """schema: drivetool/site/1
recordings:
- files: logs/*/*.parquet
recipe:
- command: steady --drive one-body
bars:
- figure: motor.coulomb
  at_most: {value: 0.33, unit: Nm}
"""


def on_the_path(folder):
    """An environment in which `drivetool` is this one, and `pip` installs nothing."""
    (folder / "bin").mkdir(exist_ok=True)
    for name, line in (("drivetool", f'exec "{sys.executable}" -m drivetool "$@"'), ("pip", "exit 0")):
        (folder / "bin" / name).write_text(f"#!/bin/sh\n{line}\n")
        (folder / "bin" / name).chmod(0o755)
    more = {"PATH": folder / "bin", "PYTHONPATH": ROOT}
    return {**os.environ, **{name: os.pathsep.join([str(place), os.environ.get(name, "")])
                             for name, place in more.items()}}


def sh(folder, command, env):
    env = {name: value for name, value in env.items() if not name.startswith("MAKE")}  # as from no other make
    return subprocess.run(["bash", "-c", command], cwd=folder, env=env, capture_output=True, text=True, timeout=900)


@pytest.fixture
def presses(tmp_path):
    """A folder with site.mk, a Makefile and the recordings of two presses."""
    shutil.copy(DOCS / "site.mk", tmp_path)
    (tmp_path / "Makefile").write_text(MAKEFILE)
    for machine in ("press1", "press2"):
        (tmp_path / "site" / machine).mkdir(parents=True)
        for kind, name in (("steady", "steady"), ("steps", "steps"), ("holdout", "steps_holdout")):
            shutil.copy(RIG / f"{name}.parquet", tmp_path / "site" / machine / f"may-1.{kind}.parquet")
    return tmp_path


needs_make = pytest.mark.skipif(not shutil.which("make"), reason="make is not installed")


@needs_make
def test_the_rules_lead_from_recordings_to_verdicts_in_their_order(presses):
    done = sh(presses, "make -n", on_the_path(presses))
    assert done.returncode == 0 and not done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    assert sorted(line[1] for line in lines) == sorted(2 * STEPS)
    first = [line[1] for line in lines if "site/press1/may-1" in line[2]]
    assert first[:3] == list(STEPS[:3]) and set(first[3:]) == set(STEPS[3:])
    assert "--set motor.inertia=1" in sh(
        presses, "make -n GREYBOX_OPTIONS='--set motor.inertia=1'", on_the_path(presses)).stdout


@needs_make
@pytest.mark.slow
def test_make_does_two_at_a_time_and_nothing_twice(presses):
    env = on_the_path(presses)
    done = sh(presses, "make -j2 site/press1/may-1.validate.yaml site/press1/may-1.diagnose.yaml "
                       "site/press2/may-1.steady.yaml", env)
    assert done.returncode == 0, done.stderr
    assert "up to date" in sh(presses, "make site/press2/may-1.steady.yaml", env).stdout
    folder = presses / "site" / "press1"
    assert {yaml.safe_load((folder / f"may-1.{name}.yaml").read_text())["step"] for name in STEPS} == set(STEPS)
    assert yaml.safe_load((folder / "may-1.validate.yaml").read_text())["passed"]
    again = (presses / "site" / "press2" / "may-1.steady.yaml").read_bytes()
    assert again.replace(b"press2", b"press1") == (folder / "may-1.steady.yaml").read_bytes()


@pytest.mark.skipif(not shutil.which("snakemake"), reason="snakemake is not installed")
def test_the_stage_runs_in_snakemake(presses):
    shutil.copy(DOCS / "site.smk", presses)
    done = sh(presses, "snakemake --snakefile site.smk --cores 2", on_the_path(presses))
    assert done.returncode == 0, done.stderr
    for machine in ("press1", "press2"):
        file = yaml.safe_load((presses / "site" / machine / "may-1.steady.yaml").read_text())
        assert file["step"] == "steady" and file["parameters"]["total.viscous"]["std"] > 0.0


def recordings(folder, worn):
    """Both directions at two speeds of two presses; the second has more friction from the seventh recording on."""
    for machine in ("press1", "press2"):
        (folder / "logs" / machine).mkdir(parents=True)
        for i in range(RECORDINGS):
            rng = np.random.default_rng([i, machine == "press2"])
            speed = np.repeat([10.0, -10.0, 30.0, -30.0], 1000)
            coulomb = 0.3 + 0.003 * rng.normal() + (0.05 if worn and machine == "press2" and i >= 6 else 0.0)
            torque = 0.05 * speed + coulomb * np.sign(speed) + 0.01 * rng.normal(size=4000)
            units = {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s"}
            columns = [np.arange(4000) * 0.002, torque, speed + 0.01 * rng.normal(size=4000)]
            schema = pa.schema([pa.field(n, pa.float64(), metadata={"unit": u}) for n, u in units.items()])
            pq.write_table(pa.table(columns, schema=schema), folder / "logs" / machine / f"{i:02d}.parquet")
    (folder / "site.yaml").write_text(SITE)


def github_steps():
    """The shell parts of the job, and whether each runs after a failure."""
    job = yaml.safe_load((DOCS / "ci" / "github.yml").read_text())["jobs"]["site"]
    return [(step["run"], "cancelled" in step.get("if", "")) for step in job["steps"] if "run" in step]


def test_github_keeps_what_is_done_of_a_job_that_fails():
    """actions/cache saves after success only."""
    job = yaml.safe_load((DOCS / "ci" / "github.yml").read_text())["jobs"]["site"]
    caches = {step["uses"]: step for step in job["steps"] if "actions/cache" in step.get("uses", "")}
    assert [name.partition("@")[0] for name in caches] == ["actions/cache/restore", "actions/cache/save"]
    restored, saved = caches.values()
    assert saved["if"] == "${{ always() }}"
    assert all(saved["with"][key] == restored["with"][key] for key in ("path", "key"))


@pytest.mark.slow
@pytest.mark.parametrize("worn", [False, True])
def test_the_shell_parts_for_github_run(tmp_path, worn):
    recordings(tmp_path, worn)
    env = on_the_path(tmp_path) | {"GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md")}
    codes = []
    for command, always in github_steps():
        if always or not any(codes):
            done = sh(tmp_path, f"set -eo pipefail\n{command}", env)
            codes.append(done.returncode)
            assert "Traceback" not in done.stderr
    assert codes == ([0, 3, 3, 0] if worn else [0, 0, 0, 0])
    judged(tmp_path, worn)
    assert (tmp_path / "summary.md").read_text().startswith("# drivetool: ")


@pytest.mark.slow
def test_the_shell_parts_for_gitlab_run(tmp_path):
    recordings(tmp_path, worn=True)
    job = yaml.safe_load((DOCS / "ci" / "gitlab-ci.yml").read_text())["drives"]
    script = "\n".join(["set -eo pipefail", *job["before_script"], *job["script"]])
    done = sh(tmp_path, script, on_the_path(tmp_path))
    assert done.returncode == 3, done.stderr
    judged(tmp_path, worn=True)


def judged(folder, worn):
    """The verdict and the trends of a site whose second press has worn, or has not."""
    text = (folder / "verdict.xml").read_text()
    assert len(re.findall("<failure ", text)) == (3 if worn else 0) and text.count("<testsuite ") == 2
    file = yaml.safe_load((folder / "trends.yaml").read_text())
    alarms = [f["text"] for f in file["findings"] if f["code"] == "trend-alarm"]
    assert len(alarms) == (1 if worn else 0) and all("Coulomb friction of press2 grew from" in t for t in alarms)


def test_every_artifact_is_one_that_a_command_writes():
    """GitHub and GitLab collect what the lines above them name."""
    for name in ("github.yml", "gitlab-ci.yml"):
        text = (DOCS / "ci" / name).read_text()
        for path in ("verdict.xml", "trends.yaml", "site-results", "trends"):
            assert text.count(path) >= 2, (name, path)


def test_the_summary_of_the_pages_is_as_it_is_made():
    assert read_summary(FIXTURES / "site" / "summary.parquet") == site_of_the_pages()
