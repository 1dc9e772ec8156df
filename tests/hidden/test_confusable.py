"""What torque and speed of the motor do not distinguish, row by row: left open, or nothing found.

Other tests separate such causes: a second sensor in `test_hidden_effects.py` (lag and filter) and
`test_friction_split.py` (motor and load, whose friction is one sum here), reversals in `test_dry_friction.py`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from tests.hidden import greybox_options, make_case, write_start
from tests.hidden.case import record_of
from tests.hidden.command import Answer, greybox_and_diagnose
from tests.hidden.custom_record import write_record
from tests.hidden.effects import Logger
from tests.hidden.profiles import profile

MACHINE, SHORT = 71, {"duration": 6.0}
EVERY_SPEED = "quadratic-drag,backlash,load-step"


def answer_to(folder: Path, effects: str | tuple, rivals: str, machine: int = MACHINE, **options) -> Answer:
    """What is said of a record of a machine with a hidden effect."""
    case = make_case(effects, machine, seed=machine, **SHORT, **options)
    logs, _ = case.write_records(folder)
    return greybox_and_diagnose(folder, logs, write_start(case, folder), greybox_options(case),
                                ["--candidates", rivals])


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "rivals", "machine", "options", "open_between"), [
    ("imbalance", "imbalance,torque-ripple,coulomb-load", 71, {}, {"imbalance", "torque-ripple"}),
    pytest.param("backlash", "backlash,hardening-stiffness,coulomb-load", 72, {"size": 0.004},
                 {"backlash", "hardening-stiffness"}, marks=pytest.mark.long),
    # From stop to stop, with a handful of reversals.
    ("coulomb-motor", "coulomb-motor,coulomb-load,backlash", 71, {"record": "moves"},
     {"coulomb-motor", "coulomb-load"}),
    pytest.param("friction-drift", "friction-drift,load-step,quadratic-drag", 72, {"record": "one-directional"},
                 {"friction-drift", "load-step"}, marks=[
                     pytest.mark.long, pytest.mark.xfail(reason="the drift is named alone")])])
def test_what_looks_alike_is_left_open(tmp_path, effect, rivals, machine, options, open_between):
    answer = answer_to(tmp_path, effect, rivals, machine, **options)
    assert (answer.verdict, set(answer.between)) == ("undetermined", open_between), answer.stderr


@pytest.mark.slow
def test_dry_friction_without_a_reversal_is_an_idle_torque(tmp_path):
    """Of which nothing is seen, however large: no smallest visible size is stated."""
    answer = answer_to(tmp_path, "coulomb-motor", "coulomb-motor,coulomb-load,asymmetric-friction,quadratic-drag",
                       record="one-directional")
    assert answer.verdict == "nothing-found", answer.stderr
    candidates = {c["code"]: c for c in answer.candidates}
    for code in ("coulomb-motor", "coulomb-load", "asymmetric-friction"):
        assert candidates[code]["shown"] is False and not candidates[code]["smallest"]
        assert "direction" in candidates[code]["reason"]
    assert candidates["quadratic-drag"]["shown"] and candidates["quadratic-drag"]["smallest"]


@pytest.mark.slow
def test_an_offset_of_the_torque_is_an_idle_torque(tmp_path):
    answer = answer_to(tmp_path, "torque-offset", f"torque-offset,coulomb-motor,{EVERY_SPEED}")
    assert answer.verdict == "nothing-found", answer.stderr
    offset = next(c for c in answer.candidates if c["code"] == "torque-offset")
    assert offset["state"] == "in-the-model" and "idle torque" in offset["reason"]


@pytest.mark.slow
def test_a_small_stiff_third_mass_is_not_seen_from_the_motor(tmp_path):
    answer = answer_to(tmp_path, "third-mass", "third-mass,backlash,hardening-stiffness", size=0.05)
    assert answer.verdict == "nothing-found", answer.stderr


@pytest.mark.slow
def test_a_wrong_torque_constant_scales_the_machine(tmp_path):
    case = make_case((), MACHINE, seed=MACHINE, **SHORT)
    logger = replace(Logger(), scale={"motor_torque": 1.1})
    made = record_of("record1", case.rig, case.machine, logger, case.noise, "reversing", [MACHINE, 0])
    logs, _ = replace(case, records=(made,)).write_records(tmp_path)
    answer = greybox_and_diagnose(tmp_path, logs, write_start(case, tmp_path), greybox_options(case),
                 ["--candidates", f"wrong-scale,coulomb-load,{EVERY_SPEED}"])
    assert answer.verdict == "nothing-found", answer.stderr
    ratio = answer.parameters["motor.inertia"]["value"] / case.rig.machine.inertia[0]
    assert abs(ratio - 1.1) < 0.02


@pytest.mark.slow
def test_dry_friction_by_direction_is_one_of_both_and_an_idle_torque(tmp_path):
    """Half as much in one direction is the mean of the two and a quarter as idle torque, exactly."""
    case = make_case((), MACHINE, seed=MACHINE, coulomb={0: 0.03}, **SHORT)
    machine, dry = case.rig.machine, case.rig.machine.coulomb[0]
    machine = replace(machine, effects=replace(machine.effects, coulomb_back=(0.5 * dry, math.nan)))
    record = write_record(tmp_path, case, profile("reversing", case.rig, MACHINE), machine=machine)
    answer = greybox_and_diagnose(tmp_path, [record], write_start(case, tmp_path), greybox_options(case),
                 ["--candidates", f"asymmetric-friction,coulomb-load,{EVERY_SPEED}"])
    assert answer.verdict == "nothing-found", answer.stderr
    found = answer.parameters["motor.coulomb"]
    assert abs(found["value"] - 0.75 * dry) < 4.0 * found["std"]
