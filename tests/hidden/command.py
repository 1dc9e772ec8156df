"""The tool at its process boundary, and the grade of its answer against the label.

The process sees a folder of records and a start file; labels lie elsewhere.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

VERDICTS = ("nothing-found", "named", "undetermined", "unexplained")
GRADES = ("right", "undetermined", "partial", "unexplained", "missed", "wrong", "false-alarm", "failed")

CommandRunner = Callable[[Path, Sequence[object]], subprocess.CompletedProcess]


@dataclass(frozen=True)
class Answer:
    """What diagnose said.

    verdict    one of VERDICTS, or "failed" with what it printed in `stderr`
    causes, between  effect codes
    gain       as in the file; candidates: one mapping per candidate
    parameters name -> section of the extended file; rule, facts: what made the verdict
    """

    verdict: str
    causes: tuple[str, ...] = ()
    between: tuple[str, ...] = ()
    gain: dict = field(default_factory=dict)
    candidates: tuple[dict, ...] = ()
    parameters: dict = field(default_factory=dict)
    stderr: str = ""
    rule: str = ""
    facts: dict = field(default_factory=dict)


def run(folder: Path, words: Sequence[object], timeout: float = 600.0) -> subprocess.CompletedProcess:
    """One drivetool command in `folder`; the words are its command line."""
    command = [sys.executable, "-m", "drivetool.cli.main", *map(str, words)]
    try:
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 124, "", f"not done after {timeout:g} s")


def greybox_and_diagnose(folder: Path, logs: Sequence[Path], start: Path, options: Sequence[str] = (),
        more: Sequence[object] = (), runner: CommandRunner = run) -> Answer:
    """greybox, then diagnose.

    folder   with the records; base.yaml and extended.yaml appear in it
    options  for greybox; more: for diagnose, as --candidates or --holdout; runner: `run` or a stand-in
    """
    names = [Path(log).name for log in logs]
    done = runner(folder, ["greybox", *names, "--params", Path(start).name, "--out", "base.yaml", *options])
    if done.returncode not in (0, 3):
        return Answer("failed", stderr=f"greybox: {done.stderr.strip()[-500:]}")
    words = ["diagnose", *names, "--params", "base.yaml", "--out", "extended.yaml", *more]
    done = runner(folder, words)
    if done.returncode not in (0, 3) or not (folder / "extended.yaml").exists():
        return Answer("failed", stderr=f"diagnose: {done.stderr.strip()[-500:]}")
    return read(folder / "extended.yaml", done.stderr)


def read(path: Path, stderr: str = "") -> Answer:
    """The answer in an extended parameter file."""
    content = yaml.safe_load(Path(path).read_text())
    found = content.get("diagnosis") or {}
    if found.get("verdict") not in VERDICTS:
        return Answer("failed", stderr=f"no verdict in {Path(path).name}: {found.get('verdict')!r}")
    return Answer(found["verdict"], tuple(found.get("causes") or ()), tuple(found.get("between") or ()),
                  dict(found.get("gain") or {}), tuple(found.get("candidates") or ()),
                  dict(content.get("parameters") or {}), stderr, found.get("rule", ""),
                  dict(found.get("facts") or {}))


def grade(truth: Sequence[str], answer: Answer, removed: bool = False) -> str:
    """One of GRADES.

    truth    codes of the hidden effects, empty for none
    removed  the true causes were not in the catalogue: no name is the right answer then
    """
    true, named, said = set(truth), set(answer.causes), answer.verdict
    if said == "failed":
        return "failed"
    if not true:
        return "right" if said == "nothing-found" else "false-alarm"
    if said == "nothing-found":
        return "missed"
    if removed:
        return "wrong" if said == "named" else "right"
    if named - true and said != "undetermined":
        return "wrong"
    if said == "unexplained":
        return "unexplained"
    if said == "undetermined":
        return "undetermined" if true & (named | set(answer.between)) else "wrong"
    return "right" if named == true else "partial" if named else "failed"
