"""The progress bar: on a terminal's standard error, and nowhere else."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from drivetool.cli.output import bar
from drivetool.cli.output.bar import progress_bar
from drivetool.progress import counted, progress_to


def progress_events(body):
    """The progress events while `body` runs."""
    events = []
    with progress_to(lambda *line: events.append(line)):
        body()
    return events


def test_items_are_reported_as_they_come():
    assert progress_events(lambda: list(counted("starts", "ab", 2))) == [("starts", 0, 2), ("starts", 1, 2),
                                                                         ("starts", 2, 2)]


def test_a_stage_that_ends_early_is_over():
    def stop():
        for item in counted("starts", "abcd", 4):
            if item == "b":
                break

    assert progress_events(stop)[-1] == ("starts", 4, 4)


def test_a_stage_that_fails_is_over():
    def fail():
        with pytest.raises(ValueError, match="broken"):
            for _ in counted("starts", "abcd", 4):
                raise ValueError("broken")

    assert progress_events(fail)[-1] == ("starts", 4, 4)


def test_nobody_listens_afterwards():
    events = progress_events(lambda: None)
    list(counted("starts", "ab", 2))
    assert events == []


def test_a_log_gets_few_lines_of_the_first_use(monkeypatch, capsys):
    clock = iter([2.0, 15.0])
    monkeypatch.setattr(bar.time, "monotonic", lambda: next(clock))
    with progress_bar():
        list(counted("first use: 9 parts of the kernel are compiled", range(9), 9))
        list(counted("starts", range(9), 9))
    assert capsys.readouterr().err.splitlines() == [
        "drivetool: first use: 9 parts of the kernel are compiled.", "drivetool: 3 of 9 parts are ready.",
        "drivetool: 5 of 9 parts are ready.", "drivetool: 7 of 9 parts are ready.", "drivetool: compiled in 13 s."]


def test_a_terminal_keeps_how_long_the_first_use_took(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress_bar():
        list(counted("first use: 2 parts of the kernel are compiled", range(2), 2))
        list(counted("starts", range(2), 2))
    assert capsys.readouterr().err.count("drivetool: compiled in 0 s.\n") == 1


def on_a_terminal(room, *more):
    """(exit code, stdout, what a terminal got from standard error) of a small design."""
    params = room / "drive.yaml"
    params.write_text(
        "schema: drivetool/parameters/1\nparameters:\n"
        "  motor.inertia: {value: 0.6}\n  load.inertia: {value: 5.2}\n  shaft.stiffness: {value: 3300}\n"
        "  shaft.damping: {value: 3.1}\n", encoding="utf-8")
    ours, theirs = pty.openpty()
    words = ["tune", "--params", str(params), "--converter", "433,0.69,2 ms", "--out", str(room / "gains.yaml")]
    output = b""
    with (room / "stdout").open("wb") as out, subprocess.Popen(
            [sys.executable, "-m", "drivetool.cli.main", *words, *more], stdout=out, stderr=theirs, cwd=room,
            env={**os.environ, "TERM": "xterm"}) as run:
        os.close(theirs)
        while part := read(ours):
            output += part
    os.close(ours)
    return run.returncode, (room / "stdout").read_text(encoding="utf-8"), output.decode()


def read(terminal):
    """What a terminal has next; nothing once the other side is closed."""
    try:
        return os.read(terminal, 4096)
    except OSError:
        return b""


@pytest.mark.slow
def test_a_terminal_gets_the_progress_bar_and_the_result_stays_clean(tmp_path):
    code, out, screen = on_a_terminal(tmp_path)
    assert code == 0, screen
    assert "designs" in screen and "0/1" in screen
    assert "designs" not in out and "\x1b" not in out


@pytest.mark.slow
def test_quiet_means_no_progress_bar(tmp_path):
    code, _, screen = on_a_terminal(tmp_path, "--quiet")
    assert code == 0 and screen == ""
