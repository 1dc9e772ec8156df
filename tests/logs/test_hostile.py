"""Files as nobody should write them, through the commands: one clear sentence or what is left, and no file."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer

N = 2000
TIME = np.arange(N) * 1e-3
SPEED = 40 + np.repeat([0.0, 10.0, 20.0, -80.0], N // 4) + 0.01 * np.random.default_rng(1).normal(size=N)
TORQUE = 5 * np.sign(SPEED) + 0.1 * SPEED
UNITS = {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s", "motor_angle": "rad"}
MAP = """schema: drivetool/channel-map/1
roles: {motor_torque: {channel: torque, unit: Nm}, motor_speed: {channel: speed, unit: rad/s}}
"""


@pytest.fixture(autouse=True)
def folder(here):
    (here / "map.yaml").write_text(MAP)
    return here


def parquet(columns=(), units=(), metadata=None, path="a.parquet"):
    """The usual table with some columns (name, values) put in the place of others, or beside them."""
    named = dict(columns)
    listed = [(name, named.pop(name, values)) for name, values in
              (("time", TIME), ("motor_torque", TORQUE), ("motor_speed", SPEED))]
    arrays = [(name, pa.array(values)) for name, values in [*listed, *named.items()] if values is not None]
    known = {**UNITS, **dict(units)}
    fields = [pa.field(name, a.type, metadata={"unit": known[name]} if known.get(name) else None)
              for name, a in arrays]
    pq.write_table(pa.table([a for _, a in arrays], schema=pa.schema(fields, metadata)), path)


def twice():
    schema = pa.schema([pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in (
        ("time", "s"), ("motor_torque", "Nm"), ("motor_torque", "Nm"), ("motor_speed", "rad/s"))])
    pq.write_table(pa.table([TIME, TORQUE, TORQUE, SPEED], schema=schema), "a.parquet")


def mixed_units():
    pq.write_table(pa.table({"channel": ["motor_torque", "motor_speed"] * N, "time": np.repeat(TIME, 2),
                             "value": np.column_stack([TORQUE, SPEED]).ravel(),
                             "unit": ["Nm", "rad/s"] * (N - 1) + ["kNm", "rad/s"]}), "a.parquet")


def mcap(messages, encoding="json", schema=("d", "jsonschema", b"{}"), publish=None):
    with open("a.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        cid = writer.register_channel("/d", encoding, writer.register_schema(*schema) if schema else 0)
        for k, message in enumerate(messages):
            at = 10**18 + k * 10**6
            writer.add_message(cid, at, message, at if publish is None else publish, k)
        writer.finish()


def texts(torque):
    return [f'{{"speed": {json.dumps(s)}, "torque": {torque(k)}}}'.encode() for k, s in enumerate(SPEED.tolist())]


# How it is written, what inspect says of it (None: it refuses, too), what the others answer.
CASES = {
    "an empty table": (lambda: parquet([(n, v[:0]) for n, v in (("time", TIME), ("motor_torque", TORQUE),
                                                                ("motor_speed", SPEED))]),
                       None, "wanted samples in a.parquet; found a table without rows"),
    "only NaN": (lambda: parquet([("motor_speed", np.full(N, np.nan))]),
                 "found none in channel 'motor_speed'", "values of motor_speed in a.parquet; found none"),
    "texts for numbers": (lambda: parquet([("motor_speed", [str(v) for v in SPEED])]),
                          "motor_speed of a.parquet cannot be read: string",
                          "in channel 'motor_speed'; found string"),
    "texts for times": (lambda: parquet([("time", [f"12:00:{t}" for t in TIME])]), None,
                        "numbers or time stamps in the time column 'time' of a.parquet; found string. Name"),
    "days for times": (lambda: parquet([("time", pa.array(np.arange(N, dtype=np.int32), pa.date32()))]), None,
                       "numbers or time stamps in the time column 'time' of a.parquet; found date32"),
    "whole numbers without a unit for times": (
        lambda: parquet([("time", (TIME * 1e9).astype(np.int64))], {"time": None}), None,
        "a unit of time for the integer time column 'time' of a.parquet; found none (available: s, ms, us, ns)"),
    "two columns of one name": (twice, "motor_torque of a.parquet cannot be read: 2 columns have this name",
                                "one column 'motor_torque' in a.parquet; found 2"),
    "a channel in two units": (mixed_units, "cannot be read: it comes in several units (",
                               "one unit of channel 'motor_torque' in a.parquet; found it comes in several units"),
    "counts of an unknown encoder": (lambda: parquet([("motor_angle", np.arange(N, dtype=np.uint16))],
                                                     {"motor_angle": "counts"}),
                                     "counts per revolution of motor_angle", "to its role, for example `per_rev"),
    "a torque in a unit of speed": (lambda: parquet(units={"motor_torque": "rpm"}), "'rpm', a unit of speed",
                                    "a unit of speed (available: Nm, mNm, kNm, N, kN, A, mA, kA, V, mV, kV, %, 1)"),
    "a unit that is no text": (lambda: parquet(units={"motor_torque": b"\xff\xfe"}), "the unknown unit",
                               "a unit of torque for motor_torque"),
    "a unit of time that is no text": (lambda: parquet(units={"time": b"\xff\xfe"}), None, "a unit of time for"),
    "too many infinite torques": (
        lambda: parquet([("motor_torque", np.where(np.arange(N) % 12 > 3, TORQUE, np.inf))]),
        "since the torque has no value at 668 of 2000", "has no value at 668 of 2000"),
    "numbers that no drive reaches": (lambda: parquet([("motor_speed", 1e300 * SPEED)]), "values of motor_speed",
                                      "values of motor_speed in a.parquet; found none"),
    "a clock that stands": (lambda: parquet([("time", np.zeros(N))]), "2000 at one time",
                            "samples of motor_torque at different times in a.parquet; found 2000 at one time"),
    "a clock that runs backwards": (lambda: parquet([("time", TIME[::-1].copy())]), "does not go backwards",
                                    "time that does not go backwards for motor_torque, motor_speed in a.parquet"),
    "a clock that leaps by years": (lambda: parquet([("time", TIME + 1e9 * (TIME > 1))]), "one stretch of time",
                                    "Cut the record into files, one per run"),
    "other names": (lambda: parquet([("motor_torque", None), ("motor_speed", None), ("Drehmoment", TORQUE)]),
                    "available: Drehmoment", "channels named like the roles"),
    "magic bytes around nothing": (lambda: Path("a.parquet").write_bytes(b"PAR1" + bytes(99) + b"PAR1"), None,
                                   "a Parquet file in a.parquet; found something else"),
    "no messages": (lambda: mcap([]), None, "messages in a.mcap; found none that can be read"),
    "messages that are no JSON": (lambda: mcap([b"\xff"] * 99), "cannot be read: messages that are no JSON objects",
                                  "/d (messages that are no JSON objects)"),
    "lists in JSON": (lambda: mcap([b"[1]"] * 99), "cannot be read: messages that are no JSON objects",
                      "only /d (messages that are no JSON objects)"),
    "a type within itself": (lambda: mcap([b"\0\1\0\0" + bytes(80)] * 99, "cdr",
                                          ("x/msg/Y", "ros2msg", b"Y y\nfloat64 torque\n")),
                             "messages that do not match their schema", "that do not match their schema"),
    "half of the channels": (lambda: mcap([b'{"torque": 1}'] * 99), "no channel 'speed' for motor_speed",
                             "found no such channel in a.mcap (available: /d.torque)"),
    "texts in JSON": (lambda: mcap(texts(lambda k: '"1"')), "no channel 'torque'", "'torque' for motor_torque"),
    "another encoding": (lambda: mcap([b"x"] * 99, "msgpack"), "/d of a.mcap cannot be read: encoding msgpack",
                         "topics of a.mcap that can be read (json, cdr, ros1, protobuf); found only /d (encoding"),
}
# convert passes on the clock as it is, and values where there are some.
CONVERTED = {"too many infinite torques", "a clock that stands", "a clock that runs backwards",
             "a clock that leaps by years"}


@pytest.mark.parametrize("case", CASES)
def test_one_sentence_and_no_file(folder, call, case):
    write, message, refused = CASES[case]
    write()
    log = next(path.name for path in folder.glob("a.*"))
    mapped = ["--map", "map.yaml"] if log == "a.mcap" else []
    before = sorted(path.name for path in folder.iterdir())
    code, out, err = call("inspect", log, *mapped)
    if message is None:
        assert code == 1 and out == "" and err.count("\n") == 1 and refused in err
    else:
        assert code == 0 and message in err, err
    for words in (["steady", log, "-o", "out.yaml"], ["convert", log, "-o", "out.parquet"]):
        if words[0] == "convert" and case in CONVERTED:
            continue
        code, out, err = call(*words, *mapped)
        assert code == 1 and out == "" and err.count("\n") == 1, err
        assert refused in err and "unexpected" not in err
        assert sorted(path.name for path in folder.iterdir()) == before


FINE = {
    "time stamps with a zone": lambda: parquet([("time", pa.array(
        np.round(TIME * 1e9).astype(np.int64), pa.timestamp("ns", tz="Europe/Berlin")))]),
    "unsigned nanoseconds": lambda: parquet([("time", np.round(TIME * 1e9 + 1e12).astype(np.uint64))],
                                            {"time": "ns"}),
    "durations": lambda: parquet([("time", pa.array(np.round(TIME * 1e6).astype(np.int64), pa.duration("us")))]),
    "dictionaries": lambda: parquet([("time", pa.array(TIME).dictionary_encode()),
                                     ("motor_speed", pa.array(SPEED).dictionary_encode())]),
    "an origin that is none": lambda: parquet(metadata={"origin": "yesterday"}),
    "a column beside them that appears twice": lambda: pq.write_table(pa.table(
        [TIME, TORQUE, SPEED, TIME, TIME], schema=pa.schema(
            [pa.field(n, pa.float64(), metadata={"unit": UNITS.get(n, "s")})
             for n in ("time", "motor_torque", "motor_speed", "x", "x")])), "a.parquet"),
}


@pytest.mark.parametrize("case", FINE)
def test_the_same_as_the_plain_table(folder, case):
    from drivetool.logs.door.build import open_experiment

    parquet(path="plain.parquet")
    FINE[case]()
    plain, found = open_experiment("plain.parquet"), open_experiment("a.parquet")
    assert found.segments == plain.segments and found.findings == ()
    np.testing.assert_allclose(found.time, plain.time, rtol=0, atol=1e-12)
    for role, values in plain.signals.items():
        np.testing.assert_array_equal(found.signals[role], values)


def test_single_precision_is_used_as_it_is(folder):
    from drivetool.logs.door.build import open_experiment

    parquet([("time", TIME.astype(np.float32)), ("motor_speed", SPEED.astype(np.float32))])
    found = open_experiment("a.parquet")
    assert found.step == pytest.approx(1e-3, rel=1e-6) and found.segments == ((0, N),)
    np.testing.assert_array_equal(found.signals["motor_speed"], SPEED.astype(np.float32).astype(float))


def test_numbers_too_large_for_a_float_are_missing(folder):
    from drivetool.files.yaml import load_channel_map
    from drivetool.logs.door.build import open_experiment

    mcap(texts(lambda k: "1" + "0" * 400 if k == 7 else json.dumps(TORQUE.tolist()[k])))
    found = open_experiment("a.mcap", load_channel_map("map.yaml"))
    assert {f.code for f in found.findings} >= {"samples-missing"}
    assert np.isfinite(found.signals["motor_torque"]).sum() >= N - 1


def test_the_folder_one_stands_in(folder, call):
    (folder / "parts").mkdir()
    (folder / "parts" / "_SUCCESS").touch()
    for k in range(2):
        pq.write_table(pa.table({"time": TIME[k::2], "x": SPEED[k::2]}), f"parts/{k}.parquet")
    pq.write_table(pa.table({"y": SPEED}), "parts/2.parquet")
    for where, name in ((".", "parts"), ("parts", ".")):
        with contextlib.chdir(folder / where):
            code, _, err = call("inspect", name)
        assert code == 1 and "the same columns in all files of parts; found y in 2.parquet" in err
