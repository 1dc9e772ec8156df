"""Names of modules in imports, strings, comments, settings and pages lead to something: files take them along."""

import ast
import re
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from token import COMMENT
from tokenize import tokenize

import pytest

from tests.places import ROOT

CODE = ("drivetool/**/*.py", "tests/**/*.py", "docs/**/*.py", ".ci/*.py")
TEXTS = ("pyproject.toml", "Makefile", ".ci/run", "README.md", "CONTRIBUTING.md", "docs/**/*.md", "docs/**/*.yml",
         "docs/*mk")  # no changelog: it names what was
HERE = Path(__file__)  # whose examples lead nowhere
# drivetool.yaml and the like are files of a user.
NAME = re.compile(r"(?<![\w./-])drivetool(?:\.(?!(?:yaml|json|xml|csv|egg)\b)[A-Za-z_]\w*)+")
PLACE = re.compile(r"(?<![\w./-])drivetool(?:/\w+)+\.py\b")


def names():
    """(file, name) of every dotted name; of Python files in imports, string constants and comments."""
    return {(path.relative_to(ROOT).as_posix(), name) for path, text in texts() for name in NAME.findall(text)}


@cache
def texts():
    """(path, text) of everything that may name a module."""
    return tuple(read())


def read():
    for pattern in CODE:
        for path in sorted({*ROOT.glob(pattern)} - {HERE}):
            nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
            yield from ((path, node.value) for node in nodes
                        if isinstance(node, ast.Constant) and isinstance(node.value, str))
            yield from ((path, f"{node.module}.{a.name}") for node in nodes
                        if isinstance(node, ast.ImportFrom) and node.module for a in node.names)
            with path.open("rb") as source:
                yield from ((path, token.string) for token in tokenize(source.readline) if token.type == COMMENT)
    for pattern in TEXTS:
        yield from ((path, path.read_text(encoding="utf-8")) for path in ROOT.glob(pattern) if path.is_file())


@cache
def resolves(name):
    """Whether a dotted name is a module, or an attribute of one."""
    parts, known = name.split("."), 1
    while known < len(parts) and is_module(".".join(parts[:known + 1])):
        known += 1
    found = import_module(".".join(parts[:known])) if known < len(parts) else None
    for part in parts[known:]:
        if not hasattr(found, part):
            return False
        found = getattr(found, part)
    return True


def is_module(name):
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # what is before the last dot is no package
        return False


def test_every_name_is_a_module_or_of_one():
    found = names()
    assert sorted(f"{file}: {name}" for file, name in found if not resolves(name)) == []
    # Each place that the search must see.
    for file in ("pyproject.toml", "Makefile", "drivetool/drive/compile/machine_code.py"):
        assert any(file == place for place, _ in found), file


def test_every_path_is_there():
    found = {(path.relative_to(ROOT).as_posix(), place) for path, text in texts() for place in PLACE.findall(text)}
    assert sorted(f"{file}: {place}" for file, place in found if not (ROOT / place).exists()) == []


@pytest.mark.parametrize(("name", "there"), [
    ("drivetool.finding", True), ("drivetool.finding.Finding", True),
    ("drivetool.finding.Finding.code.nothing", False), ("drivetool.nothing", False),
    ("drivetool.errors.nothing", False), ("drivetool.drive.nothing.errors", False)])
def test_what_resolves(name, there):
    assert resolves(name) == there


@pytest.mark.parametrize(("text", "name"), [
    ("python -m drivetool.cli.demo x", ["drivetool.cli.demo"]), ("see drivetool.", []), ("drivetool.yaml", []),
    ("drivetool.egg-info", []), ("a/drivetool.errors", []), ("f of drivetool.drive.{x}", ["drivetool.drive"])])
def test_what_is_a_name(text, name):
    assert NAME.findall(text) == name
