"""Where things lie, and what git says."""

from __future__ import annotations

import hashlib
import os
import subprocess
from pathlib import Path

from tests.golden import surroundings

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
LOCK, BASE, RENAMED = HERE / "lock.txt", HERE / "BASE", HERE / "renamed.csv"


def folder() -> Path:
    """Where everything is built; several checkouts share it by DRIVETOOL_GOLDEN."""
    return Path(os.environ.get("DRIVETOOL_GOLDEN") or ROOT / "build" / "golden").resolve()


def digest(data: bytes) -> str:
    """The name of a content."""
    return hashlib.sha256(data).hexdigest()


def environment_hash(lock: Path = LOCK) -> str:
    """The name of the environment: its libraries, its variables, the processor."""
    return digest(lock.read_bytes() + surroundings.described())[:12]


def results(commit: str) -> Path:
    """The results of a commit in this environment."""
    return folder() / "results" / f"{commit[:12]}-{environment_hash()}"


def git(*words: str, root: Path = ROOT) -> str | None:
    """What git prints; None if it fails."""
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def commit_of(name: str, root: Path = ROOT) -> str:
    """The full hash of a commit.

    raises  SystemExit: there is none
    """
    found = git("rev-parse", "--verify", "--quiet", f"{name}^{{commit}}", root=root)
    if not found:
        raise SystemExit(f"BASE {name} is no commit of this repository.")
    return found


def base() -> str:
    """The commit that the file BASE names."""
    return commit_of(BASE.read_text().strip())


def head_of_clean_tree(root: Path = ROOT) -> str:
    """The commit that the working tree is.

    raises  SystemExit: the tree differs from it
    """
    changed = git("status", "--porcelain", root=root)
    if changed is None or changed:
        raise SystemExit("The working tree differs from its commit: commit or stash what has changed.")
    return commit_of("HEAD", root)
