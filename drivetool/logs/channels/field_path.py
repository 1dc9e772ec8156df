"""Paths to a number inside a message: `actual.torque`, `effort[0]`, `effort[name=motor]`.

A message is a tree of mappings, lists and leaves in any encoding: the leaves of JSON are its values, those of a
binary message are their byte positions.

    effort[0]                  element of a list
    effort[name=motor]         the element at the index at which the sibling list `name` contains motor
    joints[name=motor].torque  of a list of mappings, the one whose `name` is motor
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

# A choice: longer lists are an image or a spectrum. They can be addressed, but are not listed.
MAX_LISTED_ELEMENTS = 32
_WORD = re.compile(r"([^.\[\]]+)((?:\[[^\]]*\])*)(?:\.|$)")
_BRACKET = re.compile(r"\[([^\]]*)\]")


@dataclass(frozen=True)
class Selector:
    """A selector: the element whose `key` is `value`."""

    key: str
    value: str


PathStep = str | int | Selector
Path = tuple[PathStep, ...]


def parse(text: str) -> Path | None:
    """The path behind a text; None if it is none."""
    steps: list[PathStep] = []
    at = 0
    while at < len(text):
        word = _WORD.match(text, at)
        if not word:
            return None
        steps.append(word[1])
        for inner in _BRACKET.findall(word[2]):
            key, equals, value = inner.partition("=")
            if equals:
                steps.append(Selector(key.strip(), value.strip().strip("'\"")))
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


def find(tree: Any, path: Path, compared: list | None = None) -> Any:
    """What lies at a path; None if there is nothing.

    seen  collects the texts that a selector compared: the answer holds as long as they stay
    """
    node, siblings = tree, None
    for step in path:
        if isinstance(step, str):
            siblings, node = node, node.get(step) if isinstance(node, Mapping) else None
        elif not _is_list(node):
            return None
        else:
            index = step if isinstance(step, int) else _selected_index(node, siblings, step, compared)
            node = node[index] if index is not None and index < len(node) else None
        if node is None:
            return None
    return node


def _selected_index(node: Any, siblings: Any, where: Selector, compared: list | None) -> int | None:
    """Index of the element that a selector means."""
    names = siblings.get(where.key) if isinstance(siblings, Mapping) else None
    if not _is_list(names):
        names = [each.get(where.key) if isinstance(each, Mapping) else None for each in node]
    for index, name in enumerate(names):
        if compared is not None:
            compared.append(name)
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
                yield from _element_paths(tree, str(key), inner, is_number, path)
            else:
                yield from paths(inner, is_number, (*path, str(key)))
    elif path and is_number(tree):
        yield path


def _element_paths(siblings: Mapping, key: str, items: Any, is_number, path: Path) -> Iterator[Path]:
    """Paths below a list: by name where a sibling list or its elements give names, else by index."""
    if len(items) > MAX_LISTED_ELEMENTS:
        return
    names = siblings.get("name")
    if not (_is_list(names) and len(names) == len(items)):
        names = [each.get("name") if isinstance(each, Mapping) else None for each in items]
    by_name = all(isinstance(n, str) and n and "]" not in n for n in names) and len(set(names)) == len(items)
    for index, item in enumerate(items):
        step = Selector("name", str(names[index])) if by_name else index
        if isinstance(item, Mapping):
            yield from paths(item, is_number, (*path, key, step))
        elif is_number(item):
            yield (*path, key, step)
