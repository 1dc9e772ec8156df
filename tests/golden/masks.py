"""What may differ between BASE and the working tree, and is then made equal before texts are compared.

A mask turns a text of BASE into the one that is expected now. Nothing else is forgiven but how numbers inside
sentences are written, and where the lines of a paragraph break that holds a masked text or such a number.
"""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from tests.golden import places

# In full, or its beginning in a page.
HASH = re.compile(r"(?<![0-9a-f])(?:[0-9a-f]{64}|[0-9a-f]{16})(?![0-9a-f])")
# Not part of a longer number, name or code.
LEFT, RIGHT = r"(?<![\w.-])", r"(?![\w-]|\.\d)"
# What a run costs: columns of a summary, fields of a line of the manifest.
COSTS = ("seconds", "peak_memory_mb")
# Of a line of the manifest: a hash over the hashes of the files that a task read.
KEY = "key"
# A part of a sentence that varies: one word or number, or several with a star.
VARIABLE = re.compile(r"\{(\d)(\*?)\}")
SPACE, ONE, SEVERAL = r"\s+", r"\S+?", r"[^:;]*?"
WHOLE = re.compile(r"\d+")
REAL = re.compile(r"\d+\.\d+(?:[eE][-+]?\d+)?|\d+[eE][-+]?\d+")
FIELD = re.compile(r'("(?:[^"]|"")*"|[^,\r\n]*)(,|\r\n|\n|\r|\Z)')


@dataclass
class Masks:
    """The table of masks.

    version  (of BASE, of the working tree)
    renamed  codes and sentences old -> new; {1}, {2} ... stand for a word or a number, {1*} for several within a
             sentence, the same on both sides
    hashes   of an earlier file of the same case, of BASE -> of the working tree
    used     how often each took effect
    """

    version: tuple[str, str] = ("", "")
    renamed: Mapping[str, str] = field(default_factory=dict)
    hashes: dict[str, str] = field(default_factory=dict)
    used: Counter[str] = field(default_factory=Counter)

    def apply(self, text: str) -> str:
        """A text of BASE as it is expected now."""
        if self.version[0] != self.version[1]:
            text = self._replaced(text, *self.version, "version")
        for old, new in self.renamed.items():
            text = self._replaced(text, old, new, f"renamed: {old} -> {new}")
        if self.hashes:
            text = HASH.sub(self._hash, text)
        return text

    @property
    def idle(self) -> bool:
        """Whether no text of BASE can be changed."""
        return self.version[0] == self.version[1] and not self.renamed and not self.hashes

    def uncounted(self) -> Masks:
        """The same, for texts that were counted before."""
        return replace(self, used=Counter())

    def _replaced(self, text: str, old: str, new: str, name: str) -> str:
        """With one text in the place of another; a sentence may be broken into lines anywhere."""
        pattern, literal = _pattern(old)
        if literal not in text:
            return text
        found, count = pattern.subn(lambda at: VARIABLE.sub(lambda part: at[f"part_{part[1]}"], new), text)
        self.used[name] += count
        return found

    def _hash(self, found: re.Match[str]) -> str:
        known = {old[:len(found[0])]: new[:len(found[0])] for old, new in self.hashes.items()}
        new = known.get(found[0], found[0])
        self.used["hash of an earlier file"] += new != found[0]
        return new

    def table(self) -> list[str]:
        """The masks with how often each took effect."""
        names = [f"version: {self.version[0]} -> {self.version[1]}" if self.version[0] != self.version[1] else
                 f"version: {self.version[0]} on both sides"]
        lines = [f"{names[0]:60} {self.used['version']}",
                 f"{'hash of an earlier file of the case':60} {self.used['hash of an earlier file']}",
                 f"{'numbers inside sentences, as numbers':60} {self.used['number']}",
                 f"{'columns and fields ' + ', '.join(COSTS):60} {self.used['cost']}",
                 f"{'order of the lines of manifest.jsonl':60} {self.used['order']}"]
        return lines + [f"{f'renamed: {old} -> {new}':60} {self.used[f'renamed: {old} -> {new}']}"
                        for old, new in self.renamed.items()]


@cache
def _pattern(old: str) -> tuple[re.Pattern[str], str]:
    """(what finds a text in any layout, with groups for its variable parts; its longest word)."""
    words = old.split()
    literal = max((word for word in words if not VARIABLE.search(word)), key=len, default="")
    return re.compile(f"{LEFT}{SPACE.join(map(_word, words))}{RIGHT}"), literal


def _word(word: str) -> str:
    """The pattern of a word, with a group for each variable part."""
    pattern, last = "", 0
    for at in VARIABLE.finditer(word):
        pattern += re.escape(word[last:at.start()]) + f"(?P<part_{at[1]}>{SEVERAL if at[2] else ONE})"
        last = at.end()
    return pattern + re.escape(word[last:])


def renamed(path: Path = places.RENAMED) -> dict[str, str]:
    """Old -> new, from a table with these two columns; the longest first, for one may be a part of another."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {row["old"]: row["new"] for row in sorted(rows, key=lambda row: -len(row["old"]))}


def without_costs(name: str, text: str, masks: Masks) -> str:
    """A summary or a manifest with a token in the place of each cost, a manifest in the order of its lines, too."""
    known, place = text, Path(name).name
    if place == "summary.csv":
        text = _summary(text)
    if place == "manifest.jsonl":
        # It differs where one of those files does; the manifest itself is one that differs.
        hidden = (*COSTS, KEY) if len(masks.hashes) > 1 else COSTS
        first, *lines = [_entry(line, hidden) for line in re.findall(r"[^\n]*\n|[^\n]+", text)] or [""]
        masks.used["order"] += lines != sorted(lines)
        masks.used["cost"] += "".join([first, *lines]) != known
        return "".join([first, *sorted(lines)])
    masks.used["cost"] += text != known
    return text


def _token(value: str) -> str:
    """What stands for a cost: its type; the text itself, if it is no number without a sign."""
    return "<whole>" if WHOLE.fullmatch(value) else "<real>" if REAL.fullmatch(value) else value


def _summary(text: str) -> str:
    """A table as CSV with tokens; quotes, ends of lines and all other fields as they are."""
    found, header, row, column = [], [], 0, 0
    for value, end in FIELD.findall(text):
        if row == 0:
            header.append(value)
        elif column < len(header) and header[column] in COSTS:
            bare = value[1:-1] if value[:1] == '"' else value
            value = value.replace(bare, _token(bare)) if bare else value
        found += [value, end]
        row, column = (row, column + 1) if end == "," else (row + 1, 0)
    return "".join(found)


def _entry(line: str, hidden: Collection[str]) -> str:
    """A line of the manifest with tokens at the hidden ones of its own keys; what is no object stays."""
    try:
        if not isinstance(json.loads(line), dict):
            return line
    except ValueError:
        return line
    decoder, found, done = json.JSONDecoder(), [], 0
    at = _between(line, line.index("{") + 1)
    while line[at] != "}":
        key, at = decoder.raw_decode(line, at)
        start = _between(line, at)
        _, at = decoder.raw_decode(line, start)
        if key in hidden:
            found += [line[done:start], "<key>" if key == KEY else _token(line[start:at])]
            done = at
        at = _between(line, at)
    return "".join([*found, line[done:]])


def _between(line: str, at: int) -> int:
    """Where the next key or value begins."""
    return at + len(line[at:]) - len(line[at:].lstrip(" \t\r\n,:"))
