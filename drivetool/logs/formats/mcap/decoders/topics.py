"""A topic of any encoding as fields with units, and columns of numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from drivetool.logs.channels import Path, field_path
from drivetool.logs.formats.mcap.container import Topic
from drivetool.logs.formats.mcap.decoders import json_text, protobuf, ros
from drivetool.logs.formats.mcap.decoders.layout import DECODE_ERRORS, BinaryColumns, BrokenMessage, Default, Leaf

# message encoding -> schema encoding that it needs. Definitions in IDL (ros2idl, omgidl) are refused by name: of
# the parsers for Python that are kept up, one is GPL, one comes in compiled code with readers of its own.
ENCODINGS = {"json": "jsonschema (optional)", "cdr": "ros2msg", "ros1": "ros1msg", "protobuf": "protobuf"}
# The longest message of a ROS type without fields [bytes].
_NO_FIELDS = 8
_SECONDS = ("sec", "secs", "seconds")
_NANOSECONDS = ("nanosec", "nsec", "nsecs", "nanos", "nanoseconds")


@dataclass(frozen=True)
class Fields:
    """What can be read of a topic.

    source       the topic
    listed       paths of its numbers
    trees        samples of its messages
    schema_unit  path -> unit as the schema notes it, or None
    columns      paths -> reader of columns, with a method read(places, lengths)
    """

    source: Topic
    listed: tuple[Path, ...]
    trees: tuple[Any, ...]
    schema_unit: Callable[[Path], str | None]
    columns: Callable[[Sequence[Path]], Any]

    def unit(self, path: Path) -> str | None:
        """The unit that the file notes for a path, in the metadata of the channel or in the schema."""
        return self.source.metadata.get(f"unit:{field_path.text_of(path)}") or self.schema_unit(path)

    def own(self, text: str) -> str:
        """A text without the name of the source or of its topic before it."""
        rest = text.removeprefix(f"{self.source.name}.")
        return rest if rest != text else text.removeprefix(f"{self.source.topic}.")

    def path(self, text: str) -> Path | None:
        """The path behind a text, if there is such a number in one of the samples or the schema."""
        for path in self.listed:
            if field_path.text_of(path) == text:
                return path
        path = field_path.parse(text)
        if path is None:
            return None
        found = [field_path.find(tree, path) for tree in self.trees]
        return path if any(
            isinstance(node, bool) or (_is_number(node) and node is not None) for node in found) else None

    def stamp(self, text: str) -> tuple[Path, ...] | None:
        """The path of a time stamp, or those of its seconds and nanoseconds."""
        path = self.path(text)
        if path is not None:
            return (path,)
        path = field_path.parse(text) or ("",)
        for tree in self.trees:
            node = field_path.find(tree, path)
            if isinstance(node, dict):
                parts = [next((key for key in node if key in names), None)
                         for names in (_SECONDS, _NANOSECONDS)]
                if all(parts):
                    return tuple((*path, key) for key in parts)
        return None


def open_topic(topic: Topic) -> Fields:
    """The fields of a topic.

    raises  Broken: an encoding that is not read, or a schema that cannot be; says which
    """
    needs = ENCODINGS.get(topic.encoding)
    if needs is None:
        raise BrokenMessage(f"encoding {topic.encoding or 'none'}")
    if topic.encoding == "json":
        return _open_json(topic)
    if topic.schema.encoding != needs:
        raise BrokenMessage(f"encoding {topic.encoding} with schema encoding {topic.schema.encoding or 'none'}, "
                     f"not {needs}")
    text = topic.schema.data
    if topic.encoding == "protobuf":
        walk, types = protobuf.protobuf_walk(topic.schema.name, text)
    else:
        walk, types = ros.ros_walk(topic.schema.name, text.decode("utf-8", "replace"), topic.encoding == "cdr")
        # A type that has no fields is sent as one byte after the head, filled up to four at most.
        if not types[topic.schema.name] and max(map(len, topic.samples)) > _NO_FIELDS:
            raise BrokenMessage(f"the definition of its schema {topic.schema.name} is empty")
    trees = []
    for sample in topic.samples:
        with suppress(*DECODE_ERRORS):
            trees.append(walk(sample).tree)

    if not trees:
        raise BrokenMessage("messages that do not match their schema")
    return Fields(
        topic, _listed_paths(trees), tuple(trees),
        lambda path: _ros_unit(types, topic.schema.name, path) if topic.encoding != "protobuf" else None,
        lambda paths: BinaryColumns(walk, list(paths)))


def _open_json(topic: Topic) -> Fields:
    """A topic in JSON; its schema is optional and may declare fields that the first messages lack."""
    schema = json_text.loads(topic.schema.data) if topic.schema.encoding == "jsonschema" else None
    trees = [tree for tree in map(json_text.loads, topic.samples) if tree is not None]
    listed = tuple(dict.fromkeys([*_listed_paths(trees), *json_text.declared_paths(schema)]))
    if not trees and not listed:
        raise BrokenMessage("messages that are no JSON objects")
    return Fields(topic, listed, tuple(trees), lambda path: json_text.schema_unit(schema, path),
                  json_text.JsonColumns)


def _listed_paths(trees: Sequence[Any]) -> tuple[Path, ...]:
    """The numbers of all samples, in the order in which they are met."""
    return tuple(dict.fromkeys(path for tree in trees
                               for path in field_path.paths(tree, _is_number)))


def _is_number(node: Any) -> bool:
    return isinstance(node, Leaf | Default) or json_text.is_number(node)


def _ros_unit(types: dict, name: str, path: Path) -> str | None:
    """The unit in the comment at a field."""
    found = None
    for step in path:
        if isinstance(step, str):
            field = next((f for f in types.get(name, ()) if f.name == step), None)
            if field is None:
                return None
            found, name = field.unit, field.kind
    return found
