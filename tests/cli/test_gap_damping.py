"""Hidden effect: a shaft that is damped in its gap too, found by the command line from two records."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from tests.light_rigs import HEAVY, STEP, Sensors, channels, write
from tests.simulator import experiments
from tests.simulator.machine import running
from tests.study.study_shaft_torque import truth_of

RIG = replace(HEAVY, half_gap=(0.02,), law="always", damping=(12.0,))
CANDIDATES = "damping-in-gap,load-dependent-damping,quadratic-drag,hardening-stiffness,coulomb-load"
UNITS = {"inertia": "kg m^2", "viscous": "Nm s/rad", "idle_torque": "Nm", "stiffness": "Nm/rad",
         "damping": "Nm s/rad", "half_gap": "rad"}


@pytest.mark.slow
def test_damping_in_the_gap_is_named_with_its_size(call, tmp_path):
    for name, seed in (("a", 7), ("b", 8)):
        torque = experiments.alternating(running(RIG, 110.0).torque, (40.0, 90.0), (0.25, 0.5), 11, 0.4, STEP, seed)
        record = channels(RIG, np.round(torque, 3), 110.0, seed, Sensors())
        write(tmp_path, name, record, ("motor_torque", "motor_speed", "load_speed"))
    values = truth_of(RIG) | {"shaft.damping": 8.0, "shaft.half_gap": 0.02}
    start = {"schema": "drivetool/parameters/1", "drive": {"bodies": ["motor", "load"], "shafts": ["shaft"]},
             "parameters": {n: {"value": v, "unit": UNITS[n.partition(".")[2]]} for n, v in values.items()}}
    (tmp_path / "start.yaml").write_text(yaml.safe_dump(start))
    base, found = tmp_path / "base.yaml", tmp_path / "found.yaml"
    words = ("backlash", tmp_path / "a.mcap", "--params", tmp_path / "start.yaml", "--free", "shaft.damping")
    # The fit of a gap names the law of its damping by itself. A simulation-error fit keeps to the drive's own.
    code, _, err = call(*words, "--out", tmp_path / "gap.yaml")
    gap = yaml.safe_load((tmp_path / "gap.yaml").read_text())
    assert code == 0 and "note gap-law:" in err and gap["drive"]["damping_law"] == "always", err
    low, high = gap["parameters"]["shaft.damping"]["ci95"]
    assert low <= 12.0 <= high
    code, _, err = call(*words, "--criterion", "simulation", "--out", base)
    assert code == 0, err
    code, _, err = call("diagnose", tmp_path / "a.parquet", "--params", base, "--holdout", tmp_path / "b.parquet",
                        "--candidates", CANDIDATES, "--out", found)
    assert code == 0, err
    answer = yaml.safe_load(found.read_text())
    assert answer["diagnosis"]["verdict"] == "named" and answer["diagnosis"]["causes"] == ["damping-in-gap"]
    line = answer["parameters"]["shaft.gap_damping"]
    assert line["ci95"][0] <= 12.0 <= line["ci95"][1] and line["std"] < 0.3
