"""The run of a site: look into the recordings, do what is not done, write down what came of it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from drivetool.cli.batch.kept import keep, take_over
from drivetool.cli.batch.recipe import Step
from drivetool.cli.batch.recordings import Machine, Recording, machines_of
from drivetool.cli.batch.tasks import Maker, Output, Task, reasons, shared
from drivetool.errors import DriveToolError
from drivetool.files.site.manifest import Manifest
from drivetool.files.site.summary import Entry
from drivetool.files.site.told import Told
from drivetool.progress import tell


class Executor(Protocol):
    """Whoever does tasks: the pool of this machine, or a cluster."""

    def run(self, tasks: Sequence[dict[str, Any]]) -> Iterator[tuple[int, dict[str, Any]]]:
        """Do the tasks; (its number, what came of it) of each as it ends."""


@dataclass(frozen=True)
class Setting:
    """What a run goes by.

    folder     of the site file, absolute; out: of the results, absolute
    limits     of a task by how it ends: time [s], memory [MB]
    numerics   versions that the numbers depend on
    executor   None: nothing is run, only checked
    say        takes a line for a person
    explain    takes a line on why something is run; None: nobody asks
    """

    folder: Path
    out: Path
    steps: tuple[Step, ...]
    limits: Mapping[str, float]
    numerics: Mapping[str, str]
    executor: Executor | None
    say: Callable[[str], None]
    explain: Callable[[str], None] | None = None
    retry: bool = False


@dataclass
class Outcome:
    """What is known after a run.

    entries   of the summary, in its order
    outputs   recording (or machine) and step -> file from the folder of the results
    begun     how many tasks were run; undone: what would have to be, and why
    """

    entries: list[Entry] = field(default_factory=list)
    outputs: dict[tuple[str, str, str], str] = field(default_factory=dict)
    begun: int = 0
    undone: list[str] = field(default_factory=list)


def run_site(setting: Setting, found: Sequence[Recording], manifest: Manifest) -> Outcome:
    """Do the recipe with the recordings.

    found    recordings whose content is known
    returns  Outcome
    raises   CannotWrite: the disk is full; what is done by then stays done
    """
    outcome = Outcome()
    _look(setting, found, manifest, outcome)
    machines, lost = machines_of(found, manifest.looks)
    _say_order(setting, machines)
    outputs: dict[tuple[str, str, str], Output] = {}
    steps = {step.name: step for step in setting.steps}
    results: dict[tuple[str, str, str], Entry] = {}
    for step in setting.steps:
        maker = Maker(setting.folder, os.path.relpath(setting.out, setting.folder).replace(os.sep, "/"), steps,
                      setting.numerics, outputs)
        tasks = [task for machine in machines for task in maker.tasks(step, machine)]
        _say_shared(setting, shared(tasks))
        lines = _do(setting, step, tasks, manifest, outcome)
        for task, line in zip(tasks, lines, strict=True):
            key = step.name, task.machine, task.path
            results[key] = _entry(task, line)
            if line is not None and line["sha256"] is not None:
                outputs[key] = Output(line["sha256"], line["content"])
                outcome.outputs[task.machine, task.path, step.name] = task.output
    outcome.entries = _ordered(setting, machines, lost, results)
    return outcome


def _look(setting: Setting, found: Sequence[Recording], manifest: Manifest, outcome: Outcome) -> None:
    """When each recording began, and what is noted in it; each content once."""
    new = {r.look: r for r in found if r.look not in manifest.looks}
    if setting.executor is None:
        outcome.undone += [f"{r.path}: it has not been run" for r in found if r.look in new]
        return
    asked = list(new.values())
    tasks = [{"folder": str(setting.folder), "look": r.path, "map": r.section.map} for r in asked]
    for count, (index, answer) in enumerate(setting.executor.run(tasks), 1):
        sha, map_sha = asked[index].look
        manifest.append({"look": sha, "map": map_sha, "start": answer.get("start"),
                         "metadata": answer.get("metadata", {})})
        tell("look into the recordings", count, len(asked))


def _say_order(setting: Setting, machines: Sequence[Machine]) -> None:
    named = [machine.name for machine in machines if machine.by_name and len(machine.recordings) > 1]
    if named:
        setting.say(f"recordings without absolute time are ordered by name: machine {_few(named)}")


def _say_shared(setting: Setting, pairs: Sequence[tuple[Task, Task]]) -> None:
    if pairs:
        named = [f"{task.path or task.machine} is {owner.path or owner.machine}" for task, owner in pairs]
        setting.say(f"{pairs[0][0].step.name}: {len(pairs)} of equal content are fitted once and listed under both "
                    f"({_few(named)})")


def _few(names: Sequence[str]) -> str:
    """The first three of many."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _do(setting: Setting, step: Step, tasks: Sequence[Task], manifest: Manifest, outcome: Outcome,
        ) -> list[Mapping[str, Any] | None]:
    """The lines of the tasks of a step, once all that was not done is; None for what cannot be."""
    waiting = []
    for task in tasks:
        why = [] if task.problem else reasons(task, manifest.steps.get(task.output), setting.out, setting.limits,
                                              setting.retry)
        if why:
            waiting.append(task)
            outcome.undone.append(f"{task.label}: {'; '.join(why)}")
            if setting.explain:
                setting.explain(outcome.undone[-1])
    if setting.executor is not None:
        known = {line["content"]: line for line in manifest.steps.values() if line["sha256"] is not None}
        waiting = [task for task in waiting if not take_over(task, known.get(task.content), setting.out, manifest)]
        while waiting:
            first = list({task.content: task for task in reversed(waiting)}.values())[::-1]
            _run(setting, step, first, manifest, outcome)
            lines = {task.content: manifest.steps[task.output] for task in first}
            waiting = [task for task in waiting if task not in first
                       and not take_over(task, lines[task.content], setting.out, manifest)]
    return [None if task.problem else manifest.steps.get(task.output) for task in tasks]


def _run(setting: Setting, step: Step, tasks: Sequence[Task], manifest: Manifest, outcome: Outcome) -> None:
    """Run tasks, and write down what comes of each as it ends."""
    assert setting.executor is not None
    outcome.begun += len(tasks)
    asked = [{"folder": str(setting.folder), "words": [*task.words, "--quiet", "--out", "-"]} for task in tasks]
    for count, (index, answer) in enumerate(setting.executor.run(asked), 1):
        task, text, ended = tasks[index], answer.get("text"), answer.get("ended")
        keep(task, {
            "code": answer.get("code"), "problem": None if text is not None else answer["said"], "ended": ended,
            "limit": setting.limits.get(ended or "", 0.0), "told": answer.get("told"),
            "seconds": answer.get("seconds"), "peak_memory_mb": answer.get("peak_memory_mb")},
            text, setting.out, manifest)
        tell(step.name, count, len(tasks))
        if text is None or not sys.stderr.isatty():  # a person at a terminal has the bar
            setting.say(f"{count} of {len(tasks)}: {task.label}" + (f": {answer['said']}" if text is None else ""))


def _entry(task: Task, line: Mapping[str, Any] | None) -> Entry:
    """What the summary has of a task."""
    recording = task.recording
    told = line["told"] if line else None
    problem = task.problem or (line["problem"] if line else None) or (None if line else "it has not been run")
    return Entry(
        task.path, task.machine, task.step.kind, recording.start if recording else None,
        recording.order if recording else 0, task.step.name, None if told is None else Told(**told), problem,
        line["seconds"] if line else None, line["peak_memory_mb"] if line else None)


def _ordered(setting: Setting, machines: Sequence[Machine], lost: Sequence[Recording],
             results: Mapping[tuple[str, str, str], Entry]) -> list[Entry]:
    """By machine, place in its order and step; what has no machine first."""
    entries = [Entry(r.path, "", r.kind, r.start, 0, step.name, None, r.problem)
               for r in lost for step in setting.steps if step.kind == r.kind]
    for machine in machines:
        for path in ("", *(r.path for r in machine.recordings)):
            keys = [(step.name, machine.name, path) for step in setting.steps]
            entries += [results[key] for key in keys if key in results]
    if not entries:
        raise DriveToolError("something to do", "no recording of a kind that a step of the recipe reads",
                             "Correct kind at recordings or in the recipe of the site file.")
    return entries
