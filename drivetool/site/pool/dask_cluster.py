"""The tasks of a site on a Dask cluster: the same worker processes, on other machines."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from drivetool.errors import BadOption, DriveToolError
from drivetool.site.pool.executor import NextTasks, Runner, all_at_once
from drivetool.site.pool.pool import Answer, Limits, Pool
from drivetool.site.pool.worker import library_versions

# s. A choice: a start of workers takes some seconds; a person waits no longer for a wrong address.
SCHEDULER_TIMEOUT = 15.0
START_CLUSTER_ADVICE = "Start one with `dask scheduler` and `dask worker ADDRESS`, or leave --scheduler out."
_worker_thread = threading.local()


@dataclass
class Cluster:
    """An executor that hands tasks to a scheduler; client: of dask.distributed; runner: runs the steps there."""

    client: Any
    limits: Limits
    runner: Runner

    def serve(self, next_tasks: NextTasks) -> Iterator[tuple[int, Answer]]:
        """Run all tasks; (number, answer) of each as it ends; see `Executor`.

        raises  DriveToolError: a worker has other versions, or the connection is lost
        """
        from dask.distributed import as_completed

        own_versions, task_numbers = library_versions(), {}
        finished = as_completed([], loop=self.client.loop)

        def submit() -> None:
            for number, task in next_tasks():
                future = self.client.submit(run_remotely, task, self.limits, self.runner, own_versions, pure=False)
                task_numbers[future] = number
                finished.add(future)

        submit()
        for future in finished:
            yield task_numbers[future], self._answer(future, own_versions)
            submit()

    def _answer(self, future: Any, own_versions: dict[str, str]) -> Answer:
        """The answer of a task; see `serve`."""
        if future.status != "finished":
            error = future.exception() if future.status == "error" else "the connection was lost"
            if type(error).__name__ != "KilledWorker":
                raise DriveToolError("a Dask cluster that does the tasks", f"{type(error).__name__}: {error}",
                                     "Look at the cluster, then run the same command again: it goes on.")
            return {"ended": "died", "said": "wanted the step to end; found that the workers of the cluster that "
                    "took it ended first. Run the step by hand to see why; --retry tries it again."}
        answer = future.result()
        if "numerics" in answer:
            there = ", ".join(f"{k} {v}" for k, v in answer["numerics"].items() if own_versions.get(k) != v)
            raise DriveToolError(
                f"workers with {', '.join(f'{k} {v}' for k, v in own_versions.items())}, as here",
                f"one with {there}", "Install the same versions everywhere: "
                "results must not depend on who computes them.")
        return answer


def run_remotely(task: dict[str, Any], limits: Limits, runner: Runner, expected: dict[str, str]) -> Answer:
    """A task on a worker of the cluster, in a separate process, so that its limits hold there, too."""
    if library_versions() != expected:
        return {"numerics": library_versions()}
    pool: Pool | None = getattr(_worker_thread, "pool", None)
    if pool is None or (pool.limits, pool.runner) != (limits, runner):
        if pool is not None:
            pool.close()
        pool = _worker_thread.pool = Pool(1, limits, runner)
    [(_, answer)] = list(pool.serve(all_at_once([task])))
    return answer


@contextmanager
def cluster(address: str, limits: Limits, runner: Runner) -> Iterator[Cluster]:
    """The cluster behind a scheduler; runner: runs the steps on its workers.

    raises  BadOption: no address, or dask.distributed is not installed
            DriveToolError: the scheduler does not answer, or has no workers
    """
    if not re.fullmatch(r"(tcp|tls|ucx|wss?)://[^\s/]+:\d{1,5}", address):  # the client would hang when it closes
        raise BadOption("an address as in tcp://HOST:PORT for --scheduler", f"'{address}'",
                        "Take the one that `dask scheduler` prints.")
    try:
        from dask.distributed import Client
    except ImportError:
        raise BadOption("dask.distributed for --scheduler", "it not installed",
                        "In a clone of drivetool run `pip install '.[site]'`, or leave --scheduler out.") from None
    for name in ("distributed", "tornado", "asyncio"):  # their messages are replaced by the errors below
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        client = Client(address, timeout=SCHEDULER_TIMEOUT, set_as_default=False)
    except Exception as error:  # of sockets, time and addresses, without a common class
        raise DriveToolError(f"a Dask scheduler at {address}", f"no answer ({type(error).__name__})",
                             START_CLUSTER_ADVICE) from None
    try:
        try:
            client.wait_for_workers(1, timeout=SCHEDULER_TIMEOUT)
        except TimeoutError:
            raise DriveToolError(f"workers of the Dask scheduler at {address}", "none",
                                 START_CLUSTER_ADVICE) from None
        yield Cluster(client, limits, runner)
    finally:
        client.close(timeout=SCHEDULER_TIMEOUT)
