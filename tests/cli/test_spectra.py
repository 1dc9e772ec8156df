"""drivetool spectra at its boundary."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from jsonschema import Draft202012Validator

from drivetool.files.shapes.schema import schemas
from tests.simulator.experiments import multisine
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise, write_parquet
from tests.simulator.simulate import simulate_linear

RIG = Machine((0.6, 5.2), (0.8, 0.4), stiffness=(3300.0,), damping=(3.1,))


@pytest.fixture
def record(here):
    """Ten periods of a multisine at a two-mass machine."""
    torque = np.tile(multisine(np.arange(1.0, 40.0, 0.5), 0.5, 2.0, 1e-3, 3), 10)
    speed = simulate_linear(RIG, torque, 1e-3).speeds[:, 0] + white_noise(len(torque), 1e-3, 4)
    write_parquet(here / "multi.parquet", {
        "motor_torque": (torque, "Nm"), "motor_speed": (speed, "rad/s")}, 1e-3)
    return here


@pytest.mark.slow
def test_summary_curves_and_pictures(record, call):
    words = ("spectra", "multi.parquet", "--out", "s.yaml", "--plot", "pictures")
    code, _, talk = call(*words)
    assert code == 0 and "wrote s.curves.parquet" in talk
    text, curves = (record / "s.yaml").read_bytes(), (record / "s.curves.parquet").read_bytes()
    content = yaml.safe_load(text)
    Draft202012Validator(json.loads(schemas()["spectra.json"])).validate(content)
    assert content["curves"] == "s.curves.parquet"
    assert content["settings"]["period"] == 2.0 and content["lines"] == 78
    peaks = {p["kind"]: p["hz"] for p in content["peaks"]}
    jm, jl, ks = 0.6, 5.2, 3300.0
    assert abs(peaks["resonance"] - np.sqrt(ks * (1 / jm + 1 / jl)) / 2 / np.pi) < 0.5
    assert abs(peaks["anti-resonance"] - np.sqrt(ks / jl) / 2 / np.pi) < 0.5
    table = pq.read_table(record / "s.curves.parquet")
    assert table.num_rows == 78 and table.schema.field("magnitude").metadata[b"unit"] == b"rad/s/Nm"
    assert (record / "pictures" / "spectra-multi-response.png").stat().st_size > 10_000
    assert call(*words)[0] == 0
    assert (record / "s.yaml").read_bytes() == text and (record / "s.curves.parquet").read_bytes() == curves
    code, summary, _ = call("show", "s.yaml")
    assert code == 0 and "anti-resonance" in summary and "coherence" in summary


def test_words_reach_the_estimator(record, call):
    code, out, _ = call("spectra", "multi.parquet", "--method", "welch", "--estimator", "h3", "--window",
                        "hamming", "--length", "4", "--overlap", "0.7", "--band", "2", "20", "--json", "--quiet",
                        "--curves", "new/c.parquet")
    assert pq.read_table(record / "new" / "c.parquet").num_rows > 10
    content = json.loads(out)
    assert code == 0 and content["settings"]["estimator"] == "h3" and content["settings"]["length"] == 4.0
    assert content["first_hz"] >= 2.0 and content["last_hz"] <= 20.0 and content["curves"] == "c.parquet"
    assert json.loads(call("spectra", "multi.parquet", "--json", "--quiet")[1])["curves"] is None


@pytest.mark.parametrize("name, wanted", [("multi", "multi.curves.parquet"), (
    "multi.curves", "multi.curves.curves.parquet")])
def test_curves_beside_the_summary_take_no_recordings_name(record, call, name, wanted):
    (record / "multi.parquet").rename(record / f"{name}.parquet")
    other = record / "multi.parquet"  # a recording that this run does not read
    if name != "multi":
        other.write_bytes(b"kept")
    before = {path.name: path.read_bytes() for path in record.iterdir()}
    code, _, talk = call("spectra", f"{name}.parquet", "--out", "multi.yaml")
    assert code == 0 and f"wrote {wanted}" in talk
    assert yaml.safe_load((record / "multi.yaml").read_text())["curves"] == wanted
    assert {p.name for p in record.iterdir()} == {*before, "multi.yaml", wanted}
    assert all((record / each).read_bytes() == content for each, content in before.items())


@pytest.mark.parametrize(("words", "code", "said"), [
    (("--method", "periodic", "--period", "15"), 1, "two periods"),
    (("--estimator", "indirect"), 2, "reference"),
    (("--estimator", "h7"), 2, "h7"),
    (("--curves", "multi.parquet"), 2, "inputs are never changed"),
    (("--curves", "x", "--out", "./x"), 2, "two files for --out and --curves"),
    (("--curves", "multi.parquet/x.parquet"), 2, "which is no folder"),
])
def test_what_cannot_be_ends_with_a_sentence(record, call, words, code, said):
    before = (record / "multi.parquet").read_bytes()
    found, out, talk = call("spectra", "multi.parquet", *words)
    assert found == code and said in talk and "Traceback" not in talk and not out
    assert (record / "multi.parquet").read_bytes() == before


@pytest.mark.parametrize("more", [(), ("--method", "periodic", "--period", "0.5")])
@pytest.mark.parametrize("torque, speed", [(1.0, 0.0), (0.0, 1.0), (1e-300, 1e-300)])
def test_a_channel_at_rest_has_no_response(record, call, torque, speed, more):
    t = np.arange(4000) * 1e-3
    write_parquet(record / "rest.parquet", {"motor_torque": (torque * np.sin(8 * np.pi * t), "Nm"),
                                            "motor_speed": (speed * np.cos(8 * np.pi * t), "rad/s")}, 1e-3)
    code, out, talk = call("spectra", "rest.parquet", "--out", "n.yaml", *more)
    assert (code, out) == (1, "") and "and the sensor measures; found none" in talk


def test_an_incoherent_record_is_written_and_ends_with_three(record, call):
    rng = np.random.default_rng(1)
    write_parquet(record / "noise.parquet", {"motor_torque": (rng.standard_normal(9000), "Nm"),
                                             "motor_speed": (rng.standard_normal(9000), "rad/s")}, 1e-3)
    code, _, talk = call("spectra", "noise.parquet", "--out", "n.yaml")
    assert code == 3 and "low-coherence" in talk and (record / "n.yaml").exists()
