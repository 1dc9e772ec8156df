"""The run of a site: look into the recordings, do what is not done, write down what came of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivetool.errors import DriveToolError
from drivetool.progress import tell
from drivetool.site.plan import Agenda, Machine, Recording, Setting, Task, again, machines_of, shared
from drivetool.site.pool import once
from drivetool.site.results import Entry, Manifest, Told


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
    machines, lost = machines_of(found, manifest.looks, any(step.joint for step in setting.steps))
    _say_order(setting, machines)
    agenda = Agenda(setting, machines, manifest)
    for number, answer in setting.executor.serve(agenda.more) if setting.executor else agenda.checked():
        agenda.take(number, answer)
    results: dict[tuple[str, str, str], Entry] = {}
    for step in setting.steps:
        tasks = [task for stage in agenda.stages if stage.step is step for task in stage.tasks]
        _say_shared(setting, shared(tasks))
        for task in tasks:
            line = agenda.line(task)
            results[step.name, task.machine, task.path] = _entry(task, line)
            if line is not None and line["sha256"] is not None:
                outcome.outputs[task.machine, task.path, step.name] = task.output
    outcome.undone += agenda.undone
    outcome.begun = agenda.begun
    outcome.entries = _ordered(setting, machines, lost, results)
    return outcome


def _look(setting: Setting, found: Sequence[Recording], manifest: Manifest, outcome: Outcome) -> None:
    """When each recording began, and what is noted in it; each content once."""
    new = {r.look: r for r in found if not _is_seen(manifest.looks.get(r.look), setting)}
    if setting.executor is None:
        outcome.undone += [f"{r.path}: it has not been looked into" for r in found if r.look in new]
        return
    asked = list(new.values())
    tasks = [{"folder": str(setting.folder), "look": r.path, "map": r.section.map} for r in asked]
    for count, (index, answer) in enumerate(setting.executor.serve(once(tasks)), 1):
        sha, map_sha = asked[index].look
        ended = answer.get("ended")
        if ended or "start" in answer:  # else it could not be opened, which may pass
            manifest.append({"look": sha, "map": map_sha, "drivetool": setting.numerics["drivetool"],
                             "start": answer.get("start"), "metadata": answer.get("metadata", {}),
                             "ended": ended, "limit": setting.limits.get(ended or "", 0.0)})
        tell("look into the recordings", count, len(asked))


def _is_seen(line: Mapping[str, Any] | None, setting: Setting) -> bool:
    """Whether a look holds: by this version, and not ended by a limit that is higher now."""
    return (line is not None and line["drivetool"] == setting.numerics["drivetool"]
            and not (line["ended"] and again(line, setting.limits, setting.retry)))


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
