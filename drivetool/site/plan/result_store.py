"""The store of results: first the file of a task, then the manifest line with its checksum."""

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
from drivetool.site.plan.tasks import ManifestLine, StepTask
from drivetool.site.pool import UNREAD
from drivetool.site.results import Manifest, step_result_of


def store_result(task: StepTask, line: ManifestLine, text: str | None, out: Path, manifest: Manifest) -> None:
    """Write the file of a task, or remove an earlier one if there is none now; then the line.

    line    fields of the manifest line besides the inputs
    text    of the file; None: there is a problem instead
    raises  CannotWrite: the disk is full
    """
    sha = None
    if text is None:
        with suppress(FileNotFoundError):  # of earlier inputs
            os.unlink(out / task.output)
    else:
        data = encoded(text)
        sha = hashlib.sha256(data).hexdigest()
        write_whole(out / task.output, data)
    manifest.append({"output": task.output, "key": task.key, "content": task.content, "inputs": task.inputs,
                     "sha256": sha, **line})


def reuse_result(task: StepTask, line: ManifestLine | None, out: Path, manifest: Manifest) -> bool:
    """Reuse the result of a task of equal content, with the names of its own files.

    line     of the other task; None: there is none
    returns  whether that is possible: the file of the other task exists unchanged, or a limit ended it. Another
             problem may depend on its name or folder
    """
    if line is None or (line["sha256"] is None and line["ended"] in (None, UNREAD)):
        return False
    taken_over = {name: line[name] for name in ("code", "ended", "limit", "peak_memory_mb")} | {"seconds": 0.0}
    if line["sha256"] is None:
        store_result(task, {**taken_over, "problem": line["problem"], "told": None}, None, out, manifest)
        return True
    try:
        data = (out / line["output"]).read_bytes()
    except OSError:
        return False
    if hashlib.sha256(data).hexdigest() != line["sha256"]:
        return False
    text = data.decode()
    content = from_yaml(text, task.output)
    if to_yaml(content) != text:  # it does not survive a round trip
        return False
    text = to_yaml(replace_names(content, _new_names(line["inputs"], task.inputs)))
    store_result(task, {**taken_over, "problem": None, "told": asdict(step_result_of(text))}, text, out, manifest)
    return True


def _new_names(before: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, str]:
    """Names of recordings and parameter files in one task -> in the other."""
    names = dict(zip(before["names"], now["names"], strict=True))
    return names | {old: new for (_, old), (_, new) in zip(before["params"], now["params"], strict=True)}


def replace_names(value: Any, names: Mapping[str, str]) -> Any:
    """A value with whole names replaced in all its strings, keys included."""
    if isinstance(value, dict):
        return {replace_names(key, names): replace_names(item, names) for key, item in value.items()}
    if isinstance(value, list):
        return [replace_names(item, names) for item in value]
    if not isinstance(value, str) or not names:
        return value
    any_of = "|".join(re.escape(name) for name in sorted(names, key=len, reverse=True))
    return re.sub(rf"(?<![\w./-])(?:{any_of})(?![\w/-])", lambda found: names[found[0]], value)
