"""A case: files, and a chain of commands that run in their folder."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.golden import places


@dataclass(frozen=True)
class Case:
    """One input of both sides.

    name      unique, also in the name of its file of results
    kind      for the summary
    files     path in its folder -> name of the content
    commands  lines for a shell, one after the other
    terminal  whether standard output is a terminal
    """

    name: str
    kind: str
    files: Mapping[str, str]
    commands: tuple[str, ...]
    terminal: bool = False

    @property
    def key(self) -> str:
        """The name of its results: changes with everything that goes in."""
        content = json.dumps([self.files, self.commands, self.terminal], sort_keys=True)
        return f"{self.name}-{places.digest(content.encode())[:12]}"


def case(name: str, kind: str, files: Mapping[str, Path | bytes], commands: Sequence[str],
         terminal: bool = False) -> Case:
    """A case whose files are put among the stored inputs."""
    return Case(name, kind, {path: store(content) for path, content in sorted(files.items())}, tuple(commands),
                terminal)


def tool(chain: Sequence[str]) -> list[str]:
    """Commands of the tool, which tables have without its name, as lines for a shell."""
    return [f"drivetool {words}" for words in chain]


def store(content: Path | bytes) -> str:
    """Put a content among the inputs; returns its name."""
    data = content.read_bytes() if isinstance(content, Path) else content
    name = places.digest(data)
    place = stored(name)
    if not place.exists():
        place.parent.mkdir(parents=True, exist_ok=True)
        part = place.with_suffix(f".{os.getpid()}")
        part.write_bytes(data)
        part.rename(place)
    return name


def stored(name: str) -> Path:
    """The file of a content."""
    return places.folder() / "inputs" / name[:2] / name


def inputs_hash(cases: Sequence[Case]) -> str:
    """One name of all inputs together."""
    return places.digest("\n".join(sorted(each.key for each in cases)).encode())[:12]
