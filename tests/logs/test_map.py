"""The channel map: its forms, and one clear sentence for each way to get it wrong."""

import re

import msgspec
import pytest

from drivetool.errors import BadOption, BadRecording
from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap, ChannelMapFile, choose_channels, resolve_channel
from drivetool.logs.roles import ROLES, role_of


def mapping(roles=None, **more):
    return {"schema": SCHEMA, "roles": roles if roles is not None else {"motor_torque": "iq"}, **more}


def test_long_and_short_form():
    found = ChannelMap.from_mapping(mapping(
        {"motor_torque": {"channel": "/drive.torque", "unit": "Nm", "scale": 2, "offset": 1, "sign": -1},
         "motor_speed": {"channel": "n", "unit": "%", "rated": {"value": 3000, "unit": "rpm"}},
         "motor_angle": "theta"},
        time={"channel": "t", "unit": "ms"}, torque_is="command"))
    torque, speed, angle = (found.roles[r] for r in ("motor_torque", "motor_speed", "motor_angle"))
    assert (torque.channel, torque.scale, torque.offset, torque.sign) == ("/drive.torque", 2.0, 1.0, -1)
    assert (speed.rated.value, speed.rated.unit) == (3000.0, "rpm")
    assert (angle.channel, angle.unit, angle.scale, angle.sign) == ("theta", None, 1.0, 1)
    assert (found.time.channel, found.time.unit, found.torque_is) == ("t", "ms", "command")


def test_defaults_and_short_time():
    found = ChannelMap.from_mapping(mapping(time="stamp"))
    assert found.time.channel == "stamp" and found.time.unit is None
    assert found.torque_is == "unknown"


def test_yaml_writes_small_numbers_as_texts():
    found = ChannelMap.from_mapping(mapping({"motor_torque": {"channel": "x", "scale": "1e-3"}}))
    assert found.roles["motor_torque"].scale == 1e-3


@pytest.mark.parametrize(("content", "words"), [
    (None, ["NoneType", "schema, roles"]),
    ([1], ["list"]),
    ({"roles": {"motor_torque": "x"}}, ["schema: drivetool/channel-map/1", "None"]),
    ({"schema": "drivetool/channel-map/7", "roles": {"motor_torque": "x"}},
     ["channel-map/7", "channel-map/1"]),
    (mapping(role={}), ["'role'", "Did you mean 'roles'?"]),
    (mapping({}), ["at least one role", "motor_torque"]),
    (mapping({"motor_torqe": "x"}), ["'motor_torqe'", "Did you mean 'motor_torque'?"]),
    (mapping({"motor_torque": {"chanel": "x"}}), ["'chanel'", "Did you mean 'channel'?", "motor_torque"]),
    (mapping({"motor_torque": {"unit": "Nm"}}), ["channel"]),
    (mapping({"motor_torque": 3}), ["motor_torque", "int"]),
    (mapping({"motor_torque": {"channel": "x", "unit": "Nmm"}}), ["Nmm", "mNm", "motor_torque"]),
    (mapping({"motor_torque": {"channel": "x", "unit": "rpm"}}), ["rpm", "unit of speed", "kNm"]),
    (mapping({"shaft_torque": {"channel": "x", "unit": "%"}}),
     ["rated value", "rated: {value: 200, unit: Nm}"]),
    (mapping({"shaft_torque": {"channel": "x", "unit": "mV"}}), ["shaft_torque in Nm or N", "'mV'", "scale: 50"]),
    (mapping({"load_torque": {"channel": "x", "unit": "V"}}), ["load_torque in Nm or N", "'V'"]),
    (mapping({"motor_torque": {"channel": "x", "unit": "%", "rated": {"value": 200}}}), ["unit"]),
    (mapping({"motor_torque": {"channel": "x", "unit": "%", "rated": {"valu": 200, "unit": "Nm"}}}),
     ["'valu'", "Did you mean 'value'?"]),
    (mapping({"motor_torque": {"channel": "x", "unit": "%", "rated": {"value": 200, "unit": "%"}}}),
     ["100 %"]),
    (mapping({"motor_torque": {"channel": "x", "unit": "%", "rated": {"value": 0, "unit": "Nm"}}}),
     ["rated value", "zero"]),
    (mapping({"motor_torque": {"channel": "x", "sign": 2}}), ["sign"]),
    (mapping({"motor_torque": {"channel": "x", "scale": 0}}), ["scale", "zero"]),
    (mapping({"motor_torque": {"channel": "x", "scale": float("inf")}}), ["scale"]),
    (mapping({"motor_torque": {"channel": "x", "scale": "fast"}}), ["scale"]),
    (mapping(time={"chan": "t"}), ["'chan'", "Did you mean 'channel'?"]),
    (mapping(time={"channel": "t", "unit": "rpm"}), ["time", "rpm", "ms"]),
    (mapping(torque_is="guess"), ["torque_is"]),
])
def test_mistakes(content, words):
    with pytest.raises(BadOption) as caught:
        ChannelMap.from_mapping(content, "map.yaml")
    for word in words:
        assert word in str(caught.value)


def test_the_type_gives_a_schema_with_every_role():
    roles = msgspec.json.schema(ChannelMapFile)["$defs"]["ChannelMapFile"]["properties"]["roles"]
    pattern = roles["propertyNames"]["pattern"]
    for role in (*ROLES, "gear_speed", "wheels_angle", "shaft2_torque"):
        assert re.search(pattern, role) and role_of(role)
    for name in ("time", "motor", "2_speed", "motor_current", "_speed"):
        assert not re.search(pattern, name) and role_of(name) is None


def test_plain_names_are_found_when_unambiguous():
    assert resolve_channel("torque", ["/drive.torque", "/drive.speed"]) == "/drive.torque"
    assert resolve_channel("torque", ["torque", "/drive.torque"]) == "torque"
    assert resolve_channel("torq", ["/drive.torque"]) is None
    with pytest.raises(BadRecording, match=r"/a\.torque, /b\.torque"):
        resolve_channel("torque", ["/a.torque", "/b.torque"])


def test_channels_are_chosen():
    assert choose_channels(["time2", "/d.motor_torque", "/d.motor_speed", "x"], None, "log") == {
        "motor_torque": "/d.motor_torque", "motor_speed": "/d.motor_speed"}
    with pytest.raises(BadRecording, match=r"none in log.*available: a, b"):
        choose_channels(["a", "b"], None, "log")
    with pytest.raises(BadRecording, match=r"'torque_act' for motor_torque.*Did you mean 'torque_act1'"):
        choose_channels(["torque_act1", "b"],
                        ChannelMap.from_mapping(mapping({"motor_torque": "torque_act"})), "log")
