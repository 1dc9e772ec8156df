"""The tasks: a step of a recording with all that it reads, and whether it must be run again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import Any

from drivetool.files.shapes import NEXT, PREVIOUS
from drivetool.logs.formats import file_sha256
from drivetool.site.plan.recipe import RecipeStep
from drivetool.site.plan.recordings import Machine, Recording, safe_folder_name
from drivetool.site.pool import UNREAD

ManifestLine = Mapping[str, Any]


Outputs = Mapping[tuple[str, str, str], ManifestLine]  # of files, by step, machine, recording or ""


@dataclass
class StepTask:
    """A step of one recording, or of all recordings of a machine together.

    recording  None for recordings together
    output     path of its file from the folder of the results
    words      of the command line, without --quiet and --out
    inputs     on which the result depends, by name
    origins    hashes of the inputs of the parameter files
    problem    why it cannot be run
    """

    step: RecipeStep
    machine: str
    recording: Recording | None
    output: str
    words: list[str] = field(default_factory=list)
    inputs: dict[str, Any] = field(default_factory=dict)
    origins: list[str] = field(default_factory=list)
    problem: str = ""

    @property
    def path(self) -> str:
        """Path of the recording; empty for recordings together."""
        return self.recording.path if self.recording else ""

    @property
    def label(self) -> str:
        """Its name in messages."""
        return f"{self.step.name} of {self.path or self.machine}"

    @property
    def key(self) -> str:
        """SHA-256 of everything on which the result depends."""
        return _sha256_of_json(self.inputs)

    @property
    def content(self) -> str:
        """The same without the names of recordings: equal for equal bytes in the same format."""
        made_of = {name: value for name, value in self.inputs.items() if name not in ("names", "params")}
        formats = [PurePosixPath(name).suffix.lower() for name in self.inputs["names"]]
        return _sha256_of_json({**made_of, "origins": self.origins, "formats": formats})


def _sha256_of_json(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class TaskBuilder:
    """Makes the tasks of a step.

    out       path of the results from the folder of the site file
    steps     by name
    numerics  library versions on which the numbers depend
    outputs   files that exist so far
    """

    out: str
    steps: Mapping[str, RecipeStep]
    numerics: Mapping[str, str]
    outputs: Outputs

    def tasks(self, step: RecipeStep, machine: Machine) -> list[StepTask]:
        """The tasks of a step for a machine."""
        of_kind = [r for r in machine.recordings if r.kind == step.kind]
        if step.joint:
            task = StepTask(step, machine.name, None, f"{safe_folder_name(machine.name)}/{step.name}.yaml")
            return [self._with_inputs(task, machine, of_kind, machine.recordings[-1].order)] if of_kind else []
        return [self._single_recording_task(step, machine, recording) for recording in of_kind]

    def _single_recording_task(self, step: RecipeStep, machine: Machine, recording: Recording) -> StepTask:
        task = StepTask(step, machine.name, recording, f"{recording.folder}/{step.name}.yaml")
        if step.judge is None:
            return self._with_inputs(task, machine, [recording], recording.order)
        holdout = holdout_recording(step.judge, machine, recording)
        if holdout is None:
            what = "another recording" if step.judge in (NEXT, PREVIOUS) else f"a recording of kind {step.judge}"
            task.problem = (f"wanted {what} of {machine.name} to validate the fit of {recording.path}; found none. "
                            "Add one to the machine, or change judge in the recipe.")
            return task
        logs = [holdout] if step.command == "validate" else [recording]
        return self._with_inputs(task, machine, logs, recording.order,
                                 holdout if step.command == "diagnose" else None)

    def _with_inputs(self, task: StepTask, machine: Machine, logs: Sequence[Recording], order: int,
                holdout: Recording | None = None) -> StepTask:
        """The task with its words and inputs, or with the problem that files of an earlier step are missing."""
        step, params = task.step, []
        for name in step.params:
            newest = find_newest_output(self.outputs, self.steps[name], machine, order)
            if newest is None:
                task.problem = (f"wanted a file of {name} for {machine.name}; found none, because no recording of "
                                f"the machine produced one. See the problems of {name} in the summary.")
                return task
            params.append((f"{self.out}/{newest['output']}", [f"{name}.yaml", newest["sha256"]]))
            task.origins.append(newest["content"])
        read_recordings = [*logs, *([holdout] if holdout else [])]
        maps = {(r.section.map, r.map_sha256) for r in read_recordings} if step.map is None else {(None, None)}
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
            "recordings": [r.sha256 for r in read_recordings], "names": [r.path for r in read_recordings],
            "command": step.command, "options": dict(step.options), "map": map_sha,
            "params": [sha for _, sha in params], "files": dict(step.files), "numerics": dict(self.numerics)}
        return task


def find_newest_output(outputs: Outputs, step: RecipeStep, machine: Machine, order: int) -> ManifestLine | None:
    """The newest file of a step for a machine: of the last recording at or before the place in the machine's order
    that has one, else of the first one after; None where there is none.
    """
    paths = [""] if step.joint else (r.path for r in _recordings_at(
        machine, range(order - 1, -1, -1), range(order, len(machine.recordings))))
    return next((line for path in paths if (line := outputs.get((step.name, machine.name, path)))), None)


def holdout_recording(judge: str, machine: Machine, recording: Recording) -> Recording | None:
    """The held-out recording for the fit of another; never one of the same content."""
    kind = recording.kind if judge in (NEXT, PREVIOUS) else judge
    ranges = range(recording.order - 2, -1, -1), range(recording.order, len(machine.recordings))
    return next((r for r in _recordings_at(machine, *(reversed(ranges) if judge == NEXT else ranges))
                 if r.kind == kind and r.sha256 != recording.sha256), None)


def _recordings_at(machine: Machine, *places: range) -> Iterator[Recording]:
    """The recordings at given places of the machine's order, counted from zero."""
    return (machine.recordings[i] for i in chain(*places))


def duplicates(tasks: Sequence[StepTask]) -> list[tuple[StepTask, StepTask]]:
    """(a task, the first one by path with the same content) of all that have one."""
    first: dict[str, StepTask] = {}
    pairs = [(task, first.setdefault(task.content, task))
             for task in sorted((t for t in tasks if not t.problem), key=lambda t: t.path)]
    return [(task, owner) for task, owner in pairs if owner is not task]


def rerun_reasons(task: StepTask, line: ManifestLine | None, out: Path, limits: Mapping[str, float],
                  retry: bool) -> list[str]:
    """Why a task must run: what has changed since its last manifest line, by name; empty if nothing has."""
    if line is None:
        return ["it has not been run"]
    if line["key"] != task.key:
        return _input_changes(line["inputs"], task.inputs) or ["its inputs have changed"]
    if line["sha256"] is not None:
        return _file_changes(out / task.output, line["sha256"])
    return retry_reasons(line, limits, retry)


def retry_reasons(line: ManifestLine, limits: Mapping[str, float], retry: bool) -> list[str]:
    """Why a task without a result is run again with equal inputs; empty if it is not."""
    if retry:
        return ["--retry"]
    if line["ended"] == UNREAD:
        return ["its recording was missing or changed during the last run"]
    return [f"the limit of {line['ended']} is higher"] if line["limit"] < limits.get(line["ended"], 0.0) else []


def _file_changes(path: Path, sha256: str) -> list[str]:
    try:
        return [] if file_sha256(path) == sha256 else ["its file was changed"]
    except OSError:
        return ["its file is missing"]


def _input_changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What has changed in the inputs, in words."""
    labels = {"recordings": "the content of the recording", "names": "the path of the recording",
            "command": "the command", "map": "the channel map"}
    changes = [text for name, text in labels.items() if before.get(name) != now[name]]
    if before.get("params") != now["params"]:
        old = {tuple(entry) for entry in before.get("params", ())}
        names = [name for name, sha in now["params"] if (name, sha) not in old]
        changes.append("the parameter file " + ", ".join(names) if names else "the parameter files")
    for name, text in (("options", "the option --{}"), ("files", "the file {}"), ("numerics", "the version of {}")):
        old, new = before.get(name, {}), now[name]
        for key in sorted(old.keys() | new.keys()):
            if old.get(key) != new.get(key):
                versions = "" if name == "files" else f" ({old.get(key)} -> {new.get(key)})"
                changes.append(text.format(key) + versions)
    return changes
