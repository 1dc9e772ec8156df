"""Workers that die, never end or take too much: a row with a sentence, and the pool goes on."""

import os
import queue
import signal
import sys
import threading

import pytest

from drivetool.cli.command_line import run_words
from drivetool.site.pool import Limits, Pool, all_at_once
from drivetool.site.pool.pool import Worker
from tests import sites

AMPLE_LIMITS = Limits(60.0, 2000.0)


def write_recordings(folder, *names):
    return [{"folder": str(folder), "look": name, "map": None} for name in names]


@pytest.mark.slow
def test_a_task_that_never_ends_and_one_whose_worker_is_killed(here):
    """A pipe that nobody writes to is a recording that never ends."""
    for name in "good.parquet", "later.parquet":
        sites.write(name, 1, metadata={"serial": "7"})
    os.mkfifo("endless.parquet")
    pool = Pool(1, Limits(8.0, 2000.0), run_words)
    try:
        answers = dict(pool.serve(all_at_once(write_recordings(here, "good.parquet", "endless.parquet",
                                                               "later.parquet"))))
        assert answers[0]["metadata"] == answers[2]["metadata"] == {"serial": "7"}
        assert answers[1]["ended"] == "time" and "within 8 s (--time-limit)" in answers[1]["said"]
        pool.limits = AMPLE_LIMITS
        [victim] = pool.workers
        threading.Timer(1.0, os.kill, (victim.process.pid, signal.SIGKILL)).start()
        answers = dict(pool.serve(all_at_once(write_recordings(here, "endless.parquet", "good.parquet"))))
        assert answers[0]["ended"] == "died" and "signal 9, SIGKILL" in answers[0]["said"]
        assert answers[1]["metadata"] == {"serial": "7"}
    finally:
        pool.close()


@pytest.mark.slow
def test_limits_are_rows_and_higher_ones_are_tried(here, call):
    sites.small(here, count=1)
    code, _, err = call("batch", "site.yaml", "--time-limit", "0.001", "--workers", "1")
    assert code == 3 and "2 with a problem" in err
    assert [r["problem"] for r in sites.table("site-results")] == [
        "wanted an end within 0.001 s (--time-limit); found the step still running. Allow more, or make the "
        "recording shorter."] * 2
    assert "0 of them run now" in call("batch", "site.yaml", "--time-limit", "0.001")[2]
    assert "2 of them run now" in call("batch", "site.yaml", "--time-limit", "0.001", "--retry")[2]
    code, _, err = call("batch", "site.yaml", "--explain")
    assert code == 0 and "2 of them run now" in err


@pytest.mark.slow
def test_in_a_site_a_recording_that_kills_its_worker_and_one_that_never_ends_are_rows(here, call, monkeypatch):
    """The others are fitted; a second run leaves both rows as they are, and --retry does the two again."""
    sites.small(here, machines=("press1",), count=4)
    give = Worker.give

    def harmed(worker, index, task):
        name = " ".join(task.get("words", ()))
        give(worker, index, write_recordings(here, "endless")[0] if "03.parquet" in name else task)
        if "02.parquet" in name:
            worker.process.kill()

    os.mkfifo("endless")
    monkeypatch.setattr(Worker, "give", harmed)
    code, _, err = call("batch", "site.yaml", "--time-limit", "10", "--workers", "2")
    assert code == 3 and "4 results, 4 of them run now, 2 with a problem" in err
    one = [row for row in sites.table("site-results") if row["parameter"] in (None, "motor.viscous")]
    problems = [row["problem"] for row in one]
    assert problems[0] is None and problems[3] is None
    assert "its worker process ended first (signal 9, SIGKILL)" in problems[1]
    assert "within 10 s (--time-limit); found the step still running" in problems[2]
    monkeypatch.setattr(Worker, "give", give)
    assert "0 of them run now, 2 with a problem" in call("batch", "site.yaml", "--time-limit", "10")[2]
    code, _, err = call("batch", "site.yaml", "--time-limit", "10", "--retry")
    assert code == 0 and "2 of them run now, 0 with a problem" in err


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux reports the memory of a process")
def test_too_much_memory(here, call):
    sites.small(here, count=1)
    code, *_ = call("batch", "site.yaml", "--memory-limit", "1")
    assert code == 3
    assert all("at most 1 MB of memory (--memory-limit)" in r["problem"] for r in sites.table("site-results"))
    assert call("batch", "site.yaml")[0] == 0


def test_a_worker_ends_with_its_parent(here):
    """Its input ends, whatever it is at."""
    os.mkfifo("endless.parquet")
    worker = Worker(queue.Queue(), run_words)
    worker.give(0, write_recordings(here, "endless.parquet")[0])
    worker.process.stdin.close()
    assert worker.process.wait(30) == 0
    worker.kill()
