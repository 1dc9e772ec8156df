"""The one environment of both sides, and the sources of each."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from importlib import metadata
from pathlib import Path

from tests.golden import places
from tests.golden.surroundings import FIXED, WRAPPER


def python() -> Path:
    """The interpreter of the environment."""
    return places.folder() / "env" / "bin" / "python"


def make() -> None:
    """Make the environment if there is none of this lock."""
    env, stamp = places.folder() / "env", places.folder() / "env" / "lock"
    places.folder().mkdir(parents=True, exist_ok=True)
    with open(places.folder() / "making", "w") as alone:
        fcntl.flock(alone, fcntl.LOCK_EX)
        if not stamp.exists() or stamp.read_bytes() != places.LOCK.read_bytes():
            _install(env)
            shutil.copyfile(places.LOCK, stamp)


def _install(env: Path) -> None:
    """The versions of the lock, and nothing else."""
    print(f"golden: {places.LOCK.name} is installed into {env}", flush=True)
    shutil.rmtree(env, ignore_errors=True)
    subprocess.run([sys.executable, "-m", "venv", env], check=True)
    subprocess.run([python(), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps",
                    "--requirement", places.LOCK], check=True)


def inside() -> bool:
    """Whether this process runs in the environment."""
    return Path(sys.prefix).resolve() == (places.folder() / "env").resolve()


def enter(arguments: list[str]) -> None:
    """Go on as a process of the environment."""
    make()
    if not inside():
        threads = {name: value for name, value in FIXED.items() if "THREADS" in name}
        sys.stdout.flush()
        os.execve(python(), [str(python()), "-m", "tests.golden", *arguments],
                  os.environ | threads | {"PYTHONPATH": str(places.ROOT)})


def pinned(lock: Path = places.LOCK) -> dict[str, str]:
    """Distribution -> version."""
    lines = [line.split("#")[0].strip() for line in lock.read_text().splitlines()]
    return dict(line.split("==") for line in lines if line)


def installed() -> dict[str, str]:
    """Distribution -> version, of this process, but for what installs them, and the tool where it is developed."""
    excluded = ("pip", "setuptools", "wheel", "drivetool")
    found = {each.metadata["Name"]: each.version for each in metadata.distributions()}
    return {name: version for name, version in found.items() if _plain(name) not in excluded}


def check_versions(wanted: dict[str, str], found: dict[str, str]) -> None:
    """raises  SystemExit: other versions than those of the lock"""
    wanted, found = ({_plain(name): version for name, version in each.items()} for each in (wanted, found))
    wrong = sorted(name for name in wanted | found if wanted.get(name) != found.get(name))
    if wrong:
        name = wrong[0]
        raise SystemExit(f"{len(wrong)} libraries are not of the lock, the first of them {name}: wanted "
                         f"{wanted.get(name, 'none')}, found {found.get(name, 'none')}. Remove "
                         f"{places.folder() / 'env'}.")


def _plain(name: str) -> str:
    """A distribution's name as pip compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def tree(commit: str) -> Path:
    """The sources of a commit, taken from git once."""
    place = places.folder() / "trees" / commit[:12]
    if not place.exists():
        part = place.with_name(f"{place.name}.{os.getpid()}")
        part.mkdir(parents=True)
        archive = subprocess.Popen(["git", "archive", commit], cwd=places.ROOT, stdout=subprocess.PIPE)
        subprocess.run(["tar", "-x", "-C", part], stdin=archive.stdout, check=True)
        if archive.wait():
            raise SystemExit(f"git gives no archive of {commit}.")
        with suppress(OSError):  # another process was first
            part.rename(place)
    return place


def variables(commit: str) -> dict[str, str]:
    """The environment variables of a side: its own sources, home, and caches."""
    place = tree(commit)
    tools = place.with_name(f"{place.name}-bin")
    home = place.with_name(f"{place.name}-home")
    tools.mkdir(exist_ok=True)
    home.mkdir(exist_ok=True)
    wrapper, text = tools / "drivetool", WRAPPER.format(python=python())
    if not wrapper.exists() or wrapper.read_text() != text:
        part = wrapper.with_suffix(f".{os.getpid()}")
        part.write_text(text)
        part.chmod(0o755)
        part.rename(wrapper)
    return FIXED | {"PATH": os.pathsep.join([str(tools), str(python().parent), "/usr/bin", "/bin"]),
                    "PYTHONPATH": str(place), "HOME": str(home), "XDG_CACHE_HOME": str(home / "cache"),
                    "TMPDIR": str(home / "tmp")}
