"""From the commands of a recipe to steps whose options are known, before anything runs."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

from drivetool.errors import BadParameters, nearest
from drivetool.files.shapes import SiteFile, StepSection
from drivetool.files.yaml import load_channel_map
from drivetool.site.plan.recordings import named_sha256
from drivetool.site.plan.site_file import step_name

# The commands that read recordings and write one file.
STEP_COMMANDS = ("steady", "blackbox", "greybox", "backlash", "validate", "compare", "diagnose")
# Options that a batch sets itself, and those of pictures and pages, which it does not write.
BATCH_OPTIONS = ("out", "json", "plot", "report", "quiet", "explain")
# Options on which a result does not depend.
OPTIONS_WITHOUT_EFFECT = ("logs", "debug", *BATCH_OPTIONS)
ParseWords = Callable[[str, Sequence[str]], dict[str, Any] | str]
LOG_PLACEHOLDER = "recording"  # stands for the recordings when the options are checked


class RecipeStep(StepSection, kw_only=True):
    """One step of the recipe: `command` is its first word alone, and `name` is never missing.

    words    the other words as typed
    options  every option with its value, given or not
    files    files named in the words, from the folder of the site file -> sha256; map: the channel map of these
    """

    words: tuple[str, ...]
    options: Mapping[str, Any]
    files: Mapping[str, str] = {}
    map: str | None = None


def steps_of(site: SiteFile, folder: Path, name: str, parse: ParseWords) -> tuple[RecipeStep, ...]:
    """The steps of a recipe.

    folder  of the site file; name: of the file, for messages
    parse   (command, words) -> its options by name as the command would get them, or why it rejects them
    raises  BadParameters: an unknown command or option, one that a batch sets itself, a file that cannot be read
    """
    return tuple(_parse_step(section, folder, f"recipe[{i}] of {name}", parse)
                 for i, section in enumerate(site.recipe))


def _parse_step(section: StepSection, folder: Path, where: str, parse: ParseWords) -> RecipeStep:
    try:
        command, *words = shlex.split(section.command)
    except ValueError as error:
        raise BadParameters(f"a command as typed in a shell at {where}", f"'{section.command}' ({error})",
                            "Close the quotation mark.") from None
    if command not in STEP_COMMANDS:
        raise BadParameters(f"a step that a batch can do at {where}", f"'{command}'",
                            nearest(command, STEP_COMMANDS))
    params_words = ["--params", "-"] if section.params else []
    parsed = _parse_options(parse, command, [LOG_PLACEHOLDER, *words, *params_words], section.command, where)
    if parsed["logs"] != [LOG_PLACEHOLDER]:
        raise BadParameters(f"a command without recordings at {where}", f"'{' '.join(parsed['logs'][1:])}' in it",
                            "Leave it out; kind says which recordings the step reads.")
    defaults = _parse_options(parse, command, [LOG_PLACEHOLDER, "--params", "-"], command, where)
    for option in BATCH_OPTIONS:
        if option in parsed and parsed[option] != defaults[option]:
            raise BadParameters(f"no --{option} at {where}", f"'{section.command}'",
                                "Leave it out: a batch names the files itself, and draws no pictures.")
    options = {key: _json_value(value) for key, value in parsed.items() if key not in OPTIONS_WITHOUT_EFFECT}
    option_values = [text for value in options.values() for text in (value if isinstance(value, list) else [value])]
    files = [text for text in option_values if isinstance(text, str) and os.path.isfile(folder / text)]
    files += [*parsed["params"], *(parsed.get("holdout") or ()), *filter(None, [parsed["map"]])]
    checksums = {name: named_sha256(folder / name, f"to read {name} at {where}",
                                    "Correct the command; its paths count from the folder of the site file.")
                 for name in files if name != "-"}
    if parsed["map"]:
        load_channel_map(folder / parsed["map"])
    return RecipeStep(name=step_name(section), kind=section.kind, command=command, words=tuple(words),
                      params=section.params, joint=section.joint, judge=section.judge, options=options,
                      files=checksums, map=parsed["map"])


def _parse_options(parse: ParseWords, command: str, words: Sequence[str], typed: str, where: str) -> dict[str, Any]:
    """The options of a command line."""
    found = parse(command, words)
    if isinstance(found, str):
        raise BadParameters(f"a valid drivetool command at {where}", f"'{typed}': {found}",
                            f"See drivetool {command} --help.")
    return found


def _json_value(value: Any) -> Any:
    """The value as a JSON type."""
    if isinstance(value, Enum):
        return value.value
    return [_json_value(each) for each in value] if isinstance(value, list | tuple) else value
