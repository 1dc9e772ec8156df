"""A first site file: what was seen in the recordings, as a file to go on from, with comments."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivetool.files.shapes import ONE_KIND, SITE_SCHEMA
from drivetool.files.yaml import visible

# The end of a kind's name whose recordings judge what others were fitted to.
HELD_OUT = "holdout"
# Kinds that a fit of which is known, in the order of the recipe: kind -> (command, earlier steps).
KNOWN = {
    "steady": (("steady", ()),),
    "steps": (("blackbox", ("steady",)), ("greybox", ("steady", "blackbox"))),
    "gap": (("backlash --free all", ("greybox",)),),
}


@dataclass(frozen=True)
class Seen:
    """Recordings that are called alike.

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
    returns  kind: the word of `KNOWN` in the name, with what tells that it is held out; empty, and the pattern *,
             unless each name has one
    """
    held_out, found = _either(HELD_OUT), {}
    for stem in stems:
        for word in KNOWN:
            if there := re.search(f"(?<![A-Za-z]){_either(word)}(?![A-Za-z])", stem):
                kind, words = word, [_either(word)]
                if held := re.search(held_out, stem):
                    kind = f"{word}_{HELD_OUT}"
                    words = [*words, held_out] if there.start() < held.start() else [held_out, *words]
                found[stem] = kind, "*".join(["", *words, ""])
                break
    return found if len(found) == len(set(stems)) else dict.fromkeys(stems, ("", "*"))


def _either(word: str) -> str:
    """A word with or without a capital, as a pattern of paths and as a regular expression."""
    return f"[{word[0].upper()}{word[0]}]{word[1:]}"


def first_site(seen: Sequence[Seen]) -> str:
    """The text of a site file.

    seen  at least one group; the more special pattern first
    """
    recordings = "\n".join(_recordings(each) for each in seen)
    machines = sorted({name for each in seen for name in each.machines})
    shown = _line(machines[:6]) + (f" and {len(machines) - 6} more" if len(machines) > 6 else "")
    steps = "\n".join(_recipe(seen))
    return f"""schema: {SITE_SCHEMA}

# A recording belongs to the first of these patterns that it matches. Paths count from the folder of this file.
# machine: the folder that a recording is in; seen: {shown}.
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


def _recordings(seen: Seen) -> str:
    channels = _line(seen.channels) or "no channels"
    lines = [f"  # {seen.count} recordings; {_line([seen.example])} has {channels}."]
    if seen.metadata:
        lines.append(f"  # Its metadata: {_line(seen.metadata)}.")
    lines.append(f"  - files: {_quoted(seen.files)}")
    lines += [f"    kind: {seen.kind}"] if seen.kind else []
    lines.append("    machine: {folder: 1}")
    if not seen.usable:
        lines += ["    # No channel is called like a role: write a channel map, see docs/how-to/map-channels.md.",
                  "    map: map.yaml"]
    return "\n".join(lines)


def _recipe(seen: Sequence[Seen]) -> list[str]:
    """Lines of the recipe: for known kinds the usual chain, for one kind what its first recording allows."""
    kinds = {each.kind: each for each in seen}
    if "" in kinds:
        return _of_one_kind(kinds[""])
    lines, done = [], []
    for kind, steps in KNOWN.items():
        for command, params in steps if kind in kinds else ():
            lines.append(_step(command, kind, [name for name in params if name in done]))
            done.append(command.split()[0])
        held = f"{kind}_{HELD_OUT}"
        if held in kinds and done:
            lines.append(_step("validate", held, done[-1:], f"validate_{kind}"))
    return lines or [_step("steady", next(iter(kinds)), [])]


def _of_one_kind(seen: Seen) -> list[str]:
    if seen.steady:
        return [_step("steady", "", [])]
    lines = [_step("blackbox", "", []), _step("greybox", "", ["blackbox"])]
    return lines + ([_step("validate", "", ["greybox"], more="judge: next")] if seen.several else [])


def _step(command: str, kind: str, params: Sequence[str], name: str = "", more: str = "") -> str:
    words: Mapping[str, str] = {"kind": kind if kind != ONE_KIND else "", "name": name, "command": command,
                                "params": f"[{', '.join(params)}]" if params else ""}
    parts = [f"{key}: {text}" for key, text in words.items() if text] + ([more] if more else [])
    return f"  - {{{', '.join(parts)}}}"


def _line(names: Sequence[str]) -> str:
    """Names in one line of a comment, whatever signs are in them."""
    return " ".join(visible(", ".join(names)).split())


def _quoted(text: str) -> str:
    """As YAML takes it, whatever signs are in it."""
    return "'" + text.replace("'", "''") + "'"
