"""What is to be done: a step of a recording with all that it reads, and whether that was done before."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import Any

from drivetool.files.shapes import NEXT, PREVIOUS
from drivetool.site.plan.recipe import Step
from drivetool.site.plan.recordings import Machine, Recording, digest, safe
from drivetool.site.pool import UNREAD

Line = Mapping[str, Any]


@dataclass(frozen=True)
class Output:
    """A file of a step: its sha256, and what it was made of (`Task.content`)."""

    sha256: str
    content: str


Outputs = Mapping[tuple[str, str, str], Output]  # by step, machine, recording or ""


@dataclass
class Task:
    """A step of one recording, or of a machine's together.

    recording  the one it belongs to; None of recordings together
    output     path of its file from the folder of the results
    words      of the command line, but for --quiet and --out
    inputs     what the result depends on, by name
    origins    what the parameter files were made of
    problem    why it cannot be done
    """

    step: Step
    machine: str
    recording: Recording | None
    output: str
    words: list[str] = field(default_factory=list)
    inputs: dict[str, Any] = field(default_factory=dict)
    origins: list[str] = field(default_factory=list)
    problem: str = ""

    @property
    def path(self) -> str:
        """Of the recording; empty of recordings together."""
        return self.recording.path if self.recording else ""

    @property
    def label(self) -> str:
        """What messages call it."""
        return f"{self.step.name} of {self.path or self.machine}"

    @property
    def key(self) -> str:
        """SHA-256 of everything that the result depends on."""
        return _hash(self.inputs)

    @property
    def content(self) -> str:
        """The same without what recordings are called: equal where one of the same format has the same bytes."""
        made_of = {name: value for name, value in self.inputs.items() if name not in ("names", "params")}
        formats = [PurePosixPath(name).suffix.lower() for name in self.inputs["names"]]
        return _hash({**made_of, "origins": self.origins, "formats": formats})


def _hash(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class Maker:
    """Makes the tasks of a step.

    out       path of the results from the folder of the site file
    steps     by name
    numerics  versions that the numbers depend on
    outputs   files that there are by now
    """

    out: str
    steps: Mapping[str, Step]
    numerics: Mapping[str, str]
    outputs: Outputs

    def tasks(self, step: Step, machine: Machine) -> list[Task]:
        """The tasks of a step with the recordings of a machine."""
        mine = [r for r in machine.recordings if r.kind == step.kind]
        if step.joint:
            task = Task(step, machine.name, None, f"{safe(machine.name)}/{step.name}.yaml")
            return [self._filled(task, machine, mine, machine.recordings[-1].order)] if mine else []
        return [self._of_one(step, machine, recording) for recording in mine]

    def _of_one(self, step: Step, machine: Machine, recording: Recording) -> Task:
        task = Task(step, machine.name, recording, f"{recording.folder}/{step.name}.yaml")
        if step.judge is None:
            return self._filled(task, machine, [recording], recording.order)
        judge = judging(step.judge, machine, recording)
        if judge is None:
            what = "another recording" if step.judge in (NEXT, PREVIOUS) else f"a recording of kind {step.judge}"
            task.problem = (f"wanted {what} of {machine.name} to judge the fit of {recording.path}; found none. "
                            "Add one to the machine, or change judge in the recipe.")
            return task
        logs = [judge] if step.command == "validate" else [recording]
        return self._filled(task, machine, logs, recording.order, judge if step.command == "diagnose" else None)

    def _filled(self, task: Task, machine: Machine, logs: Sequence[Recording], order: int,
                holdout: Recording | None = None) -> Task:
        """The task with its words and inputs, or with the problem that there are no files of an earlier step."""
        step, params = task.step, []
        for name in step.params:
            place = newest(self.outputs, self.steps[name], machine, order)
            if place is None:
                task.problem = (f"wanted a file of {name} for {machine.name}; found none, as no recording of the "
                                f"machine gave one. See the problems of {name} in the summary.")
                return task
            params.append((f"{self.out}/{place[1]}", [f"{name}.yaml", place[0].sha256]))
            task.origins.append(place[0].content)
        read = [*logs, *([holdout] if holdout else [])]
        maps = {(r.section.map, r.map_sha256) for r in read} if step.map is None else {(None, None)}
        if len(maps) > 1:
            task.problem = (f"wanted one channel map for {task.label}; found {len(maps)}. Give these recordings "
                            "one map at recordings of the site file.")
            return task
        [(channel_map, map_sha)] = maps
        task.words = [step.command, *step.words, *(word for path, _ in params for word in ("--params", path))]
        task.words += ["--map", channel_map] if channel_map else []
        task.words += ["--holdout", holdout.path] if holdout else []
        task.words += ["--", *(r.path for r in logs)]
        task.inputs = {
            "recordings": [r.sha256 for r in read], "names": [r.path for r in read], "command": step.command,
            "options": dict(step.options), "map": map_sha, "params": [sha for _, sha in params],
            "files": dict(step.files), "numerics": dict(self.numerics)}
        return task


def newest(outputs: Outputs, step: Step, machine: Machine, order: int) -> tuple[Output, str] | None:
    """(output, path) of the newest file of a step for a machine: of the last recording at or before the place in
    the machine's order that has one, else of the first one after; None where there is none.
    """
    if step.joint:
        output = outputs.get((step.name, machine.name, ""))
        return (output, f"{safe(machine.name)}/{step.name}.yaml") if output else None
    for r in _around(machine, range(order - 1, -1, -1), range(order, len(machine.recordings))):
        if output := outputs.get((step.name, machine.name, r.path)):
            return output, f"{r.folder}/{step.name}.yaml"
    return None


def judging(judge: str, machine: Machine, recording: Recording) -> Recording | None:
    """The recording that judges the fit of another; none of the same content, which would judge itself."""
    kind = recording.kind if judge in (NEXT, PREVIOUS) else judge
    ranges = range(recording.order - 2, -1, -1), range(recording.order, len(machine.recordings))
    return next((r for r in _around(machine, *(reversed(ranges) if judge == NEXT else ranges))
                 if r.kind == kind and r.sha256 != recording.sha256), None)


def _around(machine: Machine, *places: range) -> Iterator[Recording]:
    """The recordings at places of the machine's order, counted from zero."""
    return (machine.recordings[i] for i in chain(*places))


def shared(tasks: Sequence[Task]) -> list[tuple[Task, Task]]:
    """(a task, the one before it by path that has the same content) of all that have one."""
    first: dict[str, Task] = {}
    pairs = [(task, first.setdefault(task.content, task))
             for task in sorted((t for t in tasks if not t.problem), key=lambda t: t.path)]
    return [(task, owner) for task, owner in pairs if owner is not task]


def reasons(task: Task, line: Line | None, out: Path, limits: Mapping[str, float], retry: bool) -> list[str]:
    """Why a task is to be done: what has changed since its last line in the manifest, by name; none if nothing."""
    if line is None:
        return ["it has not been run"]
    if line["key"] != task.key:
        return _changes(line["inputs"], task.inputs) or ["its inputs have changed"]
    if line["sha256"] is not None:
        return _of_file(out / task.output, line["sha256"])
    return again(line, limits, retry)


def again(line: Line, limits: Mapping[str, float], retry: bool) -> list[str]:
    """Why what gave nothing is to be done again with equal inputs; none if it is not."""
    if retry:
        return ["--retry"]
    if line["ended"] == UNREAD:
        return ["its recording could not be read as it was found"]
    return [f"the limit of {line['ended']} is higher"] if line["limit"] < limits.get(line["ended"], 0.0) else []


def _of_file(path: Path, sha256: str) -> list[str]:
    try:
        return [] if digest(path) == sha256 else ["its file was changed"]
    except OSError:
        return ["its file is missing"]


def _changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What differs between the inputs of then and now, in words."""
    said = {"recordings": "the content of the recording", "names": "the path of the recording",
            "command": "the command", "map": "the channel map"}
    found = [text for name, text in said.items() if before.get(name) != now[name]]
    if before.get("params") != now["params"]:
        old = {tuple(entry) for entry in before.get("params", ())}
        names = [name for name, sha in now["params"] if (name, sha) not in old]
        found.append("the parameter file " + ", ".join(names) if names else "the parameter files")
    for name, text in (("options", "the option --{}"), ("files", "the file {}"), ("numerics", "the version of {}")):
        old, new = before.get(name, {}), now[name]
        for key in sorted(old.keys() | new.keys()):
            if old.get(key) != new.get(key):
                shown = "" if name == "files" else f" ({old.get(key)} -> {new.get(key)})"
                found.append(text.format(key) + shown)
    return found
