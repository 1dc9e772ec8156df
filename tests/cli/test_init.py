"""drivetool init: a first site file that runs."""

import shutil
from pathlib import Path

import pytest
import yaml

from drivetool.site.plan import find_recordings, load_site
from tests import sites
from tests.places import RIG


@pytest.mark.slow
def test_recordings_of_one_kind(here, call):
    sites.small(here, count=2).unlink()
    code, out, err = call("init", "logs")
    assert (code, out) == (0, "") and "run: drivetool batch site.yaml" in err
    text = Path("site.yaml").read_text()
    assert "seen: press1, press2" in text and "motor_torque [Nm]" in text
    site = load_site("site.yaml")
    assert [(r.files, r.kind) for r in site.recordings] == [("logs/**/*.parquet", "recording")]
    assert [step.command for step in site.recipe] == ["steady"]
    assert call("batch", "site.yaml")[0] == 0
    code, _, err = call("init", "logs")
    assert code == 2 and "a file that is not there yet" in err and Path("site.yaml").read_text() == text


def test_recordings_of_known_kinds_get_the_usual_chain(here, call):
    for press in "press1", "press2":
        Path("logs", press).mkdir(parents=True)
        for name in "steady", "steps", "gap", "gap_holdout":
            shutil.copy(RIG / f"{name}.parquet", f"logs/{press}")
    code, out, err = call("init", "logs", "--out", "-")
    assert code == 0, err
    content = yaml.safe_load(out)
    assert [r["kind"] for r in content["recordings"]] == ["gap_holdout", "steady", "steps", "gap"]
    assert [(s["command"], s.get("params", [])) for s in content["recipe"]] == [
        ("steady", []), ("blackbox", ["steady"]), ("greybox", ["steady", "blackbox"]),
        ("backlash --free all", ["greybox"]), ("validate", ["backlash"])]


def test_channels_without_roles_require_a_map(here, call):
    import pyarrow as pa
    import pyarrow.parquet as pq

    Path("logs/m").mkdir(parents=True)
    pq.write_table(pa.table({"t": [0.0, 0.1], "i act": [1.0, 2.0]}), "logs/m/it's.parquet")
    _, out, _ = call("init", "logs/m", "-o", "-")
    assert yaml.safe_load(out)["recordings"][0]["map"] == "map.yaml" and "i act [?]" in out
    code, _, err = call("init", "nowhere")
    assert code == 2 and "no file or folder nowhere" in err


def test_names_with_signs_capitals_and_words_in_another_order(here, call):
    """Every pattern matches the recordings that it was made of; results of a batch are no recordings."""
    for name in "Steady_1", "steady_2", "holdout_gap", "gap":
        sites.write(f"logs [1]/press/{name}.parquet", 1, metadata={"two\nlines": "x"})
    sites.write("done/summary.parquet", 1)
    Path("done/manifest.jsonl").write_text('{"schema":"drivetool/manifest/1"}\n')
    assert call("init", ".")[0] == 0
    site = load_site("site.yaml")
    assert [(r.kind, r.path.rpartition("/")[2]) for r in find_recordings(site, here, here / "out")] == [
        ("steady", "Steady_1.parquet"), ("gap", "gap.parquet"), ("gap_holdout", "holdout_gap.parquet"),
        ("steady", "steady_2.parquet")]
    code, _, err = call("init", "site.yaml", "--out", "other.yaml")
    assert code == 2 and "none in site.yaml" in err
