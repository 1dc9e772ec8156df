"""MCAP to a Recording: channels are called `/topic.field`, further levels with dots and brackets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivetool.errors import BadRecording
from drivetool.finding import Finding
from drivetool.logs import Channel, Recording, display_name
from drivetool.logs.channels import ChannelMap, Choose, TimeEntry, field_path, resolve_channel
from drivetool.logs.clocks import find_batches
from drivetool.logs.formats.mcap.collector import Collector
from drivetool.logs.formats.mcap.container import McapSource
from drivetool.logs.formats.mcap.decoders import ENCODINGS, BrokenMessage, Fields, open_topic
from drivetool.logs.formats.mcap.stamps import LOG_TIME, MESSAGE_TIMES, seconds_from_common_origin, to_ticks

# Clocks that a message may have besides its receive time, in the order in which they are tried.
STAMP_CANDIDATES = ("publish_time", "header.stamp", "stamp", "timestamp")
FieldAddress = tuple[str, field_path.Path]


@dataclass(frozen=True)
class TopicPart:
    """What is read of a topic on one clock: channel name -> path, and the paths of the stamp, if any."""

    topic: str
    stamp: TimeEntry | None
    stamp_paths: tuple[field_path.Path, ...]
    channels: Mapping[str, field_path.Path]


def read_mcap(path: Path, choose: Choose, channel_map: ChannelMap | None,
              lenient: bool = False) -> Recording:
    """An MCAP log; one that was cut short or damaged is used as far as it can be read.

    choose   called with the names of all numeric channels; returns those to decode
    lenient  leave out what cannot be read instead of refusing the file
    returns  Recording, one clock per topic: log time, publish time or a stamp field, as the map says;
             units from the JSON schema, a comment `# [Nm]` in a ROS definition, or the channel's
             metadata `unit:<field>`
    raises   BadRecording: not MCAP, no readable message, no topic in a known encoding
    """
    source = McapSource(path)
    findings = _damage_findings(source)
    if not source.topics:
        found = "none that can be read"
        if source.damage:
            found += f" ({_damage_text(source.damage)})"
        raise BadRecording(f"messages in {display_name(path)}", found, "Record or export it again.")
    fields, unreadable = _open_topics(source)
    others = ", ".join(f"{name} ({why})" for name, why in unreadable.items())
    if not fields and not lenient:
        raise BadRecording(f"topics of {display_name(path)} that can be read ({', '.join(ENCODINGS)})",
                           f"only {others}", "Record or convert it with one of them, or to Parquet.")
    names = _channel_addresses(fields, channel_map, display_name(path), lenient)
    try:
        wanted = list(dict.fromkeys(choose(list(names))))
    except BadRecording as problem:
        if not others:
            raise
        raise BadRecording(problem.wanted, f"{problem.found}; topics that are not read: {others}",
                           problem.do, problem.available) from None
    parts = _group_by_clock(wanted, names, fields, channel_map, None, display_name(path), lenient)
    findings += _repeated_topic_findings(source, {source.topics[part.topic].topic for part in parts})
    channels, origin = _decode_parts(source, fields, parts, display_name(path), findings, unreadable, lenient)
    late = sorted({part.topic for part in parts if part.stamp is None
                   for name in part.channels if name in channels and find_batches(channels[name].time)})
    for stamp in STAMP_CANDIDATES if late else ():
        try:
            parts = _group_by_clock(wanted, names, fields, channel_map, TimeEntry(stamp), display_name(path),
                                    lenient)
            steady, begin = _decode_parts(source, fields, parts, display_name(path), [], unreadable, lenient)
        except BadRecording:
            continue
        if not any(find_batches(each.time) for each in steady.values()):
            channels, origin = steady, begin
            findings.append(_late_finding(late, stamp, display_name(path)))
            break
    ordered = {name: channels[name] for name in wanted if name in channels}
    return Recording(display_name(path), "", ordered, tuple(findings), origin, unreadable)


def _open_topics(source: McapSource) -> tuple[dict[str, Fields], dict[str, str]]:
    """(topics that can be read, why the others cannot)."""
    fields, unreadable = {}, {}
    for name, topic in source.topics.items():
        try:
            fields[name] = open_topic(topic)
        except BrokenMessage as problem:
            unreadable[name] = str(problem)
    return fields, unreadable


def _channel_addresses(fields: Mapping[str, Fields], channel_map: ChannelMap | None, log: str,
                       lenient: bool) -> dict[str, FieldAddress]:
    """Full name -> place of every listed channel, and of those that only the map names.

    raises  BadRecording: the map names a topic that several sources have, and more than one has the field
    """
    names = {f"{name}.{field_path.text_of(path)}": (name, path)
             for name, each in fields.items() for path in each.listed}
    mapped = [entry.channel for entry in channel_map.roles.values()] if channel_map else []
    for text in mapped:
        if text in names or any(name.endswith(f".{text}") for name in names):
            continue
        found: dict[str, FieldAddress] = {}
        for source, each in fields.items():
            rest = each.own(text)
            if rest == text and text.startswith("/"):
                continue
            path = each.path(rest)
            if path is not None:
                found[f"{source}.{rest}"] = (source, path)
        if not text.startswith("/"):
            names |= found
        elif len(found) == 1:  # also where other sources of the topic lack the field
            names[text] = next(iter(found.values()))
        elif found and not lenient:
            raise BadRecording(
                f"one source of '{text}' in {log}",
                f"{len(found)} that are neither consecutive nor duplicates",
                "Name one of them in the channel map.", found)
    return names


def _group_by_clock(wanted: Iterable[str], names: Mapping[str, FieldAddress], fields: Mapping[str, Fields],
           channel_map: ChannelMap | None, default: TimeEntry | None, log: str, lenient: bool) -> list[TopicPart]:
    """The wanted channels by topic and clock; `default` is that of what the map gives none."""
    own = {}
    for entry in channel_map.roles.values() if channel_map else ():
        name = resolve_channel(entry.channel, names) if entry.time else None
        if name:
            own.setdefault(name, entry.clock)
    groups: dict[tuple[str, TimeEntry | None], dict[str, field_path.Path]] = {}
    for name in wanted:
        topic, path = names[name]
        stamp = own.get(name) or (channel_map.time if channel_map else None) or default
        groups.setdefault((topic, stamp), {})[name] = path
    parts = []
    for (topic, stamp), channels in groups.items():
        paths: tuple[field_path.Path, ...] = ()
        if stamp is not None and stamp.channel not in MESSAGE_TIMES:
            found = fields[topic].stamp(fields[topic].own(stamp.channel))
            if found is None and not lenient:
                raise BadRecording(
                    f"time field '{stamp.channel}' in topic {topic}", f"none in {log}",
                    "Name a field that every mapped topic has, give single roles a `time` of their own, "
                    "or write log_time or publish_time.",
                    [field_path.text_of(each) for each in fields[topic].listed])
            paths, stamp = (found, stamp) if found else ((), None)
        parts.append(TopicPart(topic, stamp, paths, channels))
    return parts


def _decode_parts(source: McapSource, fields: Mapping[str, Fields], parts: list[TopicPart], log: str,
                  findings: list[Finding], unreadable: dict[str, str],
                  lenient: bool) -> tuple[dict[str, Channel], float]:
    """Read the parts block by block, with their clocks."""
    readers = [fields[part.topic].columns([*part.channels.values(), *part.stamp_paths]) for part in parts]
    pieces = [_collectors(part, source) for part in parts]
    broken: Counter[str] = Counter()
    for block in source.blocks():
        for part, reader, collected in zip(parts, readers, pieces, strict=True):
            mine, places, lengths = block.of(source.topics[part.topic].channels)
            if not len(lengths):
                continue
            columns, good = reader.read(places, lengths)
            named = part.stamp.channel if part.stamp else LOG_TIME
            if named in MESSAGE_TIMES:
                columns = [*columns, block.head[named][mine].view(np.int64)]
            if not good.all():
                broken[part.topic] += int(np.sum(~good))
                columns = [column[good] for column in columns]
            for collector, column in zip(collected, columns, strict=True):
                collector.add(column)
    readable, ticks, values = [], [], []
    for part, collected in zip(parts, pieces, strict=True):
        columns = [each.values for each in collected]
        if not len(columns[0]):
            why = "messages that do not match their schema"
            if not lenient:
                raise BadRecording(f"readable messages in {part.topic} of {log}", why, "Check the recorder.")
            unreadable[part.topic] = why
            continue
        readable.append(part)
        values.append(columns[:len(part.channels)])
        ticks.append(to_ticks(columns[len(part.channels):], part.stamp, fields[part.topic], log))
    findings += [_broken_finding(topic, count, source, log) for topic, count in broken.items()]
    times, origin = seconds_from_common_origin(ticks)
    return {name: Channel(time, column.astype(float, copy=False), fields[part.topic].unit(path))
            for part, time, columns in zip(readable, times, values, strict=True)
            for (name, path), column in zip(part.channels.items(), columns, strict=True)}, origin


def _collectors(part: TopicPart, source: McapSource) -> list[Collector]:
    """One per channel, then for the stamp: its fields, or the time that every message has."""
    return [Collector(source.topics[part.topic].count)
            for _ in range(len(part.channels) + (len(part.stamp_paths) or 1))]


def _broken_finding(topic: str, count: int, source: McapSource, log: str) -> Finding:
    return Finding("warning", "log-damaged",
                   f"{count} messages of {topic} in {log} do not match their encoding or schema; they are "
                   "left out.", {"messages": count, "of": source.topics[topic].count}, "Check the recorder.")


def _late_finding(topics: list[str], stamp: str, log: str) -> Finding:
    return Finding("warning", "clock-corrected",
                   f"Messages of {', '.join(topics)} in {log} were received in batches; their {stamp} is steady "
                   "and is used instead.", {"clock": stamp, "topics": len(topics)},
                   f"Write `time: {stamp}` in the channel map.")


def _damage_findings(source: McapSource) -> list[Finding]:
    """One finding about all that was wrong with the file."""
    if not source.damage:
        return []
    evidence, of = {"messages": source.count, "places": len(source.damage)}, ""
    if source.recorded is not None and source.recorded > source.count + sum(
            each.count for each, _ in source.repeated):
        evidence["recorded"] = source.recorded
        of = f" of {source.recorded}"
    return [Finding("warning", "log-damaged",
                    f"{display_name(source.path)} is truncated or damaged ({_damage_text(source.damage)}); the "
                    f"{source.count} messages{of} that can be read are used.", evidence,
                    "Recover it with `mcap recover`, or record again.")]


def _repeated_topic_findings(source: McapSource, topics: set[str]) -> list[Finding]:
    """One finding per channel of these topics that is left out, since another one holds its messages."""
    return [Finding("warning", "topic-duplicated",
                    f"{each.topic} is in {display_name(source.path)} twice: channel {each.channels[0]} duplicates "
                    f"the messages of channel {used.channels[0]}. Channel {used.channels[0]} is used.",
                    {"topic": each.topic, "used": used.channels[0], "messages": used.count,
                     "left_out": each.channels[0], "messages_left_out": each.count},
                    "Check whether two recorders ran.")
            for each, used in source.repeated if each.topic in topics]


def _damage_text(damage: list[str]) -> str:
    """Each kind of damage once, with its count."""
    return "; ".join(what if count == 1 else f"{count} times {what}"
                     for what, count in Counter(damage).items())
