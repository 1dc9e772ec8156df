"""When a task can run: a step of a machine, once the steps that it reads are done for that machine."""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivetool.progress import report_progress
from drivetool.site.plan.recipe import RecipeStep
from drivetool.site.plan.recordings import Machine, recording_sha256
from drivetool.site.plan.result_store import reuse_result, store_result
from drivetool.site.plan.run_options import RunOptions
from drivetool.site.plan.tasks import ManifestLine, StepTask, TaskBuilder, rerun_reasons
from drivetool.site.pool import UNREAD, NumberedTasks
from drivetool.site.results import Manifest


@dataclass(eq=False)
class Stage:
    """A step of a machine; unfinished_count: how many of its tasks have not ended."""

    step: RecipeStep
    machine: Machine
    tasks: list[StepTask] = field(default_factory=list)
    unfinished_count: int = 0


class Schedule:
    """The tasks of a site in the order in which they can run.

    stages  by step, then by machine
    run_count  how many tasks were run; pending: those that had to be run, and why
    """

    def __init__(self, options: RunOptions, machines: Sequence[Machine], manifest: Manifest):
        self.options, self.manifest = options, manifest
        self.stages = [Stage(step, machine) for step in options.steps for machine in machines]
        self.run_count, self.pending = 0, list[str]()
        self._task_count = sum(1 if s.step.joint else sum(r.kind == s.step.kind for r in s.machine.recordings)
                               for s in self.stages)
        self._ended_count = 0
        self._waiting: dict[str, list[Stage]] = {}
        for stage in self.stages:
            self._waiting.setdefault(stage.machine.name, []).append(stage)
        self._ready = deque(self._waiting)  # machines with stages that may start
        self._outputs: dict[tuple[str, str, str], ManifestLine] = {}
        self._closed: set[tuple[str, str]] = set()
        self._handed_out: list[tuple[StepTask, Stage]] = []  # by number
        self._running: dict[str, list[tuple[StepTask, Stage]]] = {}  # content -> tasks of equal content that wait
        self._retries: list[tuple[StepTask, Stage]] = []
        self._done_lines = {line["content"]: line for line in manifest.steps.values() if line["sha256"] is not None}
        self._task_builder = TaskBuilder(os.path.relpath(options.out, options.folder).replace(os.sep, "/"),
                            {step.name: step for step in options.steps}, options.numerics, self._outputs)

    def next_tasks(self) -> NumberedTasks:
        """The tasks that can run now and were not handed out yet, with numbers for `take_answer`."""
        handed_out = [self._hand_out(task, stage) for task, stage in self._retries]
        self._retries.clear()
        while self._ready:
            waiting = self._waiting[self._ready.popleft()]
            for stage in [stage for stage in waiting if self._can_begin(stage)]:
                waiting.remove(stage)
                handed_out += self._start_stage(stage)
        return handed_out

    def _can_begin(self, stage: Stage) -> bool:
        return all((name, stage.machine.name) in self._closed for name in stage.step.params)

    def check_only(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Check every task and run none."""
        self.next_tasks()
        return iter(())

    def manifest_line(self, task: StepTask) -> ManifestLine | None:
        """The manifest line of a task; None for one that cannot be run."""
        return None if task.problem else self.manifest.steps.get(task.output)

    def take_answer(self, number: int, answer: Mapping[str, Any]) -> None:
        """Store the result of a task, also for those of equal content."""
        task, stage = self._handed_out[number]
        text = answer.get("text")
        ended = answer.get("ended") or (None if text is not None or self._recordings_unchanged(task) else UNREAD)
        store_result(task, {
            "code": answer.get("code"), "problem": None if text is not None else answer["said"], "ended": ended,
            "limit": self.options.limits.get(ended or "", 0.0), "told": answer.get("told"),
            "seconds": answer.get("seconds"), "peak_memory_mb": answer.get("peak_memory_mb")},
                     text, self.options.out, self.manifest)
        line = self.manifest.steps[task.output]
        if text is not None:
            self._done_lines[task.content] = line
        self._end_task(stage)
        if text is None or not sys.stderr.isatty():  # a terminal shows the progress bar
            self.options.say(f"{self._ended_count} of {self._task_count}: {task.label}"
                             + (f": {answer['said']}" if text is None else ""))
        for other, its_stage in self._running.pop(task.content, ()):
            if reuse_result(other, line, self.options.out, self.manifest):
                self._end_task(its_stage)
            else:
                self._retries.append((other, its_stage))

    def _recordings_unchanged(self, task: StepTask) -> bool:
        """Whether the content of its recordings is unchanged since the start of the run."""
        return task.inputs["recordings"] == [recording_sha256(name, self.options.folder)
                                             for name in task.inputs["names"]]

    def _start_stage(self, stage: Stage) -> list[tuple[int, dict[str, Any]]]:
        """Make the tasks of a stage; returns those to be run."""
        handed_out = []
        stage.tasks = self._task_builder.tasks(stage.step, stage.machine)
        stage.unfinished_count = len(stage.tasks) + 1
        for task in stage.tasks:
            if not self._is_to_run(task):
                self._end_task(stage)
            elif task.content in self._running:
                self._running[task.content].append((task, stage))
            else:
                handed_out.append(self._hand_out(task, stage))
        stage.unfinished_count -= 1
        self._close_stage(stage)
        return handed_out

    def _is_to_run(self, task: StepTask) -> bool:
        if task.problem:
            return False
        options = self.options
        reasons_to_run = rerun_reasons(task, self.manifest_line(task), options.out, options.limits, options.retry)
        if not reasons_to_run:
            return False
        self.pending.append(f"{task.label}: {'; '.join(reasons_to_run)}")
        if options.explain:
            options.explain(self.pending[-1])
        return options.executor is not None and not reuse_result(
            task, self._done_lines.get(task.content), options.out, self.manifest)

    def _hand_out(self, task: StepTask, stage: Stage) -> tuple[int, dict[str, Any]]:
        self.run_count += 1
        self._running.setdefault(task.content, [])
        self._handed_out.append((task, stage))
        return len(self._handed_out) - 1, {"folder": str(self.options.folder),
                                           "words": [task.words[0], "--quiet", "--out", "-", *task.words[1:]]}

    def _end_task(self, stage: Stage) -> None:
        self._ended_count += 1
        stage.unfinished_count -= 1
        if self.options.executor is not None:
            report_progress("recordings and steps", self._ended_count, self._task_count)
        self._close_stage(stage)

    def _close_stage(self, stage: Stage) -> None:
        """Make the files of a stage available once all its tasks have ended."""
        if stage.unfinished_count:
            return
        for task in stage.tasks:
            line = self.manifest_line(task)
            if line is not None and line["sha256"] is not None:
                self._outputs[stage.step.name, stage.machine.name, task.path] = line
        self._closed.add((stage.step.name, stage.machine.name))
        self._ready.append(stage.machine.name)
