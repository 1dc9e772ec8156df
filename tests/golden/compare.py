"""Compare the stored results of two sides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tests.golden.case import Case
from tests.golden.masks import Masks
from tests.golden.run import Result
from tests.golden.values import differences, texts


@dataclass(frozen=True)
class Difference:
    """What differs at one place: a command of a case and what of it; lines by value."""

    case: str
    command: str
    what: str
    lines: Sequence[str]

    def __str__(self) -> str:
        lines = [f"    {line}" for line in self.lines]
        return "\n".join([f"{self.case}: {self.command}", f"  {self.what}", *lines])


@dataclass
class Comparison:
    """What was compared, and what differs."""

    cases: int = 0
    commands: int = 0
    files: int = 0
    schemas: int = 0
    differences: list[Difference] = field(default_factory=list)


def compare(cases: Sequence[Case], old: Path, new: Path, masks: Masks) -> Comparison:
    """Every case of two folders of results."""
    found = Comparison()
    for case in cases:
        pair = [Result.read(place / f"{case.key}.zip") for place in (old, new)]
        found.cases += 1
        found.commands += len(case.commands)
        for each, when in zip(pair, ("before", "now"), strict=True):
            if each is None:
                found.differences.append(Difference(case.name, "; ".join(case.commands), "no result", [
                    f"a command did not end by itself {when}; the case is run again next time"]))
        if None not in pair:
            found.files += sum(len({*before.files, *after.files})
                               for before, after in zip(*(each.steps for each in pair), strict=True))
            found.differences += of_case(case.name, *pair, masks)
    return found


def of_case(name: str, old: Result, new: Result, masks: Masks) -> list[Difference]:
    """Of the two results of a case, command by command."""
    masks.hashes.clear()
    found = []
    for before, after in zip(old.steps, new.steps, strict=True):
        for what, lines in _of_step(before, after, old, new, masks):
            found.append(Difference(name, before.command, what, lines))
    return found


def _of_step(before, after, old: Result, new: Result, masks: Masks) -> Iterator[tuple[str, list[str]]]:
    """(what, lines) of the exit code, standard output, and files of one command."""
    if before.exit != after.exit:
        yield "exit code", [f"{before.exit} before, {after.exit} now"]
    for path in sorted(set(before.files) ^ set(after.files)):
        yield path, ["written before, not now" if path in before.files else "not written before, written now"]
    if sorted(before.gone) != sorted(after.gone):
        yield "files removed", [f"{sorted(before.gone)} before, {sorted(after.gone)} now"]
    # A file that the command wrote may be quoted in what it prints, and in its other files.
    shared = [path for path in before.files if path in after.files]
    masks.hashes |= {before.files[path]: after.files[path] for path in shared
                     if before.files[path] != after.files[path]}
    lines = differences("stdout", old.contents[before.stdout], new.contents[after.stdout], masks)
    if lines:
        yield "stdout", lines
    for path in shared:
        lines = differences(path, old.contents[before.files[path]], new.contents[after.files[path]], masks)
        if lines:
            yield path, lines


def schemas(old: Path, new: Path, masks: Masks) -> tuple[int, list[Difference]]:
    """(how many, what differs) of the folders of schemas of two trees."""
    names = [{path.name for path in (tree / "schemas").glob("*.json")} for tree in (old, new)]
    found = [Difference("schemas", name, "file", ["missing now" if name in names[0] else "missing before"])
             for name in sorted(names[0] ^ names[1])]
    for name in sorted(names[0] & names[1]):
        lines = texts(name, *((tree / "schemas" / name).read_text(encoding="utf-8") for tree in (old, new)), masks)
        if lines:
            found.append(Difference("schemas", name, "content", lines))
    return len(names[0] | names[1]), found


def report(found: Comparison, masks: Masks, old: str, new: str, inputs: str) -> str:
    """The table of masks, the differences, and the counts."""
    lines = ["masks, and how often each took effect:", *(f"  {line}" for line in masks.table()), ""]
    lines += [f"{each}\n" for each in found.differences]
    lines.append(f"golden: {old[:12]} and {new[:12]} on inputs {inputs}: {found.cases} cases, {found.commands} "
                 f"commands, {found.files} files, {found.schemas} schemas; {len(found.differences)} differences")
    return "\n".join(lines)
