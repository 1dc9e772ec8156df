"""Units: what is understood, what is refused, and that conversion is undone exactly enough."""

import math

import pytest
from hypothesis import given, strategies as st

from drivetool.errors import BadOption, BadRecording
from drivetool.logs.units import UNIT_TABLE, parse_unit, units_for

SPELLINGS = [
    ("Nm", "torque", "Nm", 1.0), ("N m", "torque", "Nm", 1.0), ("N*m", "torque", "Nm", 1.0),
    ("N·m", "torque", "Nm", 1.0), ("N.m", "torque", "Nm", 1.0), ("mNm", "torque", "Nm", 1e-3),
    ("kNm", "torque", "Nm", 1e3), ("kN", "torque", "N", 1e3), ("N", "torque", "N", 1.0),
    ("A", "torque", "A", 1.0), ("mA", "torque", "A", 1e-3),
    ("rad", "angle", "rad", 1.0), ("deg", "angle", "rad", math.pi / 180),
    ("°", "angle", "rad", math.pi / 180),
    ("mrad", "angle", "rad", 1e-3), ("rev", "angle", "rad", 2 * math.pi), ("m", "angle", "m", 1.0),
    ("mm", "angle", "m", 1e-3), ("um", "angle", "m", 1e-6),
    ("µm", "angle", "m", 1e-6), ("μm", "angle", "m", 1e-6),
    ("rad/s", "speed", "rad/s", 1.0), (" rad / s ", "speed", "rad/s", 1.0),
    ("deg/s", "speed", "rad/s", math.pi / 180), ("rpm", "speed", "rad/s", math.pi / 30),
    ("1/min", "speed", "rad/s", math.pi / 30), ("r/min", "speed", "rad/s", math.pi / 30),
    ("min^-1", "speed", "rad/s", math.pi / 30), ("rev/s", "speed", "rad/s", 2 * math.pi),
    ("m/s", "speed", "m/s", 1.0), ("mm/s", "speed", "m/s", 1e-3), ("km/h", "speed", "m/s", 1 / 3.6),
    ("s", "time", "s", 1.0), ("ms", "time", "s", 1e-3), ("us", "time", "s", 1e-6), ("ns", "time", "s", 1e-9),
    ("%", "torque", "1", 1e-2), ("%", "speed", "1", 1e-2), ("1", "torque", "1", 1.0),
]


@pytest.mark.parametrize(("text", "dimension", "si", "factor"), SPELLINGS)
def test_spellings(text, dimension, si, factor):
    unit = parse_unit(text, dimension, "x")
    assert unit.si == si
    assert unit.factor == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize(("text", "dimension", "words"), [
    ("Nmm", "torque", ["torque", "Nmm", "Did you mean", "mNm"]),
    ("bar", "torque", ["bar", "kNm", "mA"]),
    ("MNm", "torque", ["MNm"]),
    ("rad/s", "torque", ["rad/s", "unit of speed", "Nm"]),
    (None, "speed", ["none", "rad/s", "rpm", "channel map"]),
    ("  ", "speed", ["none"]),
    ("%", "time", ["relative", "ms"]),
    ("RPm", "speed", ["Did you mean 'rpm'"]),
])
def test_refused(text, dimension, words):
    with pytest.raises(BadRecording) as caught:
        parse_unit(text, dimension, "motor_x in log.parquet")
    for word in ["motor_x in log.parquet", *words]:
        assert word in str(caught.value)


def test_the_map_has_its_own_kind_of_error():
    with pytest.raises(BadOption):
        parse_unit("furlong", "angle", "x", BadOption)


@given(st.sampled_from(sorted(UNIT_TABLE)), st.floats(-1e9, 1e9))
def test_every_unit_has_its_factor(name, value):
    dimension = UNIT_TABLE[name][0]
    unit = parse_unit(name, "torque" if dimension == "relative" else dimension, "x")
    assert unit.text == name
    assert unit.to_si(value) == value * UNIT_TABLE[name][2]


def test_every_dimension_lists_its_units():
    assert units_for("time") == ("s", "ms", "us", "ns")
    assert set(units_for("speed")) == {"rad/s", "deg/s", "rpm", "rev/s", "m/s", "mm/s", "km/h", "%", "1"}
