"""A load that sets in in one record of several: nothing of it is in the others, nor in fresh ones."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.model import Model
from drivetool.check.search.candidate_fit import CandidateFit, screened_for_significance
from drivetool.drive.effects import load_step
from drivetool.drive.simulation import Trace
from drivetool.identify.noise import Noise
from drivetool.identify.problem import Point
from drivetool.identify.setup import Roles, Task, problem_of
from tests.drive.test_effects import base
from tests.hidden import greybox_options, make_case, write_start
from tests.hidden.command import greybox_and_diagnose, run

MACHINE, SHORT = 5, {"duration": 6.0}
ROLES = Roles(("motor_torque",), ("motor_speed",))


def simulated(record: int, number: float, time: float = 0.2) -> np.ndarray:
    """Motor speed of a record of that number where a load sets in in record `number`."""
    drive = base(**{"load.step_torque": 8.0, "load.step_time": time, "load.step_record": number})
    trace = Trace(np.full((600, 1), 20.0), np.zeros((600, 1)), 1e-3, record=record)
    problem = problem_of(drive, (), ROLES, (trace,))
    plant = problem.plants(np.empty(0), False)[0]
    return plant.outputs(trace, np.zeros(plant.nx))[:, 0]


def test_it_acts_in_its_own_record_only():
    never = simulated(7, 0.0, time=load_step.NEVER)
    assert np.array_equal(simulated(7, 7.0), simulated(7, 0.0))
    assert np.array_equal(simulated(8, 7.0), never)
    assert abs(simulated(7, 7.0) - never)[250:].max() > 0.1


@pytest.mark.parametrize(("time", "absent"), [(-1.0, True), (0.1, True), (0.4, False), (1.6, False), (1.9, True)])
def test_a_load_that_sets_in_at_an_end_of_the_record_is_none(time, absent):
    """Three samples that a logger froze at the end were explained by 75 times the rated torque."""
    drive = base(**{"load.step_torque": 8.0, "load.step_time": time})
    names = ("load.step_torque", "load.step_time")
    trace = Trace(np.full((2000, 1), 20.0), np.zeros((2000, 1)), 1e-3)
    problem = problem_of(drive, names, ROLES, (trace,))
    model = Model("load-step", Task(drive, names, ROLES, ()), problem, Point(np.array([8.0, time]), (np.zeros(3),)),
                  Noise(1.0, None, problem.scale), 0.0)
    found = screened_for_significance(CandidateFit(CAUSES["load-step"], model, {}), model)
    assert (found.absent == "no-gain") is absent
    assert ("begins or ends" in found.reason) is absent


@pytest.mark.slow
def test_found_in_the_second_of_two_records(tmp_path):
    quiet = make_case("none", MACHINE, seed=3, **SHORT)
    case = make_case("load-step", MACHINE, seed=7, **SHORT)
    case = replace(case, records=(quiet.records[0], replace(case.records[0], name="record2")))
    logs, _ = case.write_records(tmp_path)
    answer = greybox_and_diagnose(tmp_path, logs, write_start(case, tmp_path), greybox_options(case),
                 ["--candidates", "load-step,friction-drift,quadratic-drag"])
    assert (answer.verdict, answer.causes) == ("named", ("load-step",)), answer.stderr
    truth = case.hidden[0].truth
    for name, value in (("step_torque", truth["load.load_step"]), ("step_time", truth["load.load_step_time"])):
        low, high = answer.parameters[f"load.{name}"]["ci95"]
        assert low <= value <= high
    reasons = [c["reason"] for c in answer.candidates if c["state"] == "named"]
    assert reasons == ["The event is in record2.parquet only."]
    # Each record by itself: the file knows which is which, and a fresh one has no load that sets in.
    for log in (*logs, quiet_record(tmp_path)):
        done = run(tmp_path, ["validate", log.name, "--params", "extended.yaml", "--json"])
        assert json.loads(done.stdout)["checks"][0]["rmse"] < 3.0 * answer.gain["noise_floor"], log.name


def quiet_record(folder):
    """A fresh record of the machine in which nothing sets in."""
    fresh = folder / "fresh"
    fresh.mkdir()
    _, (log,) = make_case("none", MACHINE, seed=11, **SHORT).write_records(fresh)
    return log.rename(folder / "fresh.parquet")
