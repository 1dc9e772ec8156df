"""A first site file: a commented template made from the recordings that were found."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivetool.files.shapes import ONE_KIND, SITE_SCHEMA
from drivetool.files.yaml import escape_unprintable, first_of

# Suffix of the kinds whose recordings are held-out data.
HOLDOUT_SUFFIX = "holdout"
# Kinds with a standard fit, in the order of the recipe: kind -> (command, earlier steps).
STANDARD_RECIPES = {
    "steady": (("steady", ()),),
    "steps": (("blackbox", ("steady",)), ("greybox", ("steady", "blackbox"))),
    "gap": (("backlash --free all", ("greybox",)),),
}


@dataclass(frozen=True)
class RecordingGroup:
    """Recordings with similar names.

    kind      the word in their names; empty where all are of one kind
    files     pattern of their paths
    example   one of them; channels: of it, with unit and role
    usable    whether a step could use it without a channel map
    steady    whether it has intervals of constant speed
    count     of recordings; machines: folders that they are in
    several   whether a machine has more than one
    metadata  keys noted in the example
    """

    kind: str
    files: str
    example: str
    channels: Sequence[str]
    usable: bool
    steady: bool
    count: int
    machines: Sequence[str]
    several: bool
    metadata: Sequence[str]


def kinds_of(stems: Sequence[str]) -> dict[str, tuple[str, str]]:
    """File name without suffix -> (kind, pattern of such names).

    stems    names of all recordings
    returns  kind: the word of `STANDARD_RECIPES` in the name, with the suffix of held-out data; empty, and the
             pattern *, unless each name has one
    """
    held_out, found = _either_case(HOLDOUT_SUFFIX), {}
    for stem in stems:
        for word in STANDARD_RECIPES:
            if match := re.search(f"(?<![A-Za-z]){_either_case(word)}(?![A-Za-z])", stem):
                kind, words = word, [_either_case(word)]
                if holdout_match := re.search(held_out, stem):
                    kind = f"{word}_{HOLDOUT_SUFFIX}"
                    words = [*words, held_out] if match.start() < holdout_match.start() else [held_out, *words]
                found[stem] = kind, "*".join(["", *words, ""])
                break
    return found if len(found) == len(set(stems)) else dict.fromkeys(stems, ("", "*"))


def _either_case(word: str) -> str:
    """A word with or without a capital first letter, as a pattern of paths and as a regular expression."""
    return f"[{word[0].upper()}{word[0]}]{word[1:]}"


def first_site(groups: Sequence[RecordingGroup]) -> str:
    """The text of a site file.

    seen  at least one group; the more specific pattern first
    """
    recordings = "\n".join(_recordings_entry(each) for each in groups)
    machines = sorted({name for each in groups for name in each.machines})
    machine_names = _comment_line([first_of(machines, 6)])
    steps = "\n".join(_recipe_lines(groups))
    return f"""schema: {SITE_SCHEMA}

# A recording belongs to the first of these patterns that it matches. Paths count from the folder of this file.
# machine: the folder that a recording is in; seen: {machine_names}.
# Other ways: machine: press 3, {{folder: 2}}, {{file: '{{machine}}_*.mcap'}} or {{metadata: KEY}}.
recordings:
{recordings}

# Every step is done with every recording of its kind. params: the newest files of earlier steps for the machine.
# joint: true fits all recordings of a machine together. judge: next lets the next recording judge a fit.
recipe:
{steps}

# Limits; one that is missed gives exit code 3. For example:
# - {{figure: shaft.half_gap, at_most: {{value: 5, unit: mrad}}}}
# - {{figure: simulation_fit_percent, at_least: 90}}
bars:
  - {{findings: no-failure}}
"""


def _recordings_entry(group: RecordingGroup) -> str:
    channels = _comment_line(group.channels) or "no channels"
    lines = [f"  # {group.count} recordings; {_comment_line([group.example])} has {channels}."]
    if group.metadata:
        lines.append(f"  # Its metadata: {_comment_line(group.metadata)}.")
    lines.append(f"  - files: {_yaml_quoted(group.files)}")
    lines += [f"    kind: {group.kind}"] if group.kind else []
    lines.append("    machine: {folder: 1}")
    if not group.usable:
        lines += ["    # No channel is called like a role: write a channel map, see docs/how-to/map-channels.md.",
                  "    map: map.yaml"]
    return "\n".join(lines)


def _recipe_lines(groups: Sequence[RecordingGroup]) -> list[str]:
    """Lines of the recipe: for known kinds the usual chain, for one kind what its first recording allows."""
    kinds = {each.kind: each for each in groups}
    if "" in kinds:
        return _single_kind_recipe(kinds[""])
    lines, done = [], []
    for kind, steps in STANDARD_RECIPES.items():
        for command, params in steps if kind in kinds else ():
            lines.append(_recipe_line(command, kind, [name for name in params if name in done]))
            done.append(command.split()[0])
        held_out_kind = f"{kind}_{HOLDOUT_SUFFIX}"
        if held_out_kind in kinds and done:
            lines.append(_recipe_line("validate", held_out_kind, done[-1:], f"validate_{kind}"))
    return lines or [_recipe_line("steady", next(iter(kinds)), [])]


def _single_kind_recipe(group: RecordingGroup) -> list[str]:
    if group.steady:
        return [_recipe_line("steady", "", [])]
    lines = [_recipe_line("blackbox", "", []), _recipe_line("greybox", "", ["blackbox"])]
    return lines + ([_recipe_line("validate", "", ["greybox"], judge="judge: next")] if group.several else [])


def _recipe_line(command: str, kind: str, params: Sequence[str], name: str = "", judge: str = "") -> str:
    words: Mapping[str, str] = {"kind": kind if kind != ONE_KIND else "", "name": name, "command": command,
                                "params": f"[{', '.join(params)}]" if params else ""}
    parts = [f"{key}: {text}" for key, text in words.items() if text] + ([judge] if judge else [])
    return f"  - {{{', '.join(parts)}}}"


def _comment_line(names: Sequence[str]) -> str:
    """Names in one line of a comment; special characters are made visible."""
    return " ".join(escape_unprintable(", ".join(names)).split())


def _yaml_quoted(text: str) -> str:
    """A YAML string; special characters are quoted."""
    return "'" + text.replace("'", "''") + "'"
