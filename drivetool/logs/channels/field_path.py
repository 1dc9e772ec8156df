"""Paths to a number inside a message: `actual.torque`, `effort[0]`, `effort[name=motor]`.

A message is a tree of mappings, lists and leaves, whatever its encoding: JSON gives its values as
leaves, a binary message where they lie.

    effort[0]                  element of a list
    effort[name=motor]         the element at the place where the list `name` beside it says motor
    joints[name=motor].torque  of a list of mappings, the one whose `name` is motor
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

# More elements are a picture or a spectrum; they can be named, but are not listed.
LISTED = 32
_WORD = re.compile(r"([^.\[\]]+)((?:\[[^\]]*\])*)(?:\.|$)")
_BRACKET = re.compile(r"\[([^\]]*)\]")


@dataclass(frozen=True)
class Where:
    """A selector: the element whose `key` is `value`."""

    key: str
    value: str


Step = str | int | Where
Path = tuple[Step, ...]


def parse(text: str) -> Path | None:
    """The path behind a text; None if it is none."""
    steps: list[Step] = []
    at = 0
    while at < len(text):
        word = _WORD.match(text, at)
        if not word:
            return None
        steps.append(word[1])
        for inner in _BRACKET.findall(word[2]):
            key, equals, value = inner.partition("=")
            if equals:
                steps.append(Where(key.strip(), value.strip().strip("'\"")))
            elif inner.strip().isdigit():
                steps.append(int(inner))
            else:
                return None
        at = word.end()
    return tuple(steps) or None


def text_of(path: Path) -> str:
    """The path as a person writes it."""
    text = ""
    for step in path:
        if isinstance(step, str):
            text += f".{step}" if text else step
        elif isinstance(step, int):
            text += f"[{step}]"
        else:
            text += f"[{step.key}={step.value}]"
    return text


def find(tree: Any, path: Path, seen: list | None = None) -> Any:
    """What lies at a path; None if there is nothing.

    seen  collects the texts that a selector compared: the answer holds as long as they stay
    """
    node, beside = tree, None
    for step in path:
        if isinstance(step, str):
            beside, node = node, node.get(step) if isinstance(node, Mapping) else None
        elif not _is_list(node):
            return None
        else:
            index = step if isinstance(step, int) else _place(node, beside, step, seen)
            node = node[index] if index is not None and index < len(node) else None
        if node is None:
            return None
    return node


def _place(node: Any, beside: Any, where: Where, seen: list | None) -> int | None:
    """Index of the element that a selector means."""
    names = beside.get(where.key) if isinstance(beside, Mapping) else None
    if not _is_list(names):
        names = [each.get(where.key) if isinstance(each, Mapping) else None for each in node]
    for index, name in enumerate(names):
        if seen is not None:
            seen.append(name)
        if name == where.value:
            return index
    return None


def _is_list(node: Any) -> bool:
    return hasattr(node, "__getitem__") and hasattr(node, "__len__") and not isinstance(node, str | Mapping)


def paths(tree: Any, is_number, path: Path = ()) -> Iterator[Path]:
    """Paths of all numbers in a tree, elements of long lists left out.

    is_number  leaf -> whether it is one
    """
    if isinstance(tree, Mapping):
        for key, inner in tree.items():
            if _is_list(inner) and not isinstance(inner, Mapping):
                yield from _elements(tree, str(key), inner, is_number, path)
            else:
                yield from paths(inner, is_number, (*path, str(key)))
    elif path and is_number(tree):
        yield path


def _elements(beside: Mapping, key: str, items: Any, is_number, path: Path) -> Iterator[Path]:
    """Paths below a list: by name where names stand beside it or in its elements, else by place."""
    if len(items) > LISTED:
        return
    names = beside.get("name")
    if not (_is_list(names) and len(names) == len(items)):
        names = [each.get("name") if isinstance(each, Mapping) else None for each in items]
    by_name = all(isinstance(n, str) and n and "]" not in n for n in names) and len(set(names)) == len(items)
    for index, item in enumerate(items):
        step = Where("name", str(names[index])) if by_name else index
        if isinstance(item, Mapping):
            yield from paths(item, is_number, (*path, key, step))
        elif is_number(item):
            yield (*path, key, step)
