"""Runs the examples of the pages and compares what they print: `python docs/check_examples.py [--write]`.

A ```console block holds `$ command` lines, each followed by what it prints on a terminal. All of them run in one
temporary folder that holds the fixtures, the tutorial first, so that a later page may use the files it makes.
Text is compared word by word, so that line breaks and columns are free. A number with a decimal point may
differ by two in its last digit, which is what another processor changes; `...` stands for any words.
A ```sh block does not run; its drivetool commands must name steps, options and values that exist. A ```yaml block
with a schema line must be a file that the tool takes.
With --write, a block that differs gets what was printed now; look at the difference before you keep it.
"""

from __future__ import annotations

import os
import pty
import re
import shlex
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from drivetool.cli.command_line import app
from drivetool.errors import DriveToolError
from drivetool.files.yaml import load_channel_map, load_parameters
from drivetool.site.plan import load_site

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("docs/tutorial/index.md", "README.md", "CONTRIBUTING.md", "docs/**/*.md")
BLOCK = re.compile(r"^( *)```(console|sh|yaml)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"(\d+\.\d+)")
LAST_DIGITS = 2.0  # in units of the last digit printed; rounding alone may take one
# Said once on a machine whose cache is empty, whichever example comes first.
COMPILED = re.compile(r"^drivetool: compiled in \d+ s\.\n", re.MULTILINE)
ENDED = "@exit"  # a line that no command prints: it parts the output of one from that of the next
# A terminal of fixed width that draws neither colours nor a progress bar.
TERMINAL = {"TERM": "dumb", "COLUMNS": "80", "LINES": "50"}


@dataclass(frozen=True)
class Block:
    """A fenced example.

    page    path from the project's root; line of its first line
    kind    console: to be run; sh: commands alone; yaml: a file
    text    between the fences, without their indent
    indent  of the fences, in a list
    """

    page: str
    line: int
    kind: str
    text: str
    indent: str = ""

    def steps(self) -> list[tuple[str, str]]:
        """(command, expected output) of a console block, in order."""
        parts = re.split(r"^\$ ", self.text, flags=re.MULTILINE)[1:]
        return [(command, output) for command, _, output in (
            re.sub(r"\\\n\s*", "", part).partition("\n") for part in parts)]


def blocks_of(page: str, text: str) -> list[Block]:
    """The fenced examples of a page."""
    return [Block(page, text.count("\n", 0, found.start()) + 1, found[2], textwrap.dedent(found[3]), found[1])
            for found in BLOCK.finditer(text)]


def differs(expected: str, printed: str) -> str:
    """The first words that are not as expected; empty if there are none."""
    chunks = [chunk.split() for chunk in re.split(r"(?<!\S)\.\.\.(?!\S)", expected)]
    words, at = printed.split(), 0
    for i, chunk in enumerate(chunks):
        end = len(words) - len(chunk)  # the last chunk is where the output ends, the first where it begins
        places = range(max(at, end) if i == len(chunks) - 1 else at, (at if i == 0 else end) + 1)
        place = next((place for place in places if _fits(chunk, words[place:])), None)
        if place is None:
            return _parting(chunk, words[at:])
        at = place + len(chunk)
    return "" if at == len(words) else _parting([], words[at:])


def _fits(chunk: Sequence[str], words: Sequence[str]) -> bool:
    """Whether words begin with those of a chunk."""
    return len(words) >= len(chunk) and all(map(same, chunk, words))


def same(expected: str, printed: str) -> bool:
    """Whether two words are equal, but for the last digits of their numbers."""
    parts = NUMBER.split(expected), NUMBER.split(printed)
    return len(parts[0]) == len(parts[1]) and all(
        left == right or (bool(NUMBER.fullmatch(left)) and bool(NUMBER.fullmatch(right)) and _close(left, right))
        for left, right in zip(*parts, strict=True))


def _close(left: str, right: str) -> bool:
    """Whether two numbers differ by no more than the last digits of the first."""
    unit = 10.0 ** -len(left.partition(".")[2])
    return abs(float(left) - float(right)) <= (LAST_DIGITS + 1e-6) * unit


def _parting(chunk: Sequence[str], words: Sequence[str]) -> str:
    """Where they part, in words."""
    alike = next((i for i, pair in enumerate(zip(chunk, words, strict=False)) if not same(*pair)),
                 min(len(chunk), len(words)))
    return (f"expected `{' '.join(chunk[alike:alike + 8]) or 'the end'}`; "
            f"printed `{' '.join(words[alike:alike + 8]) or 'nothing more'}`")


def run(commands: Sequence[str], folder: str) -> list[tuple[str, int]]:
    """(what it printed, exit code) of each command, in one shell on a pseudo-terminal."""
    script = "".join(f"{command}\ncode=$?; echo {ENDED} $code; (exit $code)\n" for command in commands)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    ours, theirs = pty.openpty()
    shell = subprocess.Popen(["bash", "-c", script], cwd=folder, stdin=subprocess.DEVNULL, stdout=theirs,
                             stderr=theirs, env=os.environ | TERMINAL | {"PATH": path})
    os.close(theirs)
    text = COMPILED.sub("", b"".join(_read(ours)).decode().replace("\r\n", "\n"))
    os.close(ours)
    shell.wait()
    parts = re.split(rf"^{ENDED} (\d+)\n", text, flags=re.MULTILINE)
    return list(zip(parts[0::2], map(int, parts[1::2]), strict=False))


def _read(terminal: int) -> Iterator[bytes]:
    """What a pseudo-terminal gives until its other side is closed."""
    while True:
        try:
            some = os.read(terminal, 65536)
        except OSError:  # how Linux says that nobody writes any more
            return
        if not some:
            return
        yield some


def faults_of(block: Block, folder: str) -> tuple[list[str], str]:
    """(what is wrong with a console block, the text that would be right)."""
    steps, faults, right = block.steps(), [], ""
    done = run([command for command, _ in steps], folder)
    for i, ((command, expected), (printed, code)) in enumerate(zip(steps, done, strict=True)):
        problem = differs(expected, printed)
        checked = i + 1 < len(steps) and steps[i + 1][0] == "echo $?"
        if code and not checked:
            problem = problem or f"exit code {code}, which the next command does not show"
        if problem:
            faults.append(f"$ {command}\n    {problem}")
        kept = printed if differs(expected, printed) else expected
        right += f"$ {command}\n" + "".join(f"{line.rstrip()}\n" for line in kept.splitlines() if line.strip())
    return faults, right


def wrong_usage(block: Block) -> list[str]:
    """The drivetool commands of a block that does not run, which name what does not exist."""
    faults, commands = [], typer.main.get_command(app).commands
    for line in re.sub(r"\\\n\s*", "", block.text).splitlines():
        for part in re.split(r"\s[|&>;]+\s", line):
            words = shlex.split(part, comments=True)
            if words[:1] != ["drivetool"] or words[1:2] == ["--help"]:
                continue
            if words[1] not in commands:
                faults.append(f"{line}\n    no step {words[1]}")
                continue
            try:
                commands[words[1]].make_context(words[1], words[2:])
            except Exception as error:  # of click, or of the click inside newer versions of typer
                if not hasattr(error, "format_message"):
                    raise
                faults.append(f"{line}\n    {error.format_message()}")
    return faults


def refused(block: Block, folder: str) -> list[str]:
    """What the tool says against a file that a page shows; nothing of a part of one, which has no schema line."""
    schema = re.match(r"schema: drivetool/([a-z-]+)/", block.text)
    if schema is None:
        return []
    path = Path(folder) / "rewritten.yaml"
    path.write_text(block.text, encoding="utf-8")
    try:
        if schema[1] == "channel-map":
            load_channel_map(str(path))
        elif schema[1] == "site":
            load_site(path)
        else:
            load_parameters([str(path)]).stated()
    except DriveToolError as error:
        return [str(error)]
    return []


def main(write: bool) -> int:
    """Check every page; the number of examples that are wrong."""
    paths = list(dict.fromkeys(path for pattern in PAGES for path in sorted(ROOT.glob(pattern))))
    wrong = ran = 0
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "fixtures").symlink_to(ROOT / "fixtures")
        for path in paths:
            text = path.read_text(encoding="utf-8")
            for block in blocks_of(path.relative_to(ROOT).as_posix(), text):
                right = ""
                if block.kind == "console":
                    faults, right = faults_of(block, folder)
                else:
                    faults = wrong_usage(block) if block.kind == "sh" else refused(block, folder)
                ran += 1
                wrong += bool(faults)
                for fault in faults:
                    print(f"{block.page}:{block.line}: {fault}", file=sys.stderr)
                if faults and right:
                    text = text.replace(textwrap.indent(block.text, block.indent),
                                        textwrap.indent(right, block.indent), 1)
            if write:
                path.write_text(text, encoding="utf-8")
    print(f"{ran} examples, {wrong} of them wrong")
    return wrong


if __name__ == "__main__":
    sys.exit(bool(main("--write" in sys.argv[1:])))
