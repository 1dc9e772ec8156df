"""Which tasks can be done when: a step of a machine, once the steps that it reads are done for that machine."""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivetool.progress import tell
from drivetool.site.plan.kept import keep, take_over
from drivetool.site.plan.recipe import Step
from drivetool.site.plan.recordings import Machine, content_of
from drivetool.site.plan.setting import Setting
from drivetool.site.plan.tasks import Line, Maker, Output, Task, reasons
from drivetool.site.pool import UNREAD, Numbered
from drivetool.site.results import Manifest


@dataclass(eq=False)
class Stage:
    """A step of a machine; left: how many of its tasks are still to end."""

    step: Step
    machine: Machine
    tasks: list[Task] = field(default_factory=list)
    left: int = 0


class Agenda:
    """The tasks of a site in the order in which they can be done.

    stages  by step, then by machine
    begun   how many tasks were run; undone: what was not done before, and why
    """

    def __init__(self, setting: Setting, machines: Sequence[Machine], manifest: Manifest):
        self.setting, self.manifest = setting, manifest
        self.stages = [Stage(step, machine) for step in setting.steps for machine in machines]
        self.begun, self.undone = 0, list[str]()
        self._total = sum(1 if s.step.joint else sum(r.kind == s.step.kind for r in s.machine.recordings)
                          for s in self.stages)
        self._ended = 0
        self._waiting: dict[str, list[Stage]] = {}
        for stage in self.stages:
            self._waiting.setdefault(stage.machine.name, []).append(stage)
        self._ready = deque(self._waiting)  # machines that may have stages to begin
        self._outputs: dict[tuple[str, str, str], Output] = {}
        self._closed: set[tuple[str, str]] = set()
        self._given: list[tuple[Task, Stage]] = []  # by number
        self._running: dict[str, list[tuple[Task, Stage]]] = {}  # content -> further tasks that wait for one of it
        self._again: list[tuple[Task, Stage]] = []
        self._done = {line["content"]: line for line in manifest.steps.values() if line["sha256"] is not None}
        self._maker = Maker(os.path.relpath(setting.out, setting.folder).replace(os.sep, "/"),
                            {step.name: step for step in setting.steps}, setting.numerics, self._outputs)

    def more(self) -> Numbered:
        """The tasks that can be done by now and were not given yet, with numbers for `take`."""
        given = [self._give(task, stage) for task, stage in self._again]
        self._again.clear()
        while self._ready:
            waiting = self._waiting[self._ready.popleft()]
            for stage in [stage for stage in waiting if self._can_begin(stage)]:
                waiting.remove(stage)
                given += self._begun(stage)
        return given

    def _can_begin(self, stage: Stage) -> bool:
        return all((name, stage.machine.name) in self._closed for name in stage.step.params)

    def checked(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Look at every task and run none."""
        self.more()
        return iter(())

    def line(self, task: Task) -> Line | None:
        """What the manifest has of a task; None for one that cannot be done."""
        return None if task.problem else self.manifest.steps.get(task.output)

    def take(self, number: int, answer: Mapping[str, Any]) -> None:
        """Keep what came of a task, also for those of equal content."""
        task, stage = self._given[number]
        text = answer.get("text")
        ended = answer.get("ended") or (None if text is not None or self._is_as_found(task) else UNREAD)
        keep(task, {
            "code": answer.get("code"), "problem": None if text is not None else answer["said"], "ended": ended,
            "limit": self.setting.limits.get(ended or "", 0.0), "told": answer.get("told"),
            "seconds": answer.get("seconds"), "peak_memory_mb": answer.get("peak_memory_mb")},
            text, self.setting.out, self.manifest)
        line = self.manifest.steps[task.output]
        if text is not None:
            self._done[task.content] = line
        self._end(stage)
        if text is None or not sys.stderr.isatty():  # a person at a terminal has the bar
            self.setting.say(f"{self._ended} of {self._total}: {task.label}"
                             + (f": {answer['said']}" if text is None else ""))
        for other, its_stage in self._running.pop(task.content, ()):
            if take_over(other, line, self.setting.out, self.manifest):
                self._end(its_stage)
            else:
                self._again.append((other, its_stage))

    def _is_as_found(self, task: Task) -> bool:
        """Whether its recordings still have the content that they were found with."""
        return task.inputs["recordings"] == [content_of(name, self.setting.folder) for name in task.inputs["names"]]

    def _begun(self, stage: Stage) -> list[tuple[int, dict[str, Any]]]:
        """Make the tasks of a stage; those to be run."""
        given = []
        stage.tasks = self._maker.tasks(stage.step, stage.machine)
        stage.left = len(stage.tasks) + 1
        for task in stage.tasks:
            if not self._is_to_run(task):
                self._end(stage)
            elif task.content in self._running:
                self._running[task.content].append((task, stage))
            else:
                given.append(self._give(task, stage))
        stage.left -= 1
        self._close(stage)
        return given

    def _is_to_run(self, task: Task) -> bool:
        if task.problem:
            return False
        setting = self.setting
        why = reasons(task, self.line(task), setting.out, setting.limits, setting.retry)
        if not why:
            return False
        self.undone.append(f"{task.label}: {'; '.join(why)}")
        if setting.explain:
            setting.explain(self.undone[-1])
        return setting.executor is not None and not take_over(
            task, self._done.get(task.content), setting.out, self.manifest)

    def _give(self, task: Task, stage: Stage) -> tuple[int, dict[str, Any]]:
        self.begun += 1
        self._running.setdefault(task.content, [])
        self._given.append((task, stage))
        return len(self._given) - 1, {"folder": str(self.setting.folder),
                                      "words": [task.words[0], "--quiet", "--out", "-", *task.words[1:]]}

    def _end(self, stage: Stage) -> None:
        self._ended += 1
        stage.left -= 1
        if self.setting.executor is not None:
            tell("recordings and steps", self._ended, self._total)
        self._close(stage)

    def _close(self, stage: Stage) -> None:
        """Once all its tasks have ended, its files can be read."""
        if stage.left:
            return
        for task in stage.tasks:
            line = self.line(task)
            if line is not None and line["sha256"] is not None:
                key = stage.step.name, stage.machine.name, task.path
                self._outputs[key] = Output(line["sha256"], line["content"])
        self._closed.add((stage.step.name, stage.machine.name))
        self._ready.append(stage.machine.name)
