"""The site file, read and checked: consistent names, before anything runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from drivetool.errors import BadParameters, nearest
from drivetool.files.shapes import (
    NEXT,
    PREVIOUS,
    SITE_SCHEMA,
    BarSection,
    MachineSection,
    MeasureSection,
    RecordingsSection,
    Shape,
    SiteFile,
    StepSection,
)
from drivetool.files.yaml import checked, from_yaml, units

HOLDOUT_COMMANDS = ("validate", "diagnose")  # the commands that use held-out recordings
MACHINE_PLACEHOLDER = "{machine}"
_SECTION_TYPES = {"recordings": RecordingsSection, "recipe": StepSection, "bars": BarSection}


def load_site(path: str | Path) -> SiteFile:
    """Read a site file, or a recipe, which has no recordings.

    path     of the YAML file
    returns  SiteFile
    raises   BadParameters: a file that cannot be read, an unknown key, inconsistent names
    """
    name = Path(path).name
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise BadParameters(f"to read the site file {path}", error.strerror or str(error),
                            "Check the path.") from None
    raw = from_yaml(data, name)
    if raw.get("schema") != SITE_SCHEMA:
        raise BadParameters(f"schema {SITE_SCHEMA}", f"{raw.get('schema') or 'no schema'} in {name}",
                            f"Begin the file with 'schema: {SITE_SCHEMA}'; `drivetool init` writes a first one.")
    for key, shape in _SECTION_TYPES.items():
        for index, item in enumerate(checked.checked_kind(raw.get(key, []), list, name, key, "site")):
            _check_section(item, shape, name, f"{key}[{index}]")
    site = checked.result_file(raw, SiteFile, name)
    _check_recordings(site.recordings, name)
    _check_recipe(site, name)
    for index, bar in enumerate(site.bars):
        _check_bar(bar, site.recipe, f"bars[{index}] of {name}")
    return site


def with_recordings(site: SiteFile, patterns: Sequence[str], kind: str, channel_map: str | None) -> SiteFile:
    """A recipe with recordings, all of one kind."""
    return replace(site, recordings=tuple(
        RecordingsSection(files=each, kind=kind, map=channel_map) for each in patterns))


def _check_section(item: Any, shape: type[Shape], name: str, where: str) -> None:
    """One entry of a list, and the mappings in it."""
    for key, inner in (("machine", MachineSection), ("at_most", MeasureSection), ("at_least", MeasureSection)):
        if isinstance(item, dict) and key in shape.__struct_fields__ and isinstance(item.get(key), dict):
            checked.check_section(item[key], inner, name, f"{where}.{key}", "site")
    checked.check_section(item, shape, name, where, "site")


def step_name(step: StepSection) -> str:
    """What the files of a step are called."""
    return step.name or step.command.split()[0]


def _check_recordings(sections: Sequence[RecordingsSection], name: str) -> None:
    for index, section in enumerate(sections):
        where, machine = f"recordings[{index}] of {name}", section.machine
        if not section.files.strip():
            raise BadParameters(f"a pattern of paths at {where}", "an empty one",
                                "Write for example 'logs/**/*.mcap'.")
        if isinstance(machine, MachineSection):
            given_keys = [key for key in ("folder", "file", "metadata") if getattr(machine, key) is not None]
            if len(given_keys) != 1:
                raise BadParameters(f"one of folder, file and metadata at machine in {where}",
                                    " and ".join(given_keys) or "none", "Say one of them.")
            if machine.file is not None and machine.file.count(MACHINE_PLACEHOLDER) != 1:
                raise BadParameters(f"{MACHINE_PLACEHOLDER} once in the pattern of the machine in {where}",
                                    f"'{machine.file}'",
                                    f"Write for example '{MACHINE_PLACEHOLDER}_*.mcap'.")
        elif machine is not None and not machine.strip():
            raise BadParameters(f"the name of a machine at {where}", "an empty one", "Name it, or leave it out.")


def _check_recipe(site: SiteFile, name: str) -> None:
    if not site.recipe:
        raise BadParameters(f"at least one step at recipe in {name}", "none",
                            "Write for example '- {command: steady}'.")
    known = list(dict.fromkeys(section.kind for section in site.recordings))
    earlier: list[str] = []
    for index, step in enumerate(site.recipe):
        where = f"recipe[{index}] of {name}"
        if not step.command.split():
            raise BadParameters(f"a command at {where}", "an empty one", "Write it as typed, without file names.")
        for each in step.params:
            if each not in earlier:
                raise BadParameters(f"an earlier step at params of {where}", f"'{each}'",
                                    nearest(each, earlier) if earlier else "No step comes before it: leave it out.")
        _check_judge(step, known, where)
        if site.recordings and step.kind not in known:
            raise BadParameters(f"a kind of recordings at {where}", f"'{step.kind}'", nearest(step.kind, known))
        if step_name(step) in earlier:
            raise BadParameters(f"steps with names of their own in {name}", f"'{step_name(step)}' twice",
                                "Give one of them a name, as in 'name: greybox2'.")
        earlier.append(step_name(step))


def _check_judge(step: StepSection, known: Sequence[str], where: str) -> None:
    if step.judge is None:
        return
    if step.command.split()[0] not in HOLDOUT_COMMANDS or step.joint:
        raise BadParameters(f"judge with {' or '.join(HOLDOUT_COMMANDS)}, one recording at a time, at {where}",
                            f"it with {'joint: true' if step.joint else step.command.split()[0]}", "Leave it out.")
    if known and step.judge not in (NEXT, PREVIOUS, *known):
        raise BadParameters(f"next, previous or a kind of recordings as the value of judge at {where}",
                            f"'{step.judge}'", nearest(step.judge, [NEXT, PREVIOUS, *known]))


def _check_bar(bar: BarSection, recipe: Sequence[StepSection], where: str) -> None:
    given_keys = [key for key in ("at_most", "at_least") if getattr(bar, key) is not None]
    if (not bar.figure) == (bar.findings is None):
        raise BadParameters(f"either figure or findings at {where}", "both" if bar.figure else "none of them",
                            "Make two bars of it, or say one of them.")
    if len(given_keys) != bool(bar.figure):
        wanted = "one of at_most and at_least" if bar.figure else "no limit beside findings"
        raise BadParameters(f"{wanted} at {where}", " and ".join(given_keys) or "none",
                            "Write for example '{figure: shaft.half_gap, at_most: {value: 5, unit: mrad}}'.")
    for key in given_keys:
        limit = getattr(bar, key)
        value = limit.value if isinstance(limit, MeasureSection) else limit
        if not math.isfinite(value):
            raise BadParameters(f"a finite number of {key} at {where}", f"{value}", "Correct it.")
        if isinstance(limit, MeasureSection) and not units.is_known(limit.unit):
            raise BadParameters(f"a unit of {key} at {where}", f"'{limit.unit}'",
                                "Write it as in 'mrad' or 'Nm/rad'.")
    names = [step_name(step) for step in recipe]
    if bar.step is not None and bar.step not in names:
        raise BadParameters(f"a step of the recipe at {where}", f"'{bar.step}'", nearest(bar.step, names))
