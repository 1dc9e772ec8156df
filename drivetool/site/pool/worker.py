"""A worker of the pool: a fresh interpreter that takes tasks from standard input, one JSON line each.

Steps run by calling the command line in this process, so that a file has the bytes of the step by hand. Its one
argument names the function that does this, see `name_of`. The worker ends with its parent, and whenever it is told
to by a signal.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import sys
import threading
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict
from importlib import import_module
from importlib.metadata import version
from io import BytesIO, StringIO, TextIOWrapper
from typing import IO, Any

import drivetool
from drivetool.files.yaml import load_channel_map
from drivetool.logs.formats import Look, look_at
from drivetool.site.pool.executor import UNREAD, Runner
from drivetool.site.results import told

STATUS, RESET = "/proc/self/status", "/proc/self/clear_refs"
RESET_PEAK = "5"  # what Linux takes there for: begin again with the largest resident size


def name_of(runner: Runner) -> str:
    """What a worker process finds it by."""
    return f"{runner.__module__}:{runner.__qualname__}"


def main(runner: str = "") -> None:
    """Do tasks until there are no more; runner: name of the one who does the steps."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all of a terminal; the parent ends its workers
    inbound, outbound = os.fdopen(os.dup(0), encoding="utf-8"), os.fdopen(os.dup(1), "w", encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for taken in (0, 1, 2):  # nothing that a library prints gets among the answers
        os.dup2(nowhere, taken)
    _answer(outbound, {"ready": True})
    tasks: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_receive, args=(inbound, tasks), daemon=True).start()
    while True:
        _answer(outbound, done(json.loads(tasks.get()), runner))


def _receive(inbound: IO[str], tasks: queue.Queue[str]) -> None:
    """Lines as they come; when the parent has gone there is nobody to work for."""
    for line in inbound:
        tasks.put(line)
    os._exit(0)


def _answer(outbound: IO[str], content: dict[str, Any]) -> None:
    outbound.write(json.dumps(content) + "\n")
    outbound.flush()


def numerics() -> dict[str, str]:
    """The versions that the numbers of a result depend on."""
    return {"drivetool": drivetool.__version__, **{name: version(name) for name in ("numpy", "scipy", "numba")}}


def done(task: dict[str, Any], runner: str) -> dict[str, Any]:
    """What came of a task: of a step exit code, file, what it tells and says; of a look what was seen; the cost.

    runner  name of the one who does the steps
    """
    try:
        os.chdir(task["folder"])
    except OSError as error:
        return {"code": 1, "ended": UNREAD,
                "said": f"wanted the folder {task['folder']} where the step runs; found {error.strerror}. All "
                        "machines of a cluster must see the recordings under the same path."}
    _forget_peak()
    began = time.perf_counter()
    answer = _step(task["words"], runner) if "words" in task else _look(task["look"], task["map"])
    return {**answer, "seconds": round(time.perf_counter() - began, 3), "peak_memory_mb": _peak_mb()}


def _step(words: list[str], runner: str) -> dict[str, Any]:
    """A command as it would run by itself; its file is what it prints."""
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
        return {"code": code, "said": _sentence(err.getvalue(), words[0])}
    return {"code": code, "text": text, "told": asdict(told(text))}


def _sentence(said: str, command: str) -> str:
    """The last sentence of a command that failed, without what stands before every one."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    own = [line for line in lines if line.startswith(f"drivetool {command}: ")]
    text = (own or lines or ["the command failed and said nothing"])[-1]
    return text.removeprefix(f"drivetool {command}: ").removeprefix("error: ").removeprefix("Error: ")


def _look(path: str, channel_map: str | None) -> dict[str, Any]:
    try:
        with open(path, "rb"):
            return asdict(look_at(path, load_channel_map(channel_map)))
    except OSError:  # gone for now: nothing was seen
        return {}
    except Exception:  # whatever is wrong with the recording or its map: the steps will say so
        return asdict(Look())


def _forget_peak() -> None:
    """Let the largest resident size begin again, where the system can."""
    try:
        with open(RESET, "w") as file:
            file.write(RESET_PEAK)
    except OSError:
        pass


def _peak_mb() -> float | None:
    """Largest resident size since the task began [MB]; None where the system does not tell it by task."""
    try:
        with open(STATUS) as file:
            lines = [line.split() for line in file if line.startswith("VmHWM:")]
    except OSError:
        return None
    return round(int(lines[0][1]) * 1024 / 1e6, 1) if lines else None


if __name__ == "__main__":
    main(*sys.argv[1:])
