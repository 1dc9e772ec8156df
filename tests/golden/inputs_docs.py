"""Every example of the documents, as BASE has them: their text may change, their commands are compared."""

from __future__ import annotations

import re
import subprocess
import textwrap
from collections.abc import Iterator

from tests.golden import places
from tests.golden.case import Case, case

BLOCK = re.compile(r"^( *)```console\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
# The pages that go on with files of the tutorial.
FIRST = ("docs/tutorial/index.md", "README.md")


def cases(base: str) -> list[Case]:
    """One chain a page; the first pages together with those that use their files."""
    fixtures = {path.relative_to(places.ROOT).as_posix(): path
                for path in sorted((places.ROOT / "fixtures").rglob("*")) if path.is_file()}
    found = []
    for page in pages(base):
        chain = list(commands(text_of(base, page)))
        if not chain:
            continue
        made = set(re.findall(r"--out (\S+)", " ".join(chain)))
        missing = set(re.findall(r"(?:--params|-p|validate|show) (\w+\.yaml)", " ".join(chain))) - made
        if missing and page not in FIRST:
            chain = [*commands(text_of(base, FIRST[0])), *chain]
        used = {path: file for path, file in fixtures.items() if _uses(chain, path)}
        found.append(case(f"docs-{page.removesuffix('.md').replace('/', '-')}", "docs", used, chain, terminal=True))
    return found


def _uses(chain: list[str], path: str) -> bool:
    """Whether a command may read a fixture: names its folder."""
    folder = path.rpartition("/")[0]
    return any(f"{folder}/" in command for command in chain)


def pages(base: str) -> list[str]:
    """Paths of the pages."""
    listed = places.git("ls-tree", "-r", "--name-only", base) or ""
    return [path for path in listed.splitlines()
            if path in ("README.md", "CONTRIBUTING.md") or (path.startswith("docs/") and path.endswith(".md"))]


def text_of(base: str, path: str) -> str:
    """A file of BASE."""
    return subprocess.run(["git", "show", f"{base}:{path}"], cwd=places.ROOT, capture_output=True, check=True,
                          text=True).stdout


def commands(text: str) -> Iterator[str]:
    """The commands of a page, in order."""
    for block in BLOCK.finditer(text):
        for part in re.split(r"^\$ ", textwrap.dedent(block[2]), flags=re.MULTILINE)[1:]:
            yield re.sub(r"\\\n\s*", "", part).partition("\n")[0]
