"""A worker of the pool: a fresh interpreter that takes tasks from standard input, one JSON line each.

Steps run by calling the command line in this process, so that a file has the same bytes as the step typed by hand.
The one argument names that function, see `runner_name`. The worker ends with its parent, or by a signal.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import sys
import threading
import time
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import asdict
from importlib import import_module
from importlib.metadata import version
from io import BytesIO, StringIO, TextIOWrapper
from typing import IO, Any

import drivetool
from drivetool.files.yaml import load_channel_map
from drivetool.logs.formats import RecordingHeader, read_header
from drivetool.site.pool.executor import UNREAD, Runner
from drivetool.site.results import step_result_of

PROC_STATUS, PROC_CLEAR_REFS = "/proc/self/status", "/proc/self/clear_refs"
CLEAR_PEAK_CODE = "5"  # proc(5): the value that resets the peak resident size


def runner_name(runner: Runner) -> str:
    """The name by which a worker process imports it."""
    return f"{runner.__module__}:{runner.__qualname__}"


def main(runner: str = "") -> None:
    """Run tasks until there are no more; runner: name of the function that runs the steps."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all of a terminal; the parent ends its workers
    inbound, outbound = os.fdopen(os.dup(0), encoding="utf-8"), os.fdopen(os.dup(1), "w", encoding="utf-8")
    null_device = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):  # output of libraries must not mix with the answers
        os.dup2(null_device, descriptor)
    _write_answer(outbound, {"ready": True})
    tasks: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_read_tasks, args=(inbound, tasks), daemon=True).start()
    while True:
        _write_answer(outbound, run_task(json.loads(tasks.get()), runner))


def _read_tasks(inbound: IO[str], tasks: queue.Queue[str]) -> None:
    """Queue lines as they come; end the process when the parent has gone."""
    for line in inbound:
        tasks.put(line)
    os._exit(0)


def _write_answer(outbound: IO[str], content: dict[str, Any]) -> None:
    outbound.write(json.dumps(content) + "\n")
    outbound.flush()


def library_versions() -> dict[str, str]:
    """The library versions on which the numbers of a result depend."""
    return {"drivetool": drivetool.__version__, **{name: version(name) for name in ("numpy", "scipy", "llvmlite")}}


def run_task(task: dict[str, Any], runner: str) -> dict[str, Any]:
    """The answer of a task: of a step exit code, file, its content and message; or a header; and the cost.

    runner  name of the function that runs the steps
    """
    try:
        os.chdir(task["folder"])
    except OSError as error:
        return {"code": 1, "ended": UNREAD,
                "said": f"wanted the folder {task['folder']} where the step runs; found {error.strerror}. All "
                        "machines of a cluster must see the recordings under the same path."}
    _reset_peak_memory()
    began = time.perf_counter()
    answer = _run_step(task["words"], runner) if "words" in task else _read_header(task["look"], task["map"])
    return {**answer, "seconds": round(time.perf_counter() - began, 3), "peak_memory_mb": _peak_memory_mb()}


def _run_step(words: list[str], runner: str) -> dict[str, Any]:
    """Run a command as on the console; its file is its standard output."""
    module, _, name = runner.partition(":")
    run: Runner = getattr(import_module(module), name)
    out, err = TextIOWrapper(BytesIO(), encoding="utf-8"), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            run(words)
            code = 0
        except SystemExit as left:
            code = left.code if isinstance(left.code, int) else int(left.code is not None)
    out.flush()
    text = out.buffer.getvalue().decode()
    if code not in (0, 3) or not text:
        return {"code": code, "said": _last_error_sentence(err.getvalue(), words[0])}
    return {"code": code, "text": text, "told": asdict(step_result_of(text))}


def _last_error_sentence(stderr_text: str, command: str) -> str:
    """The last sentence of a command that failed, without the prefix of all messages."""
    lines = [line.strip() for line in stderr_text.splitlines() if line.strip()]
    own_lines = [line for line in lines if line.startswith(f"drivetool {command}: ")]
    text = (own_lines or lines or ["the command failed and said nothing"])[-1]
    return text.removeprefix(f"drivetool {command}: ").removeprefix("error: ").removeprefix("Error: ")


def _read_header(path: str, channel_map: str | None) -> dict[str, Any]:
    try:
        with open(path, "rb"):
            return asdict(read_header(path, load_channel_map(channel_map)))
    except OSError:  # temporarily missing: no header
        return {}
    except Exception:  # the steps report what is wrong with the recording or its map
        return asdict(RecordingHeader())


def _reset_peak_memory() -> None:
    """Reset the peak resident size, where the system can."""
    with suppress(OSError), open(PROC_CLEAR_REFS, "w") as file:
        file.write(CLEAR_PEAK_CODE)


def _peak_memory_mb() -> float | None:
    """Largest resident size since the task began [MB]; None where the system does not report it per task."""
    try:
        with open(PROC_STATUS) as file:
            lines = [line.split() for line in file if line.startswith("VmHWM:")]
    except OSError:
        return None
    return round(int(lines[0][1]) * 1024 / 1e6, 1) if lines else None


if __name__ == "__main__":
    main(*sys.argv[1:])
