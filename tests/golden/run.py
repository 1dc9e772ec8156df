"""Run cases with one side, two at a time, and keep what each gave."""

from __future__ import annotations

import io
import json
import os
import pty
import shutil
import subprocess
import threading
import time
import zipfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.golden import environment, places
from tests.golden.case import Case, stored

LIMIT = 900.0  # s of one command: far above what any takes on a busy machine
WORKERS = 2
LATE, KILLED = 124, 128


@dataclass(frozen=True)
class Step:
    """What one command gave.

    exit      code; 124 where it was stopped at the time limit, below 0 or above 128 where a signal ended it
    stdout    name of the content of standard output
    files     path -> name of the content, of those that it wrote or changed
    gone      paths that were there before
    seconds   of processor time, no part of the comparison
    """

    command: str
    exit: int
    stdout: str
    files: Mapping[str, str] = field(default_factory=dict)
    gone: Sequence[str] = field(default_factory=list)
    seconds: float = 0.0


@dataclass(frozen=True)
class Result:
    """What a case gave: its steps, and name -> bytes of all contents."""

    steps: tuple[Step, ...]
    contents: Mapping[str, bytes]

    @property
    def seconds(self) -> float:
        """Of processor time."""
        return sum(step.seconds for step in self.steps)

    @property
    def finished(self) -> bool:
        """Whether nothing from outside ended a command: what is left of it would not come again."""
        return all(0 <= step.exit <= KILLED and step.exit != LATE for step in self.steps)

    def write(self, path: Path) -> None:
        """One file, complete or not there."""
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}.{threading.get_ident()}")
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("steps.json", json.dumps([asdict(step) for step in self.steps], indent=1))
            for name, data in self.contents.items():
                archive.writestr(name, data)
        part.rename(path)

    @classmethod
    def read(cls, path: Path) -> Result | None:
        """What `write` wrote; None for what did not finish."""
        if not path.exists():
            return None
        with zipfile.ZipFile(io.BytesIO(path.read_bytes())) as archive:
            steps = tuple(Step(**each) for each in json.loads(archive.read("steps.json")))
            return cls(steps, {name: archive.read(name) for name in archive.namelist() if name != "steps.json"})


def run_all(cases: Sequence[Case], commit: str, again: bool = False, place: Path | None = None) -> Path:
    """Run what has no result yet; returns the folder of the results. What did not finish gets none.

    again  run what has a result, too
    place  another folder of the results
    """
    place, variables = place or places.results(commit), environment.variables(commit)
    todo = [case for case in cases if again or not (place / f"{case.key}.zip").exists()]
    print(f"golden: {commit[:12]}: {len(cases)} cases, {len(todo)} of them to run", flush=True)
    began, left = time.monotonic(), len(todo)
    pool = ThreadPoolExecutor(WORKERS)
    try:
        for done in as_completed([pool.submit(_kept, case, variables, place) for case in todo]):
            case, result = done.result()
            left -= 1
            print(f"{time.monotonic() - began:7.0f} s  {result.seconds:6.1f} s CPU  {case.name}  "
                  f"exits {' '.join(str(step.exit) for step in result.steps)}"
                  f"{'' if result.finished else ', not finished, not kept'}  ({left} left)", flush=True)
    finally:
        pool.shutdown(cancel_futures=True)
    return place


def _kept(case: Case, variables: Mapping[str, str], place: Path) -> tuple[Case, Result]:
    """Run a case in a folder of its own and write its result."""
    # Both sides at one place, so that a text that holds its path is the same.
    work = places.folder() / "work" / f"{os.getpid():010}" / case.key
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    Path(variables["TMPDIR"]).mkdir(parents=True, exist_ok=True)
    try:
        for path, name in case.files.items():
            (work / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(stored(name), work / path)
        result = run(case, work, variables)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    kept = place / f"{case.key}.zip"
    if result.finished:
        result.write(kept)
    else:
        kept.unlink(missing_ok=True)
    return case, result


def run(case: Case, work: Path, variables: Mapping[str, str]) -> Result:
    """The commands of a case, one after the other, in a folder that holds its files."""
    before, contents, steps, code = _names(work), {}, [], 0
    for command in case.commands:
        code, out, seconds = _call(f"(exit {code}); {command}", work, variables, case.terminal)
        after = _names(work)
        changed = {path: name for path, name in after.items() if before.get(path) != name}
        contents[places.digest(out)] = out
        contents |= {name: (work / path).read_bytes() for path, name in changed.items()}
        gone = [path for path in before if path not in after]
        steps.append(Step(command, code, places.digest(out), changed, gone, round(seconds, 2)))
        before = after
    return Result(tuple(steps), contents)


def _names(work: Path) -> dict[str, str]:
    """Path -> name of the content, of every file."""
    return {path.relative_to(work).as_posix(): places.digest(path.read_bytes())
            for path in sorted(work.rglob("*")) if path.is_file()}


def _call(line: str, work: Path, variables: Mapping[str, str], terminal: bool) -> tuple[int, bytes, float]:
    """(exit code, standard output, processor time) of a shell command."""
    ours, theirs = pty.openpty() if terminal else os.pipe()
    process = subprocess.Popen(["bash", "-c", line], cwd=work, env=dict(variables), stdin=subprocess.DEVNULL,
                               stdout=theirs, stderr=subprocess.DEVNULL, start_new_session=True)
    os.close(theirs)
    late = threading.Event()

    def stop() -> None:
        late.set()
        os.killpg(process.pid, 9)

    timer = threading.Timer(LIMIT, stop)
    timer.start()
    out = b""
    try:
        while some := os.read(ours, 1 << 16):
            out += some
    except OSError:  # how Linux says that nobody writes any more to a terminal
        pass
    os.close(ours)
    _, status, usage = os.wait4(process.pid, 0)
    timer.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    if terminal:
        out = out.replace(b"\r\n", b"\n")
    return LATE if late.is_set() else process.returncode, out, usage.ru_utime + usage.ru_stime
