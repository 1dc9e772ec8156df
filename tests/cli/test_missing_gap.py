"""A gap that the model of two masses lacks, at the command line: a finding, and no interval of the shaft."""

import pytest
import yaml

from tests.simulator.records import write_parquet
from tests.study.two_masses.record import STEP, draw

UNITS = {"motor_torque": "Nm", "motor_speed": "rad/s", "motor_angle": "rad", "load_speed": "rad/s",
         "shaft_torque": "Nm"}
SHAFT_AND_INERTIAS = ("shaft.stiffness", "shaft.damping", "motor.inertia", "load.inertia")


@pytest.mark.slow
@pytest.mark.parametrize("situation, size, number, seed", [("shaft.gap", "S", 1, 3001), ("quiet", "", 0, 3000)])
def test_a_gap_left_out_takes_the_interval_of_the_shaft(call, tmp_path, situation, size, number, seed):
    record = draw(situation, size, number, seed, 2.0)
    write_parquet(tmp_path / "r.parquet", {r: (v, UNITS[r]) for r, v in record.channels.items()}, STEP)
    words = [word for name, value in record.machine.values.items() if name != "shaft.half_gap"
             for word in ("--set", f"{name}={float(value)!r}")]
    code, out, err = call("greybox", tmp_path / "r.parquet", "--drive", "two-mass", *words,
                          "--out", tmp_path / "o.yaml")
    assert code == 0, err
    content = yaml.safe_load((tmp_path / "o.yaml").read_text())
    found = {f["code"]: f for f in content["findings"]}
    lines = [content["parameters"][name] for name in SHAFT_AND_INERTIAS]
    if situation == "quiet":
        assert not {"gap-left-out", "mass-left-out"} & set(found)
        assert all(line["ci95"] for line in lines)
        return
    finding = found["gap-left-out"]
    assert finding["severity"] == "warning" and "--free shaft.half_gap" in finding["action"]
    assert finding["evidence"]["half_gap"] == pytest.approx(record.machine.values["shaft.half_gap"], rel=0.3)
    assert all(line["std"] is None and line["ci95"] is None and "a gap is missing in the model" in line["reason"]
               for line in lines)
    assert not set(SHAFT_AND_INERTIAS) & set((content.get("covariance") or {"names": ()})["names"])
    assert "half gap of about" in " ".join((out + err).split())
