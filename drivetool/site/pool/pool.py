"""Processes that run tasks, one at a time each; one that dies or exceeds its limits is replaced."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import drivetool
from drivetool.errors import BadOption, DriveToolError
from drivetool.site.pool import worker as at_work
from drivetool.site.pool.executor import NextTasks, Runner

# s between two checks of the time and memory of the workers. A choice: small against any limit, and cheap.
POLL_INTERVAL = 0.1
# One thread each: the matrices are small, and sums shared by threads are not repeatable.
SINGLE_THREAD_ENV = {name: "1" for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS",
                                                "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")}
PROC_STATM = Path("/proc/self/statm")
Answer = dict[str, Any]


@dataclass(frozen=True)
class Limits:
    """What a worker may take for one task: seconds, and resident memory in MB."""

    seconds: float
    memory_mb: float


class Worker:
    """A process that runs tasks; its answers and its end go into the inbox.

    runner  runs the steps there
    """

    def __init__(self, inbox: queue.Queue[tuple[Worker, Answer | None]], runner: Runner):
        source = str(Path(drivetool.__file__).resolve().parents[1])
        path = os.pathsep.join(filter(None, [source, os.environ.get("PYTHONPATH")]))
        # -P: no folder of recordings can be imported as a module.
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", at_work.__name__, at_work.runner_name(runner)], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, env=os.environ | SINGLE_THREAD_ENV | {"PYTHONPATH": path})
        self.index: int | None = None
        self.began = 0.0
        self.ready = False
        self.listener = threading.Thread(target=self._listen, args=(inbox,), daemon=True)
        self.listener.start()

    def _listen(self, inbox: queue.Queue[tuple[Worker, Answer | None]]) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as answers:
            for line in answers:
                if line.endswith(b"\n"):  # a line cut off by the end of the process is no answer
                    inbox.put((self, json.loads(line)))
        self.process.wait()
        inbox.put((self, None))

    def give(self, index: int, task: dict[str, Any]) -> None:
        """Send a task; the inbox reports if the worker has died meanwhile."""
        self.index, self.began = index, time.monotonic()
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.write((json.dumps(task) + "\n").encode())
            self.process.stdin.flush()

    def memory_mb(self) -> float:
        """Resident memory; 0 where the system does not report it."""
        try:
            pages = int(PROC_STATM.parent.with_name(str(self.process.pid)).joinpath("statm").read_text().split()[1])
        except (OSError, IndexError):
            return 0.0
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    def kill(self) -> None:
        """End the process in any state."""
        self.process.kill()
        self.process.wait()
        self.listener.join()
        assert self.process.stdin is not None
        with suppress(OSError):  # unsent data has no receiver
            self.process.stdin.close()


class Pool:
    """A number of workers, started when there are tasks."""

    def __init__(self, count: int, limits: Limits, runner: Runner):
        self.count, self.limits, self.runner = count, limits, runner
        self.inbox: queue.Queue[tuple[Worker, Answer | None]] = queue.Queue()
        self.workers: list[Worker] = []

    def serve(self, next_tasks: NextTasks) -> Iterator[tuple[int, Answer]]:
        """Run all tasks; (number, answer) of each as it ends; see `Executor`.

        raises  DriveToolError: workers cannot be started
        """
        waiting = deque(next_tasks())
        remaining = len(waiting)
        while remaining:
            while len(self.workers) < min(self.count, remaining):
                self.workers.append(Worker(self.inbox, self.runner))
            for worker in self.workers:
                if worker.index is None and waiting:
                    worker.give(*waiting.popleft())
            for each in [*self._end_over_limits(), *self._next_answers()]:
                yield each
                new = next_tasks()
                waiting.extend(new)
                remaining += len(new) - 1

    def _next_answers(self) -> list[tuple[int, Answer]]:
        """The answer in the next message; empty if none comes within the poll interval."""
        try:
            worker, answer = self.inbox.get(timeout=POLL_INTERVAL)
        except queue.Empty:
            return []
        if worker not in self.workers:  # ended by us
            return []
        if answer is not None and not worker.ready:
            worker.ready, worker.began = True, time.monotonic()  # the start-up time is not part of the task
            return []
        index, worker.index = worker.index, None
        if answer is None:
            self.workers.remove(worker)
            worker.kill()
            code = worker.process.returncode
            if not worker.ready and code > 0:  # at its start, and so would the next
                raise DriveToolError("a worker process of drivetool", f"one that stopped immediately (code {code})",
                                     f"Check the installation: python -m {at_work.__name__} must run.")
            return [] if index is None else [(index, died_answer(code))]
        return [] if index is None else [(index, answer)]

    def _end_over_limits(self) -> list[tuple[int, Answer]]:
        """End the workers that exceed a limit; the answers of their tasks."""
        answers = []
        for worker in [w for w in self.workers if w.index is not None]:
            answer: Answer | None = None
            if time.monotonic() - worker.began > self.limits.seconds:
                answer = {"ended": "time", "said": f"wanted an end within {self.limits.seconds:g} s "
                          "(--time-limit); found the step still running. Allow more, or make the recording "
                          "shorter."}
            elif worker.memory_mb() > self.limits.memory_mb:
                answer = {"ended": "memory", "said": f"wanted at most {self.limits.memory_mb:g} MB of memory "
                          "(--memory-limit); found more in use. Allow more, or make the recording shorter."}
            if answer is not None and worker.index is not None:
                worker.kill()
                self.workers.remove(worker)
                answers.append((worker.index, {**answer, "seconds": round(time.monotonic() - worker.began, 3)}))
        return answers

    def close(self) -> None:
        """End all workers."""
        for worker in self.workers:
            worker.kill()
        self.workers.clear()


def died_answer(code: int | None) -> Answer:
    """The answer of a task whose worker ended first."""
    cause = f"code {code}"
    if code is not None and code < 0:
        cause = f"signal {-code}" + (f", {signal.Signals(-code).name}" if -code in set(signal.Signals) else "")
    return {"ended": "died", "said": "wanted the step to end; found that its worker process ended first "
            f"({cause}). Run the step by hand to see why; --retry tries it again."}


def check_memory_limit(requested: bool) -> None:
    """Raise BadOption where a limit is requested and the system does not report the memory of a process."""
    if requested and not PROC_STATM.exists():
        raise BadOption("a system that reports the memory of a process for --memory-limit", f"{sys.platform}",
                        "Leave it out; --time-limit works everywhere.")
