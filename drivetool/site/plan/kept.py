"""What comes of a task is kept: first its file, then the line of the manifest that vouches for it."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from drivetool.files.disk import encoded, write_whole
from drivetool.files.yaml import from_yaml, to_yaml
from drivetool.site.plan.tasks import Line, Task
from drivetool.site.pool import UNREAD
from drivetool.site.results import Manifest, told


def keep(task: Task, line: Line, text: str | None, out: Path, manifest: Manifest) -> None:
    """Write the file of a task, or take away an earlier one where there is none now; then the line.

    line    what is to be known of it besides its inputs
    text    of the file; None: there is a problem instead
    raises  CannotWrite: the disk is full
    """
    sha = None
    if text is None:
        with suppress(FileNotFoundError):  # of other inputs
            os.unlink(out / task.output)
    else:
        data = encoded(text)
        sha = hashlib.sha256(data).hexdigest()
        write_whole(out / task.output, data)
    manifest.append({"output": task.output, "key": task.key, "content": task.content, "inputs": task.inputs,
                     "sha256": sha, **line})


def take_over(task: Task, line: Line | None, out: Path, manifest: Manifest) -> bool:
    """Keep for a task what came of one with the same content, under the names of its own files.

    line     of the other one; None: there is none
    returns  whether that is possible: the file of the other one is there and unchanged, or a limit ended it;
             another problem may come of its name or place
    """
    if line is None or (line["sha256"] is None and line["ended"] in (None, UNREAD)):
        return False
    same = {name: line[name] for name in ("code", "ended", "limit", "peak_memory_mb")} | {"seconds": 0.0}
    if line["sha256"] is None:
        keep(task, {**same, "problem": line["problem"], "told": None}, None, out, manifest)
        return True
    try:
        data = (out / line["output"]).read_bytes()
    except OSError:
        return False
    if hashlib.sha256(data).hexdigest() != line["sha256"]:
        return False
    text = data.decode()
    content = from_yaml(text, task.output)
    if to_yaml(content) != text:  # it could not be written as the step would
        return False
    text = to_yaml(renamed(content, _names(line["inputs"], task.inputs)))
    keep(task, {**same, "problem": None, "told": asdict(told(text))}, text, out, manifest)
    return True


def _names(before: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, str]:
    """What the one calls its recordings and parameter files -> what the other does."""
    names = dict(zip(before["names"], now["names"], strict=True))
    return names | {old: new for (_, old), (_, new) in zip(before["params"], now["params"], strict=True)}


def renamed(value: Any, names: Mapping[str, str]) -> Any:
    """A value with names replaced in all its texts, keys included; whole names only."""
    if isinstance(value, dict):
        return {renamed(key, names): renamed(item, names) for key, item in value.items()}
    if isinstance(value, list):
        return [renamed(item, names) for item in value]
    if not isinstance(value, str) or not names:
        return value
    any_of = "|".join(re.escape(name) for name in sorted(names, key=len, reverse=True))
    return re.sub(rf"(?<![\w./-])(?:{any_of})(?![\w/-])", lambda found: names[found[0]], value)
