"""What may differ between BASE and the working tree, and is then made equal before texts are compared.

A mask turns a text of BASE into the one that is expected now. Nothing else is forgiven but how numbers inside
sentences are written.
"""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tests.golden import places

HASH = re.compile(r"(?<![0-9a-f])[0-9a-f]{64}(?![0-9a-f])")
# Not part of a longer number, name or code.
LEFT, RIGHT = r"(?<![\w.-])", r"(?![\w-]|\.\d)"
NUMBER = re.compile(r"(?<![\w.])([-+−]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)(?!\w)")
# What a run costs: columns of a summary, fields of a line of the manifest.
COSTS = ("seconds", "peak_memory_mb")


@dataclass
class Masks:
    """The table of masks.

    version  (of BASE, of the working tree)
    renamed  codes and sentences old -> new
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

    def _replaced(self, text: str, old: str, new: str, name: str) -> str:
        """With one text in the place of another; a sentence may be broken into lines anywhere."""
        words = r"\s+".join(re.escape(word) for word in old.split())
        found, count = re.subn(f"{LEFT}{words}{RIGHT}", lambda _: new, text)
        self.used[name] += count
        return found

    def _hash(self, found: re.Match[str]) -> str:
        new = self.hashes.get(found[0], found[0])
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


def renamed(path: Path = places.RENAMED) -> dict[str, str]:
    """Old -> new, from a table with these two columns; the longest first, for one may be a part of another."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {row["old"]: row["new"] for row in sorted(rows, key=lambda row: -len(row["old"]))}


def same_sentence(old: str, new: str) -> bool:
    """Whether two texts are equal but for how their numbers are written."""
    if old == new:
        return True
    parts = NUMBER.split(old), NUMBER.split(new)
    return len(parts[0]) == len(parts[1]) and all(
        left == right or (i % 2 == 1 and _value(left) == _value(right))
        for i, (left, right) in enumerate(zip(*parts, strict=True)))


def _value(number: str) -> float:
    return float(number.replace("−", "-"))


def without_costs(name: str, text: str, masks: Masks) -> str:
    """A summary as CSV without its costs, a manifest without them and in the order of its lines."""
    if name.endswith("summary.csv"):
        rows = list(csv.reader(text.splitlines()))
        kept = [i for i, column in enumerate(rows[0]) if column not in COSTS] if rows else []
        masks.used["cost"] += bool(rows) and len(kept) < len(rows[0])
        return "".join(",".join(json.dumps(row[i]) for i in kept) + "\n" for row in rows)
    if name.endswith("manifest.jsonl"):
        lines = [json.loads(line) for line in text.splitlines()]
        masks.used["order"] += 1
        return "".join(sorted(json.dumps(_costless(line)) + "\n" for line in lines))
    return text


def _costless(line: object) -> object:
    """A line of the manifest without its costs."""
    if isinstance(line, dict):
        return {name: _costless(value) for name, value in line.items() if name not in COSTS}
    return line
