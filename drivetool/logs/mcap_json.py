"""MCAP with JSON messages: channels are called `/topic.field`, nested fields with further dots."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from drivetool.errors import BadRecording, Finding
from drivetool.logs.channel_map import ChannelMap
from drivetool.logs.experiment import Channel, Recording
from drivetool.logs.units import parse_unit

if TYPE_CHECKING:
    from drivetool.logs.read import Choose

# Messages decoded at a time: the decoded form takes ten times the space of the values.
BLOCK = 20_000
_NS = 10**9


@dataclass
class Topic:
    """What was collected of one topic: encodings seen, schema, and the messages undecoded."""

    encoding: str
    schema: dict
    log_time: list[int] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)


def read_mcap(path: Path, sha256: str, choose: Choose, channel_map: ChannelMap | None) -> Recording:
    """An MCAP log with JSON messages; a file that was cut short is used as far as it can be read.

    choose   called with the names of all numeric channels; returns those to decode
    returns  Recording, one clock per topic: the log time, or the field that the map names as time;
             units from the property `unit` in the topic's JSON schema
    raises   BadRecording: not MCAP, no readable message, no topic in JSON
    """
    topics, findings = _collect(path)
    readable = {name: t for name, t in topics.items() if t.encoding == "json"}
    others = ", ".join(f"{name} ({t.encoding or 'none'})"
                       for name, t in topics.items() if t.encoding != "json")
    if topics and not readable:
        raise BadRecording(f"messages in JSON in {path.name}", f"other encodings: {others}",
                           "Record or convert it with message encoding json, or to Parquet.")
    if not readable:
        raise BadRecording(f"messages in {path.name}", "none that can be read", "Record or export it again.")
    names = {f"{name}.{'.'.join(keys)}": (name, keys)
             for name, topic in readable.items() for keys in _numeric_fields(topic)}
    try:
        wanted = list(dict.fromkeys(choose(list(names))))
    except BadRecording as problem:
        if not others:
            raise
        raise BadRecording(
            problem.wanted, f"{problem.found}; topics in an encoding that is not read: {others}",
            problem.do, problem.available) from None
    by_topic: dict[str, list[tuple[str, ...]]] = {}
    for channel in wanted:
        topic, keys = names[channel]
        by_topic.setdefault(topic, []).append(keys)
    return _recording(path.name, sha256, {name: (readable[name], by_topic[name]) for name in by_topic},
                      channel_map, findings)


def _recording(log: str, sha256: str, wanted: dict, channel_map: ChannelMap | None,
               findings: list[Finding]) -> Recording:
    """Decode the wanted fields of each topic and put its clock beside them."""
    stamp = channel_map.time if channel_map else None
    columns, times = {}, {}
    for name, (topic, fields) in wanted.items():
        extra = [_time_field(name, stamp.channel, topic, log)] if stamp else []
        lists, kept, broken = _decode(topic.data, [*fields, *extra])
        if broken == len(topic.data):
            raise BadRecording(f"JSON objects in {name} of {log}", "none", "Check the recorder.")
        if broken:
            findings.append(Finding(
                "warning", "broken-messages",
                f"{broken} messages of {name} in {log} are not JSON objects; they are left out.",
                {"messages": broken, "of": len(topic.data)}, "Check the recorder."))
        times[name] = lists.pop() if stamp else [topic.log_time[i] for i in kept]
        columns[name] = [_floats(values, f"{name}.{'.'.join(keys)}", log)
                         for values, keys in zip(lists, fields, strict=True)]
    per_second = _NS
    if stamp:
        per_second = _ticks(wanted, stamp, times, log)
    clocks, origin = _clocks(times, per_second)
    channels = {}
    for name, (topic, fields) in wanted.items():
        for keys, values in zip(fields, columns[name], strict=True):
            channels[f"{name}.{'.'.join(keys)}"] = Channel(clocks[name], values, _unit(topic.schema, keys))
    return Recording(log, sha256, channels, tuple(findings), origin)


def _collect(path: Path) -> tuple[dict[str, Topic], list[Finding]]:
    """All messages by topic, undecoded, and what was wrong with the file."""
    from mcap.records import Channel as McapChannel
    from mcap.records import Message, Schema

    schemas, channels, topics, count = {}, {}, {}, 0
    damage: list[str] = []
    for record in _records(path, damage):
        if isinstance(record, Message) and record.channel_id in channels:
            topic = channels[record.channel_id]
            topic.log_time.append(record.log_time)
            topic.data.append(record.data)
            count += 1
        elif isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, McapChannel):
            channels[record.id] = topics.setdefault(record.topic, Topic(
                record.message_encoding, _schema(schemas.get(record.schema_id))))
    findings = []
    if damage:
        findings.append(Finding(
            "warning", "damaged-log", f"{path.name} is cut short or damaged "
            f"({', '.join(dict.fromkeys(damage))}); the {count} messages that can be read are used.",
            {"messages": count, "places": len(damage)},
            "Recover it with `mcap recover`, or record again."))
    return {name: topic for name, topic in topics.items() if topic.data}, findings


def _records(path: Path, damage: list[str]) -> Iterator:
    """The records in the order of the file; what cannot be read is noted in `damage`."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    started = False
    with path.open("rb") as file:
        # A damaged file fails anywhere (framing, decompression, text), with any exception.
        try:
            for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
                started = True
                if not isinstance(record, Chunk):
                    yield record
                    continue
                try:
                    inner = breakup_chunk(record, validate_crc=True)
                except Exception as problem:
                    damage.append(type(problem).__name__)
                else:
                    yield from inner
        except Exception as problem:
            if not started:
                raise BadRecording(f"an MCAP file in {path.name}", "something else",
                                   "Record or export it again.") from None
            damage.append(type(problem).__name__)


def _schema(record) -> dict:
    """The JSON schema of a topic; empty if it has none or it cannot be read."""
    if record is None or record.encoding != "jsonschema":
        return {}
    try:
        found = json.loads(record.data)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _numeric_fields(topic: Topic) -> list[tuple[str, ...]]:
    """Paths of the numeric fields: those of the first readable message, then those of the schema."""
    def walk(value, keys) -> Iterator[tuple[str, ...]]:
        if isinstance(value, dict):
            for key, inner in value.items():
                yield from walk(inner, (*keys, key))
        elif keys and (value is None or (isinstance(value, int | float) and not isinstance(value, bool))):
            yield keys

    def declared(schema, keys) -> Iterator[tuple[str, ...]]:
        properties = schema.get("properties")
        for key, inner in (properties.items() if isinstance(properties, dict) else ()):
            if isinstance(inner, dict):
                kinds = inner.get("type", ())
                kinds = {kinds} if isinstance(kinds, str) else set(kinds)
                if kinds & {"number", "integer"}:
                    yield (*keys, key)
                yield from declared(inner, (*keys, key))

    first = next((m for m in map(_loads, topic.data) if m is not None), {})
    return list(dict.fromkeys([*walk(first, ()), *declared(topic.schema, ())]))


def _unit(schema: dict, keys: Sequence[str]) -> str | None:
    """The property `unit` that the schema gives a field."""
    for key in keys:
        properties = schema.get("properties") if isinstance(schema, dict) else None
        schema = properties.get(key, {}) if isinstance(properties, dict) else {}
    unit = schema.get("unit") if isinstance(schema, dict) else None
    return unit if isinstance(unit, str) else None


def _loads(data: bytes) -> dict | None:
    """One message; unlike msgspec, json reads the NaN that many recorders write."""
    try:
        found = json.loads(data)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


def _decode(data: list[bytes], fields: list[tuple[str, ...]]) -> tuple[list[list], list[int], int]:
    """(values per field, indices of the messages they came from, number of broken messages)."""
    lists: list[list] = [[] for _ in fields]
    kept: list[int] = []
    for first in range(0, len(data), BLOCK):
        block = data[first:first + BLOCK]
        try:
            messages = msgspec.json.decode(b"[" + b",".join(block) + b"]", type=list[dict])
        except msgspec.DecodeError:
            messages = []
        if len(messages) != len(block):
            messages = [_loads(one) for one in block]
        good = [i for i, message in enumerate(messages) if message is not None]
        kept += [first + i for i in good]
        for values, keys in zip(lists, fields, strict=True):
            values += [_dig(messages[i], keys) for i in good]
    return lists, kept, len(data) - len(kept)


def _dig(message: dict, keys: tuple[str, ...]):
    """The value at a path, None if it is not there."""
    for key in keys:
        message = message.get(key) if isinstance(message, dict) else None
    return message


def _floats(values: list, name: str, log: str) -> np.ndarray:
    """(n,) floats, missing values as NaN."""
    try:
        return np.array([None if isinstance(v, str) else v for v in values], dtype=float)
    except (TypeError, ValueError):
        raise BadRecording(f"numbers in channel '{name}'", f"other values in {log}",
                           "Choose another channel.") from None


def _time_field(topic_name: str, name: str, topic: Topic, log: str) -> tuple[str, ...]:
    """Path of the field that the map names as time, within a topic."""
    for keys in _numeric_fields(topic):
        if name in (".".join(keys), f"{topic_name}.{'.'.join(keys)}"):
            return keys
    raise BadRecording(f"time field '{name}' in topic {topic_name}", f"none in {log}",
                       "Name a field that every mapped topic has, or leave `time` out to use the log time.")


def _ticks(wanted: dict, stamp, times: dict[str, list], log: str) -> float:
    """Units of the time field per second."""
    name, (topic, _) = next(iter(wanted.items()))
    unit = stamp.unit or _unit(topic.schema, _time_field(name, stamp.channel, topic, log))
    if unit is None and any(isinstance(v, float) for v in times[name]):
        unit = "s"
    found = parse_unit(unit, "time", f"the time field '{stamp.channel}' of {log}")
    return {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[found.text]


def _clocks(times: dict[str, list], per_second: int) -> tuple[dict[str, np.ndarray], float]:
    """Seconds per topic from one origin; whole ticks are counted from the first before they become floats."""
    if all(isinstance(v, int) for values in times.values() for v in values):
        first = min(values[0] for values in times.values())
        return ({name: np.array([v - first for v in values], dtype=np.int64) / per_second
                 for name, values in times.items()}, first / per_second)
    return {name: _floats(values, "time", name) / per_second for name, values in times.items()}, 0.0
