"""Hidden effect: a shaft that is damped in its gap too, or relaxes in it, found by the command line."""

import re
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


def recorded(folder, rig, law=None):
    """Two records a and b, and start.yaml with a wrong damping, or, by a law that is given, the truth."""
    for name, seed in (("a", 7), ("b", 8)):
        torque = experiments.alternating(running(rig, 110.0).torque, (40.0, 90.0), (0.25, 0.5), 11, 0.4, STEP, seed)
        record = channels(rig, np.round(torque, 3), 110.0, seed, Sensors())
        write(folder, name, record, ("motor_torque", "motor_speed", "load_speed"))
    values = truth_of(rig) | {"shaft.damping": 12.0 if law else 8.0, "shaft.half_gap": 0.02}
    drive = {"bodies": ["motor", "load"], "shafts": ["shaft"], **({"damping_law": law} if law else {})}
    start = {"schema": "drivetool/parameters/1", "drive": drive,
             "parameters": {n: {"value": v, "unit": UNITS[n.partition(".")[2]]} for n, v in values.items()}}
    (folder / f"{law or 'start'}.yaml").write_text(yaml.safe_dump(start))


def test_a_shaft_that_relaxes_in_its_gap_is_simulated_and_validated(call, tmp_path):
    fits = {}
    for law in ("contact", "inside"):
        recorded(tmp_path, replace(RIG, law="contact"), law)
        model, simulated = tmp_path / f"{law}.yaml", tmp_path / "simulated.parquet"
        code, _, err = call("simulate", tmp_path / "a.parquet", "--params", model, "--out", simulated)
        assert code == 0, err
        fits[law] = float(re.search(r"motor_speed: fit ([0-9.]+) %", err)[1])
        code, _, err = call("validate", tmp_path / "b.parquet", "--params", model, "--out", tmp_path / "v.yaml")
        assert code == 0, err
    assert fits["contact"] > 98.0 and fits["inside"] < 96.0
    (tmp_path / "other.yaml").write_text((tmp_path / "contact.yaml").read_text().replace("contact", "nordin"))
    code, _, err = call("validate", tmp_path / "b.parquet", "--params", tmp_path / "other.yaml")
    assert code != 0 and "inside, always, contact" in err


@pytest.mark.slow
def test_that_the_shaft_relaxes_in_its_gap_is_named(call, tmp_path):
    recorded(tmp_path, replace(RIG, law="contact"))
    code, _, err = call("backlash", tmp_path / "a.mcap", "--params", tmp_path / "start.yaml", "--free",
                        "shaft.damping", "--out", tmp_path / "gap.yaml")
    gap = yaml.safe_load((tmp_path / "gap.yaml").read_text())
    assert code == 0 and "note gap-law:" in err and gap["drive"]["damping_law"] == "contact", err
    for name, true in (("shaft.damping", 12.0), ("shaft.half_gap", 0.02)):
        assert abs(gap["parameters"][name]["value"] - true) < 4.0 * gap["parameters"][name]["std"]
    # The next steps read the law.
    code, _, err = call("greybox", tmp_path / "b.parquet", "--params", tmp_path / "gap.yaml", "--free",
                        "shaft.damping", "--out", tmp_path / "grey.yaml")
    assert code == 0 and yaml.safe_load((tmp_path / "grey.yaml").read_text())["drive"]["damping_law"] == "contact"


@pytest.mark.slow
def test_damping_in_the_gap_is_named_with_its_size(call, tmp_path):
    recorded(tmp_path, RIG)
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
