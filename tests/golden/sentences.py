"""Prose, where alone numbers may be written otherwise and lines may break elsewhere, and how it is recognised."""

from __future__ import annotations

import re
from collections.abc import Callable
from decimal import Decimal

import yaml

from tests.golden.masks import Masks

# No part of a name, a path, a version, a date or a unit.
NUMBER = re.compile(r"(?<![\w./:^-])([-+−]?\d+(?:\.\d*)?(?:[eE][-+]?\d{1,3})?)(?![\w/-]|[.:]\w)")
# What a block is. Rows may have other gaps only where a mask acts; lines may have other numbers, paragraphs both.
ROW, LINE, PARAGRAPH = "row", "line", "paragraph"
# The rule of a table, a gap between its columns, and one behind a short cell.
TABLE = re.compile(r"\s*[─━═]{3}|.*\S\s{2,}(\S|$)")
# Boxes, cells, markup and lists of values; what stands below a column; nothing.
NO_PROSE = re.compile(r"[─-╿]|-{3}|^\s*[|<\[{(]|^\s{3}|^\s*$")
ITEM = re.compile(r"\s|[-*#] ")
# Scalars stay the text they are.
Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)

Block = tuple[str, str]


def is_sentence(text: object) -> bool:
    """Whether it is a text of several words."""
    return isinstance(text, str) and " " in text


def same_sentence(old: str, new: str) -> bool:
    """Whether two texts are equal but for how their numbers are written."""
    if old == new:
        return True
    parts = NUMBER.split(old), NUMBER.split(new)
    return len(parts[0]) == len(parts[1]) and all(
        left == right or (i % 2 == 1 and _same_number(left, right))
        for i, (left, right) in enumerate(zip(*parts, strict=True)))


def _same_number(old: str, new: str) -> bool:
    """By all their digits, and by the sign of zero."""
    before, after = (Decimal(text.replace("−", "-")) for text in (old, new))
    return before == after and before.is_signed() == after.is_signed()


def same_blocks(old: list[Block], new: list[Block], masks: Masks,
                by_value: Callable[[str, str, Masks], bool] | None = None) -> bool:
    """Whether every block differs at most by what its kind may, and by the masks.

    by_value  whether the masks change the value of a paragraph from the one text into the other
    """
    return len(old) == len(new) and all(
        _same_block(*pair, masks) or (by_value is not None and pair[0][1] == PARAGRAPH
                                      and by_value(pair[0][0], pair[1][0], masks))
        for pair in zip(old, new, strict=True))


def _same_block(old: Block, new: Block, masks: Masks) -> bool:
    """Of one block of BASE and its counterpart."""
    (before, kind), (after, other) = old, new
    expected = masks.apply(before)
    if expected == after:
        return True
    if kind == LINE or other == LINE:
        return kind == other and same_sentence(expected, after)
    touched, words = expected != before, (" ".join(expected.split()), " ".join(after.split()))
    if ROW in (kind, other):
        return touched and words[0] == words[1]
    # Lines break elsewhere for a reason: a longer name or number.
    return (touched or words[0] != words[1]) and is_sentence(words[0]) and same_sentence(*words)


def printed(text: str) -> list[Block]:
    """What a command printed: rows of tables and all else that is no prose, and paragraphs."""
    lines = text.split("\n")
    rows = set(range(len(lines))) if text.startswith("<") else _rows(lines)
    found: list[Block] = []
    for i, line in enumerate(lines):
        kind = ROW if i in rows or NO_PROSE.search(line) else PARAGRAPH
        if kind == PARAGRAPH and found and found[-1][1] == PARAGRAPH and not ITEM.match(line):
            found[-1] = (f"{found[-1][0]}\n{line}", PARAGRAPH)
        else:
            found.append((line, kind))
    return found


def _rows(lines: list[str]) -> set[int]:
    """The lines of tables: a rule, a row with a gap, and all of its width right above and below it."""
    found: set[int] = set()
    for at in (i for i, line in enumerate(lines) if TABLE.match(line)):
        for step in (-1, 1):
            i = at
            while 0 <= i < len(lines) and len(lines[i]) == len(lines[at]):
                found.add(i)
                i += step
    return found


def documented(text: str) -> list[Block]:
    """A text of YAML or JSON: lines, in YAML joined where a string or a list goes on in the next line."""
    lines = text.split("\n")
    if text.lstrip()[:1] in ("{", "["):
        return [(line, LINE) for line in lines]
    found, i, ends = [], 0, _ends(text)
    while i < len(lines):
        last = ends.get(i, i)
        while any(ends.get(k, k) > last for k in range(i, last + 1)):
            last = max(ends.get(k, k) for k in range(i, last + 1))
        found.append(("\n".join(lines[i:last + 1]), PARAGRAPH))
        i = last + 1
    return found


def _ends(text: str) -> dict[int, int]:
    """Line -> the last line of the strings and of the lists and mappings in brackets that begin there."""
    found: dict[int, int] = {}
    depth = start = 0
    for event in list(yaml.parse(text, Loader=Loader)):
        first, last = event.start_mark.line, event.end_mark.line - (event.end_mark.column == 0)
        if isinstance(event, yaml.CollectionStartEvent) and event.flow_style:
            start, depth = start if depth else first, depth + 1
        elif isinstance(event, yaml.CollectionEndEvent) and depth:
            depth -= 1
            found[start] = max(found.get(start, start), last)
        elif isinstance(event, yaml.ScalarEvent) and not depth:
            found[first] = max(found.get(first, first), last)
    return found
