"""A gap that the base takes for torque noise thousands of times too loud: its fit has a long way to go."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from drivetool.check.fit.model import all_samples, fit_from_start
from drivetool.check.starts.base import torque_size
from drivetool.check.starts.gap_scan import HALF_GAP_TO_TWIST_GRID, half_gaps
from drivetool.drive import two_mass
from drivetool.identify.setup import Task, roles_of
from tests.hidden import make_case
from tests.hidden.command import read, run
from tests.hidden.start import plain_values
from tests.places import RIG
from tests.recover import experiment


@pytest.fixture(scope="module")
def wide(tmp_path_factory):
    """(the answer, true values, rmse of `validate` with the base): steps that keep the gap closed, then a record
    that crosses it all the time.
    """
    tmp_path = tmp_path_factory.mktemp("wide")
    truth = yaml.safe_load((RIG / "truth.yaml").read_text())["parameters"]
    plain = {name: section["value"] for name, section in truth.items()}
    start = {name: 1.1 * plain[name] for name in plain if name.endswith(("inertia", "stiffness", "shaft.damping"))}
    start |= {"total.viscous": 0.002, "total.idle_torque": 14.0}
    content = {"schema": "drivetool/parameters/1", "drive": {"name": "two-mass"}, "parameters": start}
    (tmp_path / "start.yaml").write_text(yaml.safe_dump(content))
    done = run(tmp_path, ["greybox", RIG / "steps.parquet", "--params", "start.yaml", "--out", "base.yaml"])
    assert done.returncode in (0, 3), done.stderr
    done = run(tmp_path, ["diagnose", RIG / "gap.parquet", "--params", "base.yaml", "--holdout",
                          RIG / "gap_holdout.parquet", "--out", "extended.yaml", "--candidates",
                          "backlash,hardening-stiffness"])
    run(tmp_path, ["validate", RIG / "gap_holdout.parquet", "--params", "base.yaml", "--out", "validated.yaml"])
    rmse = yaml.safe_load((tmp_path / "validated.yaml").read_text())["checks"][0]["rmse"]
    return read(tmp_path / "extended.yaml", done.stderr), plain, rmse


@pytest.mark.slow
def test_a_gap_wider_than_the_twist_is_named_by_a_fit_that_has_arrived(wide):
    answer, plain, _ = wide
    assert (answer.verdict, answer.causes) == ("named", ("backlash",))
    gap = answer.parameters["shaft.half_gap"]
    assert abs(gap["value"] - plain["shaft.half_gap"]) < 3.0 * gap["std"] < 0.002 * plain["shaft.half_gap"]
    # A model of one record predicts the other to nearly its sensor's noise, over all six blocks.
    assert answer.gain["held_out_rmse_after"] < 2.0 * answer.gain["noise_floor"]


@pytest.mark.slow
def test_the_error_before_is_that_of_the_file_where_a_refitted_base_predicts_worse(wide):
    answer, _, rmse = wide
    assert answer.gain["held_out_rmse_before"] == pytest.approx(rmse, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("twists", "machine"), [(1.0, 96101), (5.0, 96105), (10.0, 96110)])
def test_gaps_many_times_the_twist_are_looked_at(twists, machine):
    """A stiff shaft in a worn coupling; the load has a sensor, without which free flight is not identifiable."""
    case = make_case("backlash", machine, sensors=("motor_speed", "load_speed"), size=twists, seed=machine,
                     duration=4.0)
    logged = case.records[0].logged
    record = experiment(logged["motor_torque"], logged["motor_speed"], load_speed=logged["load_speed"])
    values = plain_values(case.rig)
    drive = two_mass().with_values(values)
    task = Task(drive, tuple(n for n in drive.quantities if n in values), roles_of([record], drive), (record,))
    base = fit_from_start(task, all_samples(task.problem()), max_iterations=0)
    found = half_gaps(base, "shaft.half_gap", torque_size(base, "shaft"))
    truth = case.hidden[0].truth["shaft.half_gap"]
    # From there a fit goes on.
    assert min(abs(np.log(np.array(found) / truth))) < np.log(HALF_GAP_TO_TWIST_GRID[1] / HALF_GAP_TO_TWIST_GRID[0])
