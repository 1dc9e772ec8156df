"""Which channels of an MCAP file are one source of messages.

A file may have several channels of one topic. rosbag2 writes one, whoever publishes. Other recorders have
other reasons, which two statistics distinguish:

    continued       A recorder that was restarted, or files that were joined: a new number for the same
                    source. The spans of log time, from first to last message, do not overlap. Two
                    publishers that run beside each other overlap; nothing else distinguishes them.
    recorded twice  Two recorders in one file. The spans overlap, and messages that have the same publish
                    time, or else the same sequence number, are the same byte for byte, all of them. A recorder
                    loses messages, so some have no partner: more than half must. But it never changes one: a
                    single pair that differs shows two publishers on one cycle. Their messages at rest may be
                    the same for long, which is why a share of equal messages would not do.
    several         All else: other schemas, encodings or units, or messages that differ. They are read separately.

Channels that repeat each other in all that was recorded are no risk: either gives the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from drivetool.logs.formats.mcap.container.messages import MAX_SAMPLE_MESSAGES, Block, Topic

# What two recorders of one message have in common, the better one first.
_MATCH_FIELDS = ("publish_time", "sequence")


Repeated = tuple[Topic, Topic]  # a channel that is left out, and the one that is read in its place


def find_sources(channels: Mapping[int, Topic],
            blocks: Callable[[], Iterator[Block]]) -> tuple[dict[str, Topic], list[Repeated]]:
    """The sources of messages by name, and the channels that repeat others.

    channels  number -> what is known of it, in the order of the file; each has messages
    blocks    gives all messages; read only where channels are of one kind
    returns   name -> source. The name is the topic; where it has several sources, with `#1`, `#2`, ... by the
              lowest numbers of their channels
    """
    kinds: dict[tuple, list[Topic]] = {}
    for each in channels.values():
        kinds.setdefault(_source_key(each), []).append(each)
    found: list[Topic] = []
    repeated: list[Repeated] = []
    heads = _collect_by_channel([each for kind in kinds.values() if len(kind) > 1 for each in kind], blocks,
                                lambda block, which: block.head[which])
    for kind in kinds.values():
        if _one_after_the_other(kind, heads):
            found.append(_merge_channels(kind))
            continue
        texts = _collect_by_channel(kind, blocks, _hashes)
        kept, more = _without_repeats(kind, heads, texts)
        found += [_merge_channels(kept)] if _one_after_the_other(kept, heads) else kept
        repeated += more
    return _name_sources(found), repeated


def _source_key(each: Topic) -> tuple:
    """What channels of one source have in common."""
    units = {key: text for key, text in each.metadata.items() if key.startswith("unit:")}
    return (each.topic, each.encoding, each.schema.name, each.schema.encoding, each.schema.data,
            tuple(sorted(units.items())))


def _collect_by_channel(wanted: list[Topic], blocks: Callable[[], Iterable[Block]],
                        read: Callable) -> dict[int, np.ndarray]:
    """Channel -> (n,) what `read` gives of each of its messages, in the order of the file."""
    pieces: dict[int, list[np.ndarray]] = {each.channels[0]: [] for each in wanted}
    for block in blocks() if wanted else ():
        present = {block.only} if block.only is not None else set(np.unique(block.head["channel"]).tolist())
        for number in present & pieces.keys():
            which = np.flatnonzero(block.head["channel"] == number)
            pieces[number].append(read(block, which))
    return {number: np.concatenate(parts) for number, parts in pieces.items()}


def _hashes(block: Block, which: np.ndarray) -> np.ndarray:
    return np.array([hash(block.content(index)) for index in which.tolist()], np.int64)


def _overlap_in_time(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two channels share more log time than the end of one and the beginning of the other."""
    (first, last), (begin, end) = ((each["log_time"].min(), each["log_time"].max()) for each in (one, other))
    disjoint = (last <= begin and first < end) or (end <= first and begin < last)
    return not disjoint


def _one_after_the_other(kind: list[Topic], heads: Mapping[int, np.ndarray]) -> bool:
    """Whether no two channels overlap."""
    return not any(_overlap_in_time(heads[one.channels[0]], heads[other.channels[0]])
                   for one, other in combinations(kind, 2))


def _without_repeats(kind: list[Topic], heads: Mapping[int, np.ndarray],
                     texts: Mapping[int, np.ndarray]) -> tuple[list[Topic], list[Repeated]]:
    """(channels without those that repeat one of them, those).

    The one with the most messages is kept, of equal ones that with the lowest number.
    """
    kept: list[Topic] = []
    repeated = []
    for each in sorted(kind, key=lambda each: (-each.count, each.channels[0])):
        mine = each.channels[0]
        twin = next((other for other in kept
                     if _overlap_in_time(heads[mine], heads[other.channels[0]]) and _same_messages(
            heads[mine], texts[mine], heads[other.channels[0]], texts[other.channels[0]])), None)
        if twin is None:
            kept.append(each)
        else:
            repeated.append((each, twin))
    return kept, repeated


def _same_messages(one: np.ndarray, its_texts: np.ndarray, other: np.ndarray, other_texts: np.ndarray) -> bool:
    """Whether two channels hold the same messages, each (n,) heads and hashes of contents."""
    for mark in _MATCH_FIELDS:
        first, second = one[mark], other[mark]
        low, high = max(first.min(), second.min()), min(first.max(), second.max())
        in_overlap = min(int(np.sum((low <= each) & (each <= high))) for each in (first, second))
        _, here, there = np.intersect1d(first, second, return_indices=True)
        # A mark that does not count, such as 0 throughout, gives a single pair.
        if 2 * len(here) > in_overlap:
            return bool(np.array_equal(its_texts[here], other_texts[there]))
    return False


def _merge_channels(kind: list[Topic]) -> Topic:
    """Channels as one source; what the first says holds for all."""
    return replace(kind[0], channels=[each.channels[0] for each in kind], count=sum(each.count for each in kind),
                   samples=[sample for each in kind for sample in each.samples][:MAX_SAMPLE_MESSAGES])


def _name_sources(found: list[Topic]) -> dict[str, Topic]:
    """The sources by name, in their order."""
    by_topic: dict[str, list[Topic]] = {}
    for each in sorted(found, key=lambda each: min(each.channels)):
        by_topic.setdefault(each.topic, []).append(each)
    for topic, several in by_topic.items():
        mark = "#"
        while any(f"{topic}{mark}{number}" in by_topic for number in range(1, len(several) + 1)):
            mark += "#"
        for number, each in enumerate(several, 1):
            each.name = f"{topic}{mark}{number}" if len(several) > 1 else topic
    return {each.name: each for each in found}
