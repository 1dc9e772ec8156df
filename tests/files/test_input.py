"""Parameter files as people write them, right and wrong."""

import json
import math

import hypothesis.strategies as st
import pytest
import yaml
from hypothesis import given

from drivetool.drive import one_body, two_mass
from drivetool.errors import BadParameters
from drivetool.files.yaml import units
from drivetool.files.yaml.channel_map_file import load_channel_map
from drivetool.files.yaml.parameter_file import load_parameters
from drivetool.files.yaml.text import from_yaml, number_text, to_json, to_plain, to_yaml

HEAD = "schema: drivetool/parameters/1\n"
PREFIX = HEAD + "parameters: "

# text, words that the one sentence must have
BAD = {
    "empty": ("", "empty"),
    "comment only": ("# nothing\n", "empty"),
    "list": ("- 1\n", "a list in"),
    "text": ("hello\n", "a text in"),
    "binary": (b"\xff\xfe\x00PAR1", "not UTF-8"),
    "broken": ("a: [1\n", "line 2"),
    "tab": ("a:\n\tb: 1\n", "line 2 spaces, not tabs"),
    "deep": ("[" * 5000, "not YAML"),
    "date": (HEAD + "step: 2020-13-45\n", "YAML"),
    "object": (HEAD + "step: !!python/object/apply:os.getcwd []\n", "tag"),
    "twice": (HEAD + "step: a\nstep: b\n", "'step' for the second time line 3"),
    "no schema": ("parameters: {}\n", "no schema Begin the file with 'schema: drivetool/parameters/1'"),
    "other schema": ("schema: drivetool/parameters/2\n", "drivetool/parameters/1 drivetool/parameters/2"),
    "validation": ("schema: drivetool/validation/1\n", "not the file that validate wrote"),
    "typo in key": (HEAD + "parmeters: {}\n", "Did you mean 'parameters'?"),
    "number as key": (HEAD + "1: 2\n", "'1'"),
    "typo in name": (PREFIX + "{motor.inertai: 1}", "Did you mean 'motor.inertia'?"),
    "typo in field": (PREFIX + "{motor.inertia: {vaule: 1}}", "parameters.motor.inertia Did you mean 'value'?"),
    "no value": (PREFIX + "{motor.inertia: {unit: kg m^2}}", "value"),
    "null": (PREFIX + "{motor.inertia: }", "a number found nothing"),
    "boolean": (PREFIX + "{motor.inertia: true}", "a number 'True'"),
    "decimal comma": (PREFIX + "{motor.inertia: {value: '0,4'}}", "motor.inertia.value text '0,4' number"),
    "text as number": (PREFIX + "{motor.inertia: heavy}", "text 'heavy'"),
    "short interval": (PREFIX + "{motor.inertia: {value: 1, ci95: [1]}}", "list of 2 ci95"),
    "status": (PREFIX + "{motor.inertia: {value: 1, status: fited}}", "one of fitted, held 'fited'"),
    "negative": (PREFIX + "{motor.inertia: -1}", "between 1e-12 and 1e+12 kg m^2 -1 in"),
    "negative std": (PREFIX + "{motor.inertia: {value: 1, std: -1}}",
                     "a number of at least 0 motor.inertia.std '-1'"),
    "gains": ("schema: drivetool/gains/1\n", "drivetool/parameters/1 goes to --gains"),
    "nan": (PREFIX + "{motor.inertia: .nan}", "between nan"),
    "total and part": (PREFIX + "{total.viscous: 1, load.viscous: 1}", "either total.viscous Delete"),
    "infinite": (PREFIX + "{motor.inertia: .inf}", "between inf"),
    "wrong unit": (PREFIX + "{motor.inertia: {value: 1, unit: Nm}}", "motor.inertia in kg m^2 unit 'Nm'"),
    "unknown unit": (PREFIX + "{motor.inertia: {value: 1, unit: furlong}}", "unit 'furlong'"),
    "parameters as list": (PREFIX + "[1]", "a mapping at parameters a list of 1"),
    "drive as text": (HEAD + "drive: two-mass\n", "a mapping at drive text 'two-mass'"),
    "drive name": (HEAD + "drive: {name: tow-mass}\n", "'tow-mass' two-mass"),
    "bodies": (HEAD + "drive: {bodies: [a, b], shafts: []}\n", "one shaft fewer than bodies"),
    "same names": (HEAD + "drive: {bodies: [a, b], shafts: [a]}\n", "each used once 'a'"),
    "shafts only": (HEAD + "drive: {shafts: [a]}\n", "only shafts"),
    "taken name": (HEAD + "drive: {bodies: [total]}\n", "'total'"),
    "torque unit": (HEAD + "drive: {torque_unit: kNm}\n", "one of Nm, N, A"),
    "other torque": (HEAD + "drive: {torque_unit: A}\n", "in Nm, the unit of the recording A in"),
    "finding": (HEAD + "findings: [{severity: bad, code: a, text: b}]", "findings[0].severity note, warning"),
    "findings": (HEAD + "findings: 3", "a list at findings '3'"),
    "covariance": (HEAD + "covariance: {names: [motor.inertia], matrix: [[1, 2]]}", "1 x 1"),
    "fit": (HEAD + "fit: {rmse: [1]}", "fit a list"),
}


def test_stds_and_starts_come_in_the_units_of_the_drive(tmp_path):
    path = tmp_path / "fitted.yaml"
    path.write_text(PREFIX + "{shaft.stiffness: {value: 2, unit: kNm/rad, std: 0.1, start: 3}, load.inertia: 4, "
                    "motor.inertia: {value: 1, unit: kg m^2, std: 0, start: 0}}")
    loaded = load_parameters([path])
    assert loaded.stds(two_mass()) == {"shaft.stiffness": 100.0}
    assert loaded.starts(two_mass()) == {"shaft.stiffness": 3000.0, "motor.inertia": 0.0}


@pytest.mark.parametrize("text, words", BAD.values(), ids=BAD)
def test_bad_input_is_one_clear_sentence(tmp_path, text, words):
    path = tmp_path / "hand.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(BadParameters) as caught:
        load_parameters([path]).stated(two_mass())
    message = str(caught.value)
    assert "hand.yaml" in message and "\n" not in message
    assert message.startswith("wanted ") and message.endswith((".", "?"))
    assert str(tmp_path) not in message
    for word in words.split():
        assert word in message


def test_missing_file_and_second_standard_input():
    with pytest.raises(BadParameters, match="No such file"):
        load_parameters(["nowhere.yaml"])
    with pytest.raises(BadParameters, match="twice"):
        load_parameters(["-", "-"])


def test_a_file_written_by_hand(tmp_path):
    path = tmp_path / "hand.yaml"
    path.write_text(HEAD + "drive: {name: two-mass, damping_law: always}\nparameters:\n"
                    "  motor.inertia: {value: 0.4, unit: kg m^2}\n  load.inertia: 56000 # bare\n"
                    "  shaft.half_gap: {value: 4.3, unit: deg}\n  shaft.damping: 1e-1\n"
                    "  motor.viscous: {value: null, reason: unknown}\n")
    drive = load_parameters([path]).stated().start
    assert drive.damping_law == "always"
    assert drive.values == pytest.approx({
        "motor.inertia": 0.4, "load.inertia": 56000.0, "shaft.half_gap": math.radians(4.3),
        "shaft.damping": 0.1})


def test_later_files_win_and_totals_displace_parts(tmp_path):
    first, second = tmp_path / "a.yaml", tmp_path / "b.yaml"
    first.write_text(PREFIX + "{motor.inertia: 1, total.viscous: 0.2}\nnoise: {torque_std: 2}")
    second.write_text(PREFIX + "{motor.inertia: 2, motor.viscous: 0.1, load.viscous: 0.1}")
    loaded = load_parameters([first, second])
    assert loaded.stated().start.values == {"motor.inertia": 2, "motor.viscous": 0.1, "load.viscous": 0.1}
    assert loaded.noise == {"torque_std": 2}
    assert [name for name, _ in loaded.inputs] == ["a.yaml", "b.yaml"]
    assert load_parameters([second, first]).stated().start.values == {"motor.inertia": 1, "total.viscous": 0.2}


def test_own_bodies_and_default_structure(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text(HEAD + "drive: {bodies: [motor, gear, arm, tool]}\nparameters: {arm.inertia: 3}")
    drive = load_parameters([path]).stated().start
    assert drive.shafts == ("shaft", "shaft2", "shaft3") and drive.values == {"arm.inertia": 3}
    path.write_text(PREFIX + "{motor.inertia: 3}")
    assert load_parameters([path]).stated(one_body("N", "m")).start == one_body("N", "m").with_values(
        {"motor.inertia": 3})
    assert load_parameters([]).stated(one_body()).start == one_body()


@pytest.mark.parametrize("written, wanted, expected", [
    ("kg cm^2", "kg m^2", 1e-4), ("g m^2", "kg m^2", 1e-3), ("kgm^2", "kg m^2", 1),
    ("kgcm^2", "kg m^2", 1e-4),
    ("Nm s^2/rad", "kg m^2", 1), ("kg m²", "kg m^2", 1), ("kg*m**2", "kg m^2", 1), ("g", "kg", 1e-3),
    ("Nm/deg", "Nm/rad", 180 / math.pi), ("kNm/rad", "Nm/rad", 1e3), ("Nm/mrad", "Nm/rad", 1e3),
    ("Nm", "Nm/rad", None), ("Nm/(rad/s)", "Nm s/rad", 1), ("Nms/rad", "Nm s/rad", 1),
    ("Nm/rpm", "Nm s/rad", 30 / math.pi), ("mNm", "Nm", 1e-3), ("N m", "Nm", 1), ("N", "Nm", None),
    ("mrad", "rad", 1e-3), ("°", "rad", math.pi / 180), ("mm", "m", 1e-3), ("µm", "m", 1e-6),
    ("ms", "s", 1e-3), ("Hz", "rad/s", 2 * math.pi), ("mA", "A", 1e-3), ("N/mm", "N/m", 1e3),
    ("A s^2/rad", "A s^2/rad", 1), ("mA s^2/rad", "A s^2/rad", 1e-3), ("-", "", 1), ("%", "", 0.01),
    ("mNm/A", "Nm/A", 1e-3), ("Nm/kA", "Nm/A", 1e-3), ("kN/mV", "N/V", 1e6), ("Nm/%", "Nm/%", 1.0),
    ("mNm/%", "Nm/%", 1e-3), ("Nm", "Nm/%", None), ("Nm/%", "Nm", None), ("Nm/V", "Nm/A", None),
    ("N/A", "Nm/A", None), ("% s/deg", "% s/rad", 180 / math.pi), ("", "%", None), ("kg m^2 %", "kg m^2", None),
    ("%", "Nm", None), ("V s", "Nm/A", 1.0),
    ("", "Nm", None), ("Nm/", "Nm", None), ("(Nm", "Nm", None), ("Nm)", "Nm", None), ("€", "Nm", None),
])
def test_units(written, wanted, expected):
    if expected is None:
        with pytest.raises(BadParameters):
            units.conversion_factor(written, wanted, "x")
    else:
        assert units.conversion_factor(written, wanted, "x") == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("written, found", [
    ("mNm/kA", ("Nm", "A")), ("kN/A", ("N", "A")), ("Nm/mV", ("Nm", "V")), ("N m/%", ("Nm", "%")), ("Nm", None),
    ("", None), ("Nm/rad", None), ("Nm//", None)])
def test_a_torque_constant_says_both_units(written, found):
    assert units.torque_over_input(written) == found


def test_units_of_files_are_those_of_the_section_and_of_torque_constants(tmp_path):
    path = tmp_path / "x.yaml"
    for text, expected in (
            ("parameters: {motor.torque_constant: {value: 2, unit: N/mV}}", ("N", "rad", "V")),
            ("parameters: {motor.torque_constant: 2}", ("Nm", "rad", "")),
            ("drive: {torque_unit: N, input_unit: '%'}\nparameters: {motor.torque_constant: 2}", ("N", "rad", "%")),
            ("parameters: {motor.torque_constant: {value: null, unit: N/V}}", ("Nm", "rad", ""))):
        path.write_text(HEAD + text)
        assert load_parameters([path]).own_units == expected
    path.write_text(HEAD + "parameters: {motor.torque_constant: {value: 2, unit: kN/V}}")
    assert load_parameters([path]).stated().start.values == {"motor.torque_constant": 2000.0}
    path.write_text(HEAD + "drive: {input_unit: A}\nparameters: {motor.torque_constant: 2}")
    with pytest.raises(BadParameters, match=r"motor's input in V, the unit of the recording; found A in x"):
        load_parameters([path]).stated(two_mass("Nm", "rad", "V"))


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_have_ten_digits_and_stay_numbers(value):
    text = number_text(value)
    read = yaml.safe_load(text)  # YAML 1.1, as other tools read it
    assert isinstance(read, float) and math.isfinite(read)
    assert read == pytest.approx(value, rel=5e-10, abs=1e-320)
    assert number_text(read) == text and number_text(float(text)) == text
    assert from_yaml(to_yaml({"x": value}), "x") == {"x": read}


@pytest.mark.slow
@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
                    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)))
def test_any_plain_value_survives(value):
    text = to_yaml({"x": value}).encode("utf-8")
    assert from_yaml(text, "x") == {"x": to_plain(value)}
    assert json.loads(to_json({"x": value}).encode("utf-8")) == {"x": to_plain(value)}


@pytest.mark.parametrize("name, written", [
    ("Größe.parquet", "Größe.parquet"), ("試験 1.mcap", "試験 1.mcap"), ("µ°²€.csv", "µ°²€.csv"),
    ("\U0001f600", "\U0001f600"),
    # A byte that is no text, and characters that a terminal obeys or that YAML takes for line breaks.
    (b"a\xff".decode("utf-8", "surrogateescape"), r"a\udcff"), ("a\x9bb", r"a\x9bb"), ("a\x85b", r"a\Nb"),
    ("a\u2028b", r"a\Lb"), ("a\x1bb", r"a\eb"),
])
def test_text_is_written_as_it_is_unless_it_cannot_be_seen(name, written):
    for text in (to_yaml({"file": name, "list": [name]}), to_json({"file": name, "list": [name]})):
        if name == written:
            assert text.count(name) == 2
        assert from_yaml(text.encode("utf-8"), "x") == {"file": name, "list": [name]}
    assert written.lower() in to_yaml({"file": name}).lower()


def test_no_sets_and_no_objects_in_files():
    for value in ({1, 2}, object()):
        with pytest.raises(TypeError, match="cannot be written to a file"):
            to_plain({"x": value})


def test_channel_map(tmp_path):
    assert load_channel_map(None) is None
    path = tmp_path / "map.yaml"
    path.write_text("schema: drivetool/channel-map/1\nroles: {motor_torque: {channel: T, unit: Nm}}\n")
    assert load_channel_map(path).roles["motor_torque"].channel == "T"
    path.write_text("")
    with pytest.raises(BadParameters, match=r"map\.yaml empty"):
        load_channel_map(path)
    with pytest.raises(BadParameters, match="No such file"):
        load_channel_map(tmp_path / "none.yaml")
