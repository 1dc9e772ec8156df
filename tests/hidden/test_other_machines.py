"""Machines that are not quite what the base takes them for: held out on another day, or measured at another end."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import yaml

from tests.hidden.case import make_case
from tests.hidden.command import greybox_and_diagnose
from tests.hidden.custom_record import write_record
from tests.hidden.profiles import profile
from tests.hidden.rigs import resonances
from tests.hidden.start import write_start
from tests.simulator.machine import Machine

PLAIN = ["--hold", "motor.coulomb"]
FITTED = ["--candidates", "third-mass,load-dependent-damping,hardening-stiffness,load-step"]


@pytest.mark.slow
def test_a_held_out_record_with_other_friction_is_reported_and_no_cause_is_named(tmp_path):
    case = make_case("none", 901, seed=4, duration=6.0)
    machine = case.rig.machine
    record = write_record(tmp_path, case, profile("reversing", case.rig, 4))
    warmer = replace(machine, viscous=tuple(1.4 * v for v in machine.viscous))
    other = write_record(tmp_path, case, profile("reversing", case.rig, 5), "other", warmer, seed=5)
    answer = greybox_and_diagnose(tmp_path, [record], write_start(case, tmp_path), PLAIN,
                 ["--candidates", "quadratic-drag,load-step", "--holdout", other.name])
    assert answer.verdict == "unexplained" and not answer.causes, answer.stderr
    content = yaml.safe_load((tmp_path / "extended.yaml").read_text())
    (finding,) = [f for f in content["findings"] if f["code"] == "parameters-change"]
    names = [n.removesuffix(".held_out") for n in finding["evidence"] if n.endswith(".held_out")]
    assert all(n.endswith("viscous") for n in names) and "other.parquet" in finding["text"], finding
    more = sum(finding["evidence"][f"{n}.held_out"] - finding["evidence"][f"{n}.fitted"] for n in names)
    assert more == pytest.approx(0.4 * sum(machine.viscous), rel=0.1)
    assert content["diagnosis"]["sentence"].startswith("The parameters differ")


@pytest.mark.slow
def test_a_record_held_out_of_the_same_machine_differs_in_nothing(tmp_path):
    case = make_case("none", 901, seed=4, duration=6.0)
    record = write_record(tmp_path, case, profile("reversing", case.rig, 4))
    other = write_record(tmp_path, case, profile("reversing", case.rig, 5), "other", seed=5)
    answer = greybox_and_diagnose(tmp_path, [record], write_start(case, tmp_path), PLAIN,
                                  [*FITTED, "--holdout", other.name])
    assert answer.verdict == "nothing-found" and "differs" not in answer.stderr


@pytest.mark.long
def test_a_mass_in_front_of_the_load_and_its_sensor_is_a_third_mass_too(tmp_path):
    case = make_case("none", 931, seed=6, duration=6.0, sensors=("motor_speed", "load_speed"))
    plain, plan = case.rig.machine, profile("reversing", case.rig, 931)
    last, share = plain.inertia[1], 0.4
    rate = 2.0 * 2.0 * math.pi * resonances(plain)[0]
    stiffness = share * (1.0 - share) * last * rate**2
    machine = Machine(
        (plain.inertia[0], share * last, (1.0 - share) * last), (plain.viscous[0], 0.0, plain.viscous[1]), (),
        (0.0, 0.0, sum(plain.idle_torque)), (*plain.stiffness, stiffness),
        (*plain.damping, 0.04 * share * (1.0 - share) * last * rate), rated_torque=case.rig.rated)
    start = replace(plan.start, speeds=(*plan.start.speeds, plan.start.speeds[-1]),
                    twists=(*plan.start.twists, 0.0))
    record = write_record(tmp_path, case, replace(plan, start=start), machine=machine)
    answer = greybox_and_diagnose(tmp_path, [record], write_start(case, tmp_path), PLAIN, FITTED)
    assert (answer.verdict, answer.causes) == ("named", ("third-mass",)), answer.stderr
    true = dict(zip(("motor", "middle", "load"), machine.inertia, strict=True))
    for body, inertia in true.items():
        line = answer.parameters[f"{body}.inertia"]
        assert abs(line["value"] - inertia) < 4.0 * line["std"] < inertia, body
