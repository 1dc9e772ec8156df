"""Several channels of one topic: continued, recorded twice, or several sources; each as it is, or refused."""

import json
from itertools import pairwise

import numpy as np
import pytest
from mcap.writer import Writer

from drivetool.errors import BadRecording
from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap
from drivetool.logs.door.build import open_experiment
from drivetool.logs.door.inspect import inspect_log
from drivetool.logs.formats.mcap.container import source
from drivetool.logs.formats.read import read_recording

START, STEP, N = 1_700_000_000_000_000_000, 1_000_000, 120
SPEED, TORQUE = np.arange(N) / 8, 1 - np.arange(N) / 4
OTHER_SPEED = 1000 + SPEED
ROLES = {"motor_torque": {"channel": "/axis.torque", "unit": "Nm"},
         "motor_speed": {"channel": "/axis.speed", "unit": "rad/s"}}
JSON_SCHEMA = ("drive", "jsonschema", b"{}")


def channel_map(topic="/axis", **more):
    roles = {role: {**entry, "channel": entry["channel"].replace("/axis", topic)} for role, entry in ROLES.items()}
    return ChannelMap.from_mapping({"schema": SCHEMA, "roles": roles, **more})


def content(**fields):
    return json.dumps({name: float(value) for name, value in fields.items()}).encode()


def messages(speed=SPEED, which=None, late=0, publish=0, first=0):
    """(log time, publish time, sequence, content) of some of the messages.

    late, publish  added to the log and the publish time [ns]; first: number of the first sequence
    """
    which = range(len(speed)) if which is None else which
    return [(START + k * STEP + late, START + k * STEP + publish, k + first,
             content(speed=speed[k], torque=TORQUE[k], k=k)) for k in which]


def write(path, *channels, chunk=2000):
    """A file of channels (messages, topic, schema, metadata; the last three as usual where left out)."""
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=chunk)
        writer.start()
        entries = []
        for sent, *rest in channels:
            topic, schema, metadata = (*rest, *("/axis", JSON_SCHEMA, {})[len(rest):])
            described = writer.register_schema(*schema) if schema else 0
            number = writer.register_channel(topic, "json", described, metadata)
            entries += [(log, number, publish, sequence, text) for log, publish, sequence, text in sent]
        for log, number, publish, sequence, text in sorted(entries, key=lambda entry: entry[:2]):
            writer.add_message(number, log, text, publish, sequence)
        writer.finish()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.mcap"


def everything(path):
    return read_recording(path, choose=list)


def refused(path, *names):
    """The map that names the topic is refused with the channels that there are; inspect lists them."""
    with pytest.raises(BadRecording) as problem:
        read_recording(path, channel_map())
    assert "one source of '/axis.torque' in a.mcap" in str(problem.value)
    assert problem.value.available == tuple(f"{name}.torque" for name in names)
    assert {name.partition(".")[0] for name in everything(path).channels} == set(names)
    assert any(f"(available: {names[0]}." in f.text for f in inspect_log(path, channel_map()).findings)


def values(path, topic="/axis"):
    found = read_recording(path, channel_map(topic))
    return found.channels[f"{topic}.speed"].values, [f.code for f in found.findings]


SEVERAL = {
    "other values at the same times": (messages(), messages(OTHER_SPEED)),
    "in turn": (messages(which=range(0, N, 2)), messages(OTHER_SPEED, range(1, N, 2))),
    "the same publish times and sequence at rest, but for the end": (
        messages(np.where(np.arange(N) < N - 4, 0, SPEED)),
        messages(np.where(np.arange(N) < N - 4, 0, OTHER_SPEED))),
    "overlapping at the end only": (messages(which=range(70)), messages(OTHER_SPEED, range(60, N))),
    "one beside the other for a while": (messages(), messages(OTHER_SPEED, range(40, 60))),
    "a single message among the others": (messages(), messages(OTHER_SPEED, [60])),
    "the same values at other times, without a common sequence": (
        messages(), messages(late=300_000, publish=300_000, first=7)),
    "all logged at one instant": tuple([(START, *m[1:]) for m in sent]
                                       for sent in (messages(), messages(OTHER_SPEED))),
    "a constant sequence": ([(*m[:2], 0, m[3]) for m in messages()],
                            [(*m[:2], 0, m[3]) for m in messages(late=5, publish=5)]),
}


@pytest.mark.parametrize("case", SEVERAL)
def test_several_publishers_are_several_sources(path, case):
    one, other = SEVERAL[case]
    write(path, (one,), (other,))
    refused(path, "/axis#1", "/axis#2")
    for name, sent in (("/axis#1", one), ("/axis#2", other)):
        found, codes = values(path, name)
        assert codes == [] and found.tolist() == [json.loads(text)["speed"] for *_, text in sent]


def test_names_follow_the_numbers_of_the_channels_not_the_order_of_the_file(path):
    write(path, (messages(OTHER_SPEED, range(1, N)),), (messages(),), (messages(TORQUE),))
    assert values(path, "/axis#1")[0].tolist() == OTHER_SPEED[1:].tolist()
    assert values(path, "/axis#2")[0].tolist() == SPEED.tolist()
    assert values(path, "/axis#3")[0].tolist() == TORQUE.tolist()


def test_a_topic_that_is_called_like_a_second_source(path):
    write(path, (messages(),), (messages(OTHER_SPEED),), (messages(TORQUE), "/axis#2"))
    assert values(path, "/axis#2")[0].tolist() == TORQUE.tolist()
    assert values(path, "/axis##2")[0].tolist() == OTHER_SPEED.tolist()


@pytest.mark.parametrize("second", [range(N), range(60, N), range(0, N, 2)], ids=["beside", "behind", "slower"])
@pytest.mark.parametrize("other", ["name", "text", "none"])
def test_other_schemas_are_other_sources(path, second, other):
    schema = {"name": ("drive2", *JSON_SCHEMA[1:]), "text": (*JSON_SCHEMA[:2], b'{"title": "x"}'),
              "none": None}[other]
    first = range(60) if second == range(60, N) else range(N)
    write(path, (messages(which=first),), (messages(OTHER_SPEED, second), "/axis", schema))
    refused(path, "/axis#1", "/axis#2")
    assert values(path, "/axis#2")[0].tolist() == OTHER_SPEED[second].tolist()


def test_other_units_are_other_sources_and_other_metadata_are_not(path):
    halves = messages(which=range(60)), messages(which=range(60, N))
    write(path, (halves[0], "/axis", JSON_SCHEMA, {"unit:speed": "rpm"}),
          (halves[1], "/axis", JSON_SCHEMA, {"unit:speed": "rad/s"}))
    refused(path, "/axis#1", "/axis#2")
    write(path, (halves[0], "/axis", JSON_SCHEMA, {"offered_qos_profiles": "1"}), (halves[1],))
    assert values(path)[0].tolist() == SPEED.tolist()


def test_the_topic_is_name_enough_where_one_source_has_the_field(path):
    stamps = [(log, publish, k, content(speed=speed, stamp=log / 1e9)) for (log, publish, k, _), speed in
              zip(messages(), OTHER_SPEED, strict=True)]
    torque = [(log, publish, k, content(torque=value, stamp=log / 1e9))
              for (log, publish, k, _), value in zip(messages(), TORQUE, strict=True)]
    write(path, (stamps,), (torque, "/axis", ("torque", "jsonschema", b"{}")))
    for time in ("/axis.stamp", "stamp", "log_time"):
        found = read_recording(path, channel_map(time=time))
        assert found.channels["/axis.speed"].values.tolist() == OTHER_SPEED.tolist()
        assert found.channels["/axis.torque"].values.tolist() == TORQUE.tolist()
    assert open_experiment(path, channel_map()).signals["motor_speed"].tolist() == OTHER_SPEED.tolist()


@pytest.fixture(params=[source.MAX_CACHED_BYTES, 3000])
def cached(monkeypatch, request):
    """Files that are kept in memory, and files that are read again for every topic."""
    monkeypatch.setattr(source, "MAX_CACHED_BYTES", request.param)


@pytest.mark.usefixtures("cached")
@pytest.mark.parametrize("cuts", [(0, 60, N), (0, 1, N), (0, 30, 31, 80, N)], ids=str)
def test_a_continued_topic_is_one_source(path, cuts):
    parts = [(messages(which=range(*cut)),) for cut in pairwise(cuts)]
    write(path, *parts, (messages(OTHER_SPEED), "/other"))
    assert values(path) == (pytest.approx(SPEED, abs=0), [])
    assert {name.partition(".")[0] for name in everything(path).channels} == {"/axis", "/other"}


def test_one_ends_at_the_instant_at_which_the_other_begins(path):
    later = [(log - STEP, *rest) for log, *rest in messages(which=range(60, N))]
    write(path, (messages(which=range(60)),), (later,))
    assert values(path)[0].tolist() == SPEED.tolist()


rng = np.random.default_rng(4)
LOSSY_RECORDERS = [np.flatnonzero(rng.random(N) > share).tolist() for share in (0.1, 0.2)]
TWICE = {
    "all of it": (messages(), messages(), 1),
    "received later": (messages(), messages(late=40_000), 1),
    "with other sequences": (messages(), messages(late=40_000, first=5), 1),
    "with publish times of their own": (messages(), messages(late=40_000, publish=40_000), 1),
    "the second longer": (messages(which=range(10, 80)), messages(late=7), 2),
    "overlapping": (messages(which=range(100)), messages(which=range(60, N), late=7), 1),
    "each lost some": (messages(which=LOSSY_RECORDERS[0]), messages(which=LOSSY_RECORDERS[1], late=7), 1),
    "the second lost more than half": (messages(), messages(which=range(0, N, 3), late=7), 1),
}


@pytest.mark.usefixtures("cached")
@pytest.mark.parametrize("case", TWICE)
def test_a_topic_recorded_twice_is_used_once_and_that_is_said(path, case):
    *channels, used = TWICE[case]
    write(path, *((sent,) for sent in channels), (messages(OTHER_SPEED), "/other"))
    found = read_recording(path, channel_map())
    assert found.channels["/axis.speed"].values.tolist() == [
        json.loads(text)["speed"] for *_, text in channels[used - 1]]
    (finding,) = found.findings
    assert (finding.severity, finding.code) == ("warning", "topic-duplicated")
    assert finding.evidence == {"topic": "/axis", "used": used, "messages": len(channels[used - 1]),
                                "left_out": 3 - used, "messages_left_out": len(channels[2 - used])}
    assert f"/axis is in a.mcap twice: channel {3 - used} duplicates the messages of channel {used}" in finding.text
    assert read_recording(path, channel_map("/other")).findings == ()
    assert {f.code for f in inspect_log(path, channel_map()).findings} >= {"topic-duplicated"}


def test_two_recorders_of_which_one_was_restarted(path):
    write(path, (messages(which=range(60)),), (messages(late=7),), (messages(which=range(60, N)),))
    found, codes = values(path)
    assert found.tolist() == SPEED.tolist() and codes == ["topic-duplicated"] * 2


def test_two_publishers_recorded_twice_stay_two(path):
    write(path, (messages(),), (messages(OTHER_SPEED),), (messages(late=7),), (messages(OTHER_SPEED, late=7),))
    refused(path, "/axis#1", "/axis#2")
    assert values(path, "/axis#2") == (pytest.approx(OTHER_SPEED, abs=0), ["topic-duplicated"] * 2)


def test_a_single_message_that_differs_makes_two_sources(path):
    other = messages(late=7)
    other[50] = (*other[50][:3], other[51][3])
    write(path, (messages(),), (other,))
    refused(path, "/axis#1", "/axis#2")
