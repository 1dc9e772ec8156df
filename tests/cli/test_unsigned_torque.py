"""A torque that is logged without its sign: for steady running, and for nothing that accelerates."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from drivetool.errors import BadOption
from drivetool.logs.channels import SCHEMA, ChannelMap

N, STEP, VISCOUS, COULOMB = 12_000, 0.002, 0.05, 0.3


@pytest.fixture
def here(here):
    """Both directions at four speeds, and the torque as its magnitude."""
    rng = np.random.default_rng(2)
    speed = np.repeat([10.0, -10.0, 30.0, -30.0], N // 4)
    torque = VISCOUS * speed + COULOMB * np.sign(speed) + 0.01 * rng.standard_normal(N)
    pq.write_table(pa.table({"time": np.arange(N) * STEP, "i": np.abs(torque),
                             "n": speed + 0.01 * rng.standard_normal(N)}), "a.parquet")
    (here / "map.yaml").write_text(yaml.safe_dump({"schema": SCHEMA, "roles": {
        "motor_torque": {"channel": "i", "unit": "Nm", "unsigned": True},
        "motor_speed": {"channel": "n", "unit": "rad/s"}}}))


@pytest.mark.usefixtures("here")
def test_steady_gives_it_the_sign_of_the_motion(call):
    code, out, err = call("steady", "a.parquet", "--map", "map.yaml", "--drive", "one-body", "--free",
                          "motor.coulomb")
    assert code == 0, err
    content = yaml.safe_load(out)
    for name, true in ("motor.viscous", VISCOUS), ("motor.coulomb", COULOMB):
        row = content["parameters"][name]
        assert abs(row["value"] - true) < 4 * row["std"], name
    output = next(f for f in content["findings"] if f["code"] == "torque-unsigned")
    assert output["severity"] == "warning" and "are exchanged" in output["text"]


@pytest.mark.usefixtures("here")
def test_a_current_without_its_sign_becomes_a_torque(call):
    content = yaml.safe_load(Path("map.yaml").read_text())
    content["roles"]["motor_torque"]["unit"] = "A"
    Path("map.yaml").write_text(yaml.safe_dump(content))
    found = {}
    for words, unit in ((), "A s/rad"), (("--set", "motor.torque_constant=2"), "Nm s/rad"):
        code, out, err = call("steady", "a.parquet", "--map", "map.yaml", "--drive", "one-body", *words)
        assert code == 0, err
        row = yaml.safe_load(out)["parameters"]["motor.viscous"]
        assert row["unit"] == unit
        found[unit] = row["value"]
    assert found["Nm s/rad"] == pytest.approx(2.0 * found["A s/rad"], rel=1e-8)


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("step", ["greybox", "blackbox", "backlash", "spectra", "simulate", "compare"])
def test_what_accelerates_refuses_it_in_one_sentence(call, step):
    words = [] if step == "spectra" else ["--drive", "two-mass", *(word for name in (
        "motor.inertia=1", "load.inertia=1", "shaft.stiffness=1", "shaft.damping=1")
        for word in ("--set", name))]
    words += {"simulate": ["--out", "x.parquet"], "compare": ["a.parquet"]}.get(step, [])
    code, out, err = call(step, "a.parquet", "--map", "map.yaml", *words)
    assert (code, out) == (1, "") and "Its sign is unknown" in err and err.count("error:") == 1


@pytest.mark.usefixtures("here")
def test_a_converted_table_would_have_lost_it(call):
    code, _, err = call("convert", "a.parquet", "--map", "map.yaml", "--out", "x.parquet")
    assert code == 1 and "without its sign" in err and not Path("x.parquet").exists()


def test_only_a_torque_may_be_a_magnitude():
    with pytest.raises(BadOption, match="unsigned for motor_torque only"):
        ChannelMap.from_mapping({"schema": SCHEMA, "roles": {
            "motor_speed": {"channel": "n", "unit": "rad/s", "unsigned": True}}})
