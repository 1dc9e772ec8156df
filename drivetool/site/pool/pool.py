"""Processes that do tasks, one at a time each; one that dies or goes beyond its limits is replaced."""

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
from drivetool.site.pool.executor import More, Runner

POLL = 0.1  # s between two looks at the clock and the memory of the workers
# One thread each: the matrices are small, and sums that threads share are not repeatable.
ONE_THREAD = {name: "1" for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS",
                                     "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")}
PROC = Path("/proc/self/statm")
Answer = dict[str, Any]


@dataclass(frozen=True)
class Limits:
    """What a worker may take for one task: seconds, and resident memory in MB."""

    seconds: float
    memory_mb: float


class Worker:
    """A process that does tasks; what it answers, and that it ended, goes into the inbox.

    runner  does the steps there
    """

    def __init__(self, inbox: queue.Queue[tuple[Worker, Answer | None]], runner: Runner):
        source = str(Path(drivetool.__file__).resolve().parents[1])
        path = os.pathsep.join(filter(None, [source, os.environ.get("PYTHONPATH")]))
        # -P: no folder of recordings can stand in for a module.
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", at_work.__name__, at_work.name_of(runner)], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, env=os.environ | ONE_THREAD | {"PYTHONPATH": path})
        self.index: int | None = None
        self.began = 0.0
        self.ready = False
        self.listener = threading.Thread(target=self._listen, args=(inbox,), daemon=True)
        self.listener.start()

    def _listen(self, inbox: queue.Queue[tuple[Worker, Answer | None]]) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as answers:
            for line in answers:
                if line.endswith(b"\n"):  # a line that a death cut off is no answer
                    inbox.put((self, json.loads(line)))
        self.process.wait()
        inbox.put((self, None))

    def give(self, index: int, task: dict[str, Any]) -> None:
        """Hand over a task; that the worker has died meanwhile is told by its inbox."""
        self.index, self.began = index, time.monotonic()
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.write((json.dumps(task) + "\n").encode())
            self.process.stdin.flush()

    def memory_mb(self) -> float:
        """Resident memory; 0 where the system does not tell."""
        try:
            pages = int(PROC.parent.with_name(str(self.process.pid)).joinpath("statm").read_text().split()[1])
        except (OSError, IndexError):
            return 0.0
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    def kill(self) -> None:
        """End it, whatever it does."""
        self.process.kill()
        self.process.wait()
        self.listener.join()
        assert self.process.stdin is not None
        with suppress(OSError):  # what was not yet handed over has nobody to go to
            self.process.stdin.close()


class Pool:
    """So many workers, started when there is something to do."""

    def __init__(self, count: int, limits: Limits, runner: Runner):
        self.count, self.limits, self.runner = count, limits, runner
        self.inbox: queue.Queue[tuple[Worker, Answer | None]] = queue.Queue()
        self.workers: list[Worker] = []

    def serve(self, more: More) -> Iterator[tuple[int, Answer]]:
        """Do tasks until there are no more; (number, what came of it) of each as it ends; see `Executor`.

        raises  DriveToolError: workers cannot be started
        """
        waiting = deque(more())
        left = len(waiting)
        while left:
            while len(self.workers) < min(self.count, left):
                self.workers.append(Worker(self.inbox, self.runner))
            for worker in self.workers:
                if worker.index is None and waiting:
                    worker.give(*waiting.popleft())
            for each in [*self._beyond(), *self._heard()]:
                yield each
                new = more()
                waiting.extend(new)
                left += len(new) - 1

    def _heard(self) -> list[tuple[int, Answer]]:
        """What the next message says; nothing where none comes soon."""
        try:
            worker, answer = self.inbox.get(timeout=POLL)
        except queue.Empty:
            return []
        if worker not in self.workers:  # ended by us
            return []
        if answer is not None and not worker.ready:
            worker.ready, worker.began = True, time.monotonic()  # its start is none of the task's time
            return []
        index, worker.index = worker.index, None
        if answer is None:
            self.workers.remove(worker)
            worker.kill()
            code = worker.process.returncode
            if not worker.ready and code > 0:  # by itself, and so would the next
                raise DriveToolError("a worker process of drivetool", f"one that ended at its start (code {code})",
                                     f"Check the installation: python -m {at_work.__name__} must run.")
            return [] if index is None else [(index, died(code))]
        return [] if index is None else [(index, answer)]

    def _beyond(self) -> list[tuple[int, Answer]]:
        """The tasks whose workers had to be ended."""
        found = []
        for worker in [w for w in self.workers if w.index is not None]:
            answer: Answer | None = None
            if time.monotonic() - worker.began > self.limits.seconds:
                answer = {"ended": "time", "said": f"wanted an end within {self.limits.seconds:g} s "
                          "(--time-limit); found it still at work. Allow more, or make the recording shorter."}
            elif worker.memory_mb() > self.limits.memory_mb:
                answer = {"ended": "memory", "said": f"wanted at most {self.limits.memory_mb:g} MB of memory "
                          "(--memory-limit); found more in use. Allow more, or make the recording shorter."}
            if answer is not None and worker.index is not None:
                worker.kill()
                self.workers.remove(worker)
                found.append((worker.index, {**answer, "seconds": round(time.monotonic() - worker.began, 3)}))
        return found

    def close(self) -> None:
        """End all workers."""
        for worker in self.workers:
            worker.kill()
        self.workers.clear()


def died(code: int | None) -> Answer:
    """What came of a task whose worker ended before it did."""
    how = f"code {code}"
    if code is not None and code < 0:
        how = f"signal {-code}" + (f", {signal.Signals(-code).name}" if -code in set(signal.Signals) else "")
    return {"ended": "died", "said": f"wanted the step to end; found that its worker process ended first ({how}). "
            "Run the step by hand to see why; --retry tries it again."}


def check_memory_limit(asked: bool) -> None:
    """Raise BadOption where a limit was asked for and the system does not tell the memory of a process."""
    if asked and not PROC.exists():
        raise BadOption("a system that tells the memory of a process for --memory-limit", f"{sys.platform}",
                        "Leave it out; --time-limit works everywhere.")
