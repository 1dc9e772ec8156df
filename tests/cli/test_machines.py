"""compare --machine: which recordings are of one machine, and whether the machines differ."""

import pytest
import yaml

from drivetool.cli.commands.compare import machines_of
from drivetool.errors import BadOption
from tests.cli.test_inverse import logged
from tests.identify.days import days_of, machine_of

VALUES = machine_of(3)
START = f"motor.inertia={1.3 * VALUES[0]}"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    for seed, (name, factor) in enumerate((("one", 1.0), ("two", 1.4)), 1):
        (folder / name).mkdir()
        for i, made in enumerate(days_of(VALUES * [1.0, 1.0, factor, 1.0], 3, 0.002, seed)):
            logged(folder / name, f"{i}.parquet", made)
    return folder


@pytest.mark.slow
def test_machines_in_folders_are_distinguished(call, site, tmp_path):
    logs = sorted(site.glob("*/*.parquet"))
    code, out, err = call("compare", *logs, "--drive", "one-body", "--set", START,
                          "--structure", "physical-innovations", "--machine", "A=*/one/*", "--machine", "B=*/two/*",
                          "--out", tmp_path / "compare.yaml")
    assert code == 0, err
    file = yaml.safe_load((tmp_path / "compare.yaml").read_text())
    differ = [d for d in file["differences"] if d["differs"]]
    assert [(d["name"], d["first"], d["second"]) for d in differ] == [("motor.coulomb", "A", "B")]
    assert file["options"]["machines"] == {
        name: [f"{i}.parquet" for i in range(3)] for name in "AB"}
    assert "parameters-differ" in err
    code, out, _ = call("show", tmp_path / "compare.yaml")
    assert code == 0 and "between machines" in out


def test_a_copy_is_no_repeat(call, site, tmp_path):
    first, *rest = sorted(site.glob("*/*.parquet"))
    copy = tmp_path / "copy.parquet"
    copy.write_bytes(first.read_bytes())
    code, _, err = call("compare", first, copy, *rest[2:], "--drive", "one-body", "--machine", f"A={first}*",
                        "--machine", "B=*/two/*")
    assert code == 2 and "at least 2 recordings" in err
    code, _, err = call("compare", first, copy, *rest[2:], "--drive", "one-body", "--machine", "A=*[0y].parquet",
                        "--machine", "B=*/two/[12]*")
    assert code == 2 and "with one content" in err


def test_records_for_themselves_say_that_a_day_is_no_machine(call, site, tmp_path):
    logs = sorted((site / "one").glob("*.parquet"))
    code, _, err = call("compare", *logs, "--drive", "one-body", "--set", START,
                        "--structure", "physical-innovations", "--out", tmp_path / "compare.yaml")
    assert code == 0, err
    _, out, _ = call("show", tmp_path / "compare.yaml")
    assert "does not separate differences between machines" in out


@pytest.mark.parametrize("words, message", [
    (["A"], "NAME=PATTERN"), (["A=x/*"], "two machines"),
    (["A=x/*", "B=y/1"], "at least 2 recordings of machine B"),
    (["A=x/*", "A=y/*"], "'A' twice"), (["A=x/*", "B=*/1"], "in several"), (["A=z*", "B=y/*"], "0 for 'z*'")])
def test_what_is_wrong_is_said(words, message):
    logs = ["x/1", "x/2", "y/1", "y/2"]
    assert machines_of(["A=x/*", "B=y/*"], logs) == {"A": (0, 1), "B": (2, 3)}
    with pytest.raises(BadOption) as error:
        machines_of(words, logs)
    assert message in str(error.value)
