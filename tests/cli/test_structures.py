"""blackbox --structure, greybox --criterion frequency and compare at the process boundary."""

import json

import numpy as np
import pytest
import yaml
from jsonschema import Draft202012Validator

from drivetool.files.shapes.schema import schemas
from tests.places import FIXTURES
from tests.simulator.experiments import multisine
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise, write_parquet
from tests.simulator.simulate import simulate_linear

RIG = Machine((0.6, 5.2), (0.8, 0.4), stiffness=(3300.0,), damping=(3.1,))


@pytest.fixture
def records(here):
    """Two records of a two-mass machine, a periodic multisine each."""
    for seed in (1, 2):
        torque = np.tile(multisine(np.arange(1.0, 40.0, 0.5), 0.5, 2.0, 1e-3, seed), 4)
        speed = simulate_linear(RIG, torque, 1e-3).speeds[:, 0] + white_noise(len(torque), 1e-2, seed + 5)
        write_parquet(here / f"run{seed}.parquet", {
            "motor_torque": (torque, "Nm"), "motor_speed": (speed, "rad/s")}, 1e-3)
    return here


@pytest.mark.slow
def test_from_black_box_to_a_fit_in_the_frequency_domain(records, call):
    words = ("blackbox", "run1.parquet", "run2.parquet", "--structure", "oe", "--out", "b.yaml", "--plot", "p")
    code, _, talk = call(*words)
    assert code == 0 and "model-order" in talk
    first = (records / "b.yaml").read_bytes()
    content = yaml.safe_load(first)
    Draft202012Validator(json.loads(schemas()["parameters.json"])).validate(content)
    assert content["options"]["structure"] == "oe" and content["details"]["order"] == 3
    assert content["details"]["notches"][0]["hz"]["std"] < 0.1
    call(*words)
    assert (records / "b.yaml").read_bytes() == first
    code, _, talk = call("greybox", "run1.parquet", "--params", "b.yaml", "--criterion", "frequency", "--weighting",
                         "coherence", "--band", "1", "30", "--out", "g.yaml", "--plot", "p")
    content = yaml.safe_load((records / "g.yaml").read_text())
    assert code == 0 and content["parameters"]["load.inertia"]["value"] == pytest.approx(5.2, rel=0.05)
    assert content["details"]["weighting"] == "coherence" and content["options"]["band"] == [1.0, 30.0]
    assert len(list((records / "p").glob("*response.png"))) == 2


def test_compare_writes_tables_that_show_reads(records, call):
    words = ("compare", "run1.parquet", "run2.parquet", "--structure", "oe", "--structure", "arx", "--out",
        "c.yaml")
    assert call(*words)[0] == 0
    content = yaml.safe_load((records / "c.yaml").read_text())
    Draft202012Validator(json.loads(schemas()["comparison.json"])).validate(content)
    assert len(content["cross"]) == 8 and len(content["structures"]) == 4
    inertia = next(s for s in content["spread"] if s["name"] == "load.inertia" and s["structure"] == "oe")
    assert inertia["mean"] == pytest.approx(5.2, rel=0.05) and len(inertia["values"]) == 2
    code, summary, _ = call("show", "c.yaml")
    assert code == 0 and "checked on" in summary and "std over recordings" in summary and "run2" in summary


@pytest.mark.parametrize(("words", "code", "said"), [
    (("blackbox", "run1.parquet", "--structure", "magic"), 2, "magic"),
    (("blackbox", "run1.parquet", "--structure", "oe", "--order", "0"), 2, "order"),
    (("blackbox", "run1.parquet", "--criterion", "auto"), 2, "innovations"),
    (("compare", "run1.parquet"), 1, "two recordings"),
    (("greybox", "run1.parquet", "--criterion", "frequency"), 1, "start"),
    (("steady", "run1.parquet", "--criterion", "frequency"), 2, "frequency"),
    (("steady", "run1.parquet", "--structure", "oe"), 2, "structure"),
])
def test_what_cannot_be_ends_with_a_sentence(records, call, words, code, said):
    found, out, talk = call(*words)
    assert found == code and said in talk and "Traceback" not in talk and not out


def test_vehicle_is_a_known_drive(records, call):
    code, out, _ = call("blackbox", FIXTURES / "bus" / "prbs1.parquet", "--structure", "innovations", "--order",
        "3",
                        "--drive", "vehicle", "--set", "shaft.ratio=8.79", "--set", "wheels.inertia=22.1", "--set",
                        "wheels.carried_mass=9 t", "--set", "wheels.radius=450 mm", "--quiet")
    content = yaml.safe_load(out)
    mass = content["parameters"]["wheels.carried_mass"]
    assert code == 0 and mass["unit"] == "kg" and abs(mass["value"] - 12350.0) < 4.0 * mass["std"]
    assert content["drive"]["bodies"] == ["motor", "wheels"]
