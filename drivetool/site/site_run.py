"""The run of a site: read the headers of the recordings, run what is not done, store the results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from drivetool.errors import DriveToolError
from drivetool.files.yaml import first_of
from drivetool.progress import report_progress
from drivetool.site.plan import (
    Machine,
    Recording,
    RunOptions,
    Schedule,
    StepTask,
    duplicates,
    machines_of,
    retry_reasons,
)
from drivetool.site.pool import all_at_once
from drivetool.site.results import Entry, Manifest, StepResult


@dataclass(frozen=True)
class SiteOutcome:
    """The results of a run.

    entries    of the summary, in its order
    run_count  how many tasks were run; pending: those that still have to be run, and why
    """

    entries: list[Entry]
    run_count: int
    pending: list[str]


def run_site(options: RunOptions, recordings: Sequence[Recording], manifest: Manifest) -> SiteOutcome:
    """Run the recipe on the recordings.

    found    recordings whose content is known
    returns  Outcome
    raises   CannotWrite: the disk is full; results stored by then are kept
    """
    unread = _read_headers(options, recordings, manifest)
    machines, without_machine = machines_of(recordings, manifest.headers, any(step.joint for step in options.steps))
    _say_order(options, machines)
    schedule = Schedule(options, machines, manifest)
    for number, answer in options.executor.serve(
            schedule.next_tasks) if options.executor else schedule.check_only():
        schedule.take_answer(number, answer)
    results: dict[tuple[str, str, str], Entry] = {}
    for step in options.steps:
        tasks = [task for stage in schedule.stages if stage.step is step for task in stage.tasks]
        _say_duplicates(options, duplicates(tasks))
        for task in tasks:
            results[step.name, task.machine, task.path] = _summary_entry(task, schedule.manifest_line(task))
    return SiteOutcome(_entries_in_order(options, machines, without_machine, results), schedule.run_count,
                       [*unread, *schedule.pending])


def _read_headers(options: RunOptions, recordings: Sequence[Recording], manifest: Manifest) -> list[str]:
    """Read the start time and metadata of each recording; files of equal content once.

    returns  what has to be read where nothing may be run
    """
    new = {r.header_key: r for r in recordings
           if not _header_is_current(manifest.headers.get(r.header_key), options)}
    if options.executor is None:
        return [f"{r.path}: it has not been looked into" for r in recordings if r.header_key in new]
    unread = list(new.values())
    tasks = [{"folder": str(options.folder), "look": r.path, "map": r.section.map} for r in unread]
    for count, (index, answer) in enumerate(options.executor.serve(all_at_once(tasks)), 1):
        sha, map_sha = unread[index].header_key
        ended = answer.get("ended")
        if ended or "start" in answer:  # else it could not be opened, which may be temporary
            manifest.append({"look": sha, "map": map_sha, "drivetool": options.numerics["drivetool"],
                             "start": answer.get("start"), "metadata": answer.get("metadata", {}),
                             "ended": ended, "limit": options.limits.get(ended or "", 0.0)})
        report_progress("look into the recordings", count, len(unread))
    return []


def _header_is_current(line: Mapping[str, Any] | None, options: RunOptions) -> bool:
    """Whether a header was read by this version, and not ended by a limit that is higher now."""
    return (line is not None and line["drivetool"] == options.numerics["drivetool"]
            and not (line["ended"] and retry_reasons(line, options.limits, options.retry)))


def _say_order(options: RunOptions, machines: Sequence[Machine]) -> None:
    named = [machine.name for machine in machines if machine.by_name and len(machine.recordings) > 1]
    if named:
        options.say(f"recordings without absolute time are ordered by name: machine {first_of(named, 3)}")


def _say_duplicates(options: RunOptions, pairs: Sequence[tuple[StepTask, StepTask]]) -> None:
    if pairs:
        named = [f"{task.path or task.machine} is {owner.path or owner.machine}" for task, owner in pairs]
        options.say(f"{pairs[0][0].step.name}: {len(pairs)} of equal content are fitted once and listed under both "
                    f"({first_of(named, 3)})")


def _summary_entry(task: StepTask, line: Mapping[str, Any] | None) -> Entry:
    """The entry of a task in the summary."""
    recording = task.recording
    result = line["told"] if line else None
    problem = task.problem or (line["problem"] if line else None) or (None if line else "it has not been run")
    return Entry(
        task.path, task.machine, task.step.kind, recording.start if recording else None,
        recording.order if recording else 0, task.step.name, None if result is None else StepResult(**result),
        problem, line["seconds"] if line else None, line["peak_memory_mb"] if line else None,
        task.output if line and line["sha256"] is not None else None)


def _entries_in_order(options: RunOptions, machines: Sequence[Machine], without_machine: Sequence[Recording],
             results: Mapping[tuple[str, str, str], Entry]) -> list[Entry]:
    """Sorted by machine, place in its order and step; recordings without a machine come first."""
    entries = [Entry(r.path, "", r.kind, r.start, 0, step.name, None, r.problem)
               for r in without_machine for step in options.steps if step.kind == r.kind]
    for machine in machines:
        for path in ("", *(r.path for r in machine.recordings)):
            keys = [(step.name, machine.name, path) for step in options.steps]
            entries += [results[key] for key in keys if key in results]
    if not entries:
        raise DriveToolError("something to do", "no recording of a kind that a step of the recipe reads",
                             "Correct kind at recordings or in the recipe of the site file.")
    return entries
