"""A torque that repeats with the angle, identified from the speed alone: its phase counts from the first sample."""

from __future__ import annotations

import pytest
import yaml

from tests.hidden import greybox_options, make_case, write_start
from tests.hidden.command import run
from tests.study.study_diagnose import tool_values

FREE = ["load.imbalance_sine", "load.imbalance_cosine"]


@pytest.mark.slow
@pytest.mark.parametrize("records", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_imbalance_from_the_motor_speed(tmp_path, records):
    case = make_case("imbalance", 12, seed=4, records=records, duration=8.0)
    logs, _ = case.write_records(tmp_path)
    start = write_start(case, tmp_path)
    done = run(tmp_path, ["greybox", *[log.name for log in logs], "--params", start.name, "--out", "fit.yaml",
                          *[word for name in FREE for word in ("--free", name)], *greybox_options(case)])
    assert done.returncode == 0, done.stderr
    found = yaml.safe_load((tmp_path / "fit.yaml").read_text())["parameters"]
    truth = tool_values(case.hidden[0].truth, {}, {})
    for name in FREE:
        assert found[name]["status"] == "fitted", found[name]
        assert abs(found[name]["value"] - truth[name]) < 3.0 * found[name]["std"]
        assert found[name]["std"] < 0.1 * max(abs(truth[n]) for n in FREE)
