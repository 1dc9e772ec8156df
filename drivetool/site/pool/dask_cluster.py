"""The tasks of a site on a Dask cluster: the same work in the same kind of worker process, elsewhere."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from drivetool.errors import BadOption, DriveToolError
from drivetool.site.pool.executor import More, Runner, once
from drivetool.site.pool.pool import Answer, Limits, Pool
from drivetool.site.pool.worker import numerics

PATIENCE = 15.0  # s until a scheduler that does not answer, or has no workers, is given up
NONE_THERE = "Start one with `dask scheduler` and `dask worker ADDRESS`, or leave --scheduler out."
_here = threading.local()


@dataclass
class Cluster:
    """An executor that hands tasks to a scheduler; client: dask.distributed's; runner: does the steps there."""

    client: Any
    limits: Limits
    runner: Runner

    def serve(self, more: More) -> Iterator[tuple[int, Answer]]:
        """Do tasks until there are no more; (number, what came of it) of each as it ends; see `Executor`.

        raises  DriveToolError: a worker has other versions, or the connection is lost
        """
        from dask.distributed import as_completed

        mine, numbers = numerics(), {}
        ended = as_completed([], loop=self.client.loop)

        def submit() -> None:
            for number, task in more():
                future = self.client.submit(remote, task, self.limits, self.runner, mine, pure=False)
                numbers[future] = number
                ended.add(future)

        submit()
        for future in ended:
            yield numbers[future], self._answer(future, mine)
            submit()

    def _answer(self, future: Any, mine: dict[str, str]) -> Answer:
        """What came of a task; see `serve`."""
        if future.status != "finished":
            error = future.exception() if future.status == "error" else "the connection was lost"
            if type(error).__name__ != "KilledWorker":
                raise DriveToolError("a Dask cluster that does the tasks", f"{type(error).__name__}: {error}",
                                     "Look at the cluster, then run the same command again: it goes on.")
            return _killed()
        answer = future.result()
        if "numerics" in answer:
            there = ", ".join(f"{k} {v}" for k, v in answer["numerics"].items() if mine.get(k) != v)
            raise DriveToolError(
                f"workers with {', '.join(f'{k} {v}' for k, v in mine.items())}, as here", f"one with {there}",
                "Install the same versions everywhere: results must not depend on who computes them.")
        return answer


def _killed() -> Answer:
    return {"ended": "died", "said": "wanted the step to end; found that the workers of the cluster that took it "
            "ended first. Run the step by hand to see why; --retry tries it again."}


def remote(task: dict[str, Any], limits: Limits, runner: Runner, expected: dict[str, str]) -> Answer:
    """A task on a worker of the cluster, in a process of its own so that its limits hold there, too."""
    if numerics() != expected:
        return {"numerics": numerics()}
    pool: Pool | None = getattr(_here, "pool", None)
    if pool is None or (pool.limits, pool.runner) != (limits, runner):
        if pool is not None:
            pool.close()
        pool = _here.pool = Pool(1, limits, runner)
    [(_, answer)] = list(pool.serve(once([task])))
    return answer


@contextmanager
def cluster(address: str, limits: Limits, runner: Runner) -> Iterator[Cluster]:
    """The cluster behind a scheduler; runner: does the steps on its workers.

    raises  BadOption: no address, or dask.distributed is not installed
            DriveToolError: nobody answers, or nobody works
    """
    if not re.fullmatch(r"(tcp|tls|ucx|wss?)://[^\s/]+:\d{1,5}", address):  # the client would hang in its end
        raise BadOption("an address as in tcp://HOST:PORT for --scheduler", f"'{address}'",
                        "Take the one that `dask scheduler` prints.")
    try:
        from dask.distributed import Client
    except ImportError:
        raise BadOption("dask.distributed for --scheduler", "it not installed",
                        "In a clone of drivetool run `pip install '.[site]'`, or leave --scheduler out.") from None
    for name in ("distributed", "tornado", "asyncio"):  # what they have to say is said below
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # of sockets, time and addresses, each in a class of its own
        raise DriveToolError(f"a Dask scheduler at {address}", f"no answer ({type(error).__name__})",
                             NONE_THERE) from None
    try:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise DriveToolError(f"workers of the Dask scheduler at {address}", "none", NONE_THERE) from None
        yield Cluster(client, limits, runner)
    finally:
        client.close(timeout=PATIENCE)
