"""A local optimum of the likelihood on which several starts agree."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from drivetool.errors import NotEnoughData
from drivetool.identify.starts.partial_record_restarts import restart_from_partial_records
from tests.hidden import greybox_options, make_case, write_start
from tests.hidden.command import run


@pytest.mark.slow
def test_two_starts_that_agree_on_a_lower_peak_do_not_decide(tmp_path: Path):
    # A load of an eighth of the motor's inertia that rattles: two starts of four agree on a half gap of 0.0524.
    case = make_case(("backlash", "coulomb-load"), 107000, seed=107000)
    logs, _ = case.write(tmp_path / "room", tmp_path / "label", visibility=False)
    start = write_start(case, tmp_path / "room")
    free = ["--free", "shaft.half_gap", "--set", "shaft.half_gap=0.03", "--free", "load.coulomb",
            "--set", "load.coulomb=2", *greybox_options(case)]
    done = run(tmp_path / "room", ["greybox", logs[0].name, "--params", start.name, "--out", "drive.yaml", *free])
    assert done.returncode == 0, done.stderr
    hidden = json.loads((tmp_path / "label" / "label.json").read_text())["effects"]
    lines = yaml.safe_load((tmp_path / "room" / "drive.yaml").read_text())["parameters"]
    for name, true in {k: v for effect in hidden for k, v in effect["truth"].items()}.items():
        assert abs(lines[name]["value"] - true) < 3.0 * lines[name]["std"], name
        assert lines[name]["std"] < 0.02 * true


@pytest.mark.parametrize("error", [NotEnoughData("a longer record", "a short one", "Record longer."),
                                   np.linalg.LinAlgError()])
def test_a_part_that_cannot_be_fitted_does_not_fail_the_fit(error):
    experiment = SimpleNamespace(size=100, step=1e-3, between=lambda *_: experiment)

    @dataclass(frozen=True)
    class TaskOfRecord:
        experiments: tuple = (experiment,)

        def at_point(self, _):
            return self

    def fails(*_):
        raise error

    solution = SimpleNamespace(point=None, noise=None, value=0.0)
    assert restart_from_partial_records(TaskOfRecord(), solution, fails) == []
