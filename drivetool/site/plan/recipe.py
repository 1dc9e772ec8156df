"""From the commands of a recipe to steps whose options are known, before anything runs."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from drivetool.errors import BadParameters, nearest
from drivetool.files.shapes import SiteFile, StepSection
from drivetool.files.yaml import load_channel_map
from drivetool.site.plan.recordings import digest
from drivetool.site.plan.site_file import step_name

# The commands that read recordings and write one file.
COMMANDS = ("steady", "blackbox", "greybox", "backlash", "validate", "compare", "diagnose")
# What a batch says itself, and pictures and pages, which it does not write.
TAKEN = ("out", "json", "plot", "report", "quiet", "explain")
# Not part of what a result depends on.
NO_INPUT = ("logs", "debug", *TAKEN)
Parse = Callable[[str, Sequence[str]], dict[str, Any] | str]
A_LOG = "recording"  # stands for the recordings where the words are checked


@dataclass(frozen=True)
class Step:
    """One step of the recipe.

    name     what its files are called
    command  first word; words: the others as typed
    params   names of the earlier steps whose files go in
    options  every option with its value, given or not
    files    files that the words name, from the folder of the site file -> sha256; map: the channel map of these
    judge    next, previous, a kind, or None
    """

    name: str
    kind: str
    command: str
    words: tuple[str, ...]
    params: tuple[str, ...]
    joint: bool
    judge: str | None
    options: Mapping[str, Any]
    files: Mapping[str, str] = field(default_factory=dict)
    map: str | None = None


def steps_of(site: SiteFile, folder: Path, name: str, parse: Parse) -> tuple[Step, ...]:
    """The steps of a recipe.

    folder  of the site file; name: of the file, for messages
    parse   (command, words) -> its options by name as the command would get them, or why it takes no such words
    raises  BadParameters: an unknown command or option, one that a batch sets itself, a file that cannot be read
    """
    return tuple(_step(section, folder, f"recipe[{i}] of {name}", parse) for i, section in enumerate(site.recipe))


def _step(section: StepSection, folder: Path, where: str, parse: Parse) -> Step:
    try:
        command, *words = shlex.split(section.command)
    except ValueError as error:
        raise BadParameters(f"a command as typed in a shell at {where}", f"'{section.command}' ({error})",
                            "Close the quotation mark.") from None
    if command not in COMMANDS:
        raise BadParameters(f"a step that a batch can do at {where}", f"'{command}'", nearest(command, COMMANDS))
    given = ["--params", "-"] if section.params else []
    asked = _parsed(parse, command, [A_LOG, *words, *given], section.command, where)
    if asked["logs"] != [A_LOG]:
        raise BadParameters(f"a command without recordings at {where}", f"'{' '.join(asked['logs'][1:])}' in it",
                            "Leave it out; kind says which recordings the step reads.")
    plain = _parsed(parse, command, [A_LOG, "--params", "-"], command, where)
    for option in TAKEN:
        if option in asked and asked[option] != plain[option]:
            raise BadParameters(f"no --{option} at {where}", f"'{section.command}'",
                                "Leave it out: a batch names the files itself, and draws no pictures.")
    options = {key: _plain(value) for key, value in asked.items() if key not in NO_INPUT}
    words_in = [text for value in options.values() for text in (value if isinstance(value, list) else [value])]
    files = [text for text in words_in if isinstance(text, str) and os.path.isfile(folder / text)]
    files += [*asked["params"], *(asked.get("holdout") or ()), *filter(None, [asked["map"]])]
    read = {name: _digest(name, folder, where) for name in files if name != "-"}
    if asked["map"]:
        load_channel_map(folder / asked["map"])
    return Step(step_name(section), section.kind, command, tuple(words), tuple(section.params), section.joint,
                section.judge, options, read, asked["map"])


def _digest(name: str, folder: Path, where: str) -> str:
    try:
        return digest(folder / name)
    except OSError as error:
        raise BadParameters(f"to read {name} at {where}", error.strerror or str(error),
                            "Correct the command; its paths count from the folder of the site file.") from None


def _parsed(parse: Parse, command: str, words: Sequence[str], typed: str, where: str) -> dict[str, Any]:
    """The options of a command line."""
    found = parse(command, words)
    if isinstance(found, str):
        raise BadParameters(f"a command as drivetool takes it at {where}", f"'{typed}': {found}",
                            f"See drivetool {command} --help.")
    return found


def _plain(value: Any) -> Any:
    """As JSON holds it."""
    if isinstance(value, Enum):
        return value.value
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
