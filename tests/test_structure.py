"""Imports go one way, third parties stay behind their fences, files and functions stay small."""

import ast
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "drivetool"
FILES = sorted(ROOT.rglob("*.py"))
BASE = {"quantity", "errors", "progress", "finding_codes"}
LOWER = {"logs": BASE, "drive": BASE, "identify": BASE | {"logs", "drive"}}
LOWER["check"] = LOWER["tune"] = LOWER["identify"] | {"identify"}
LOWER["files"] = LOWER["check"] | {"check", "tune"}
LOWER["cli"] = LOWER["files"] | {"files"}
LOWER["__main__"] = {"cli"}
LOWER["errors"] = {"finding_codes"}
LOWER["finding_codes"] = LOWER["quantity"] = LOWER["progress"] = LOWER["__init__"] = set()
FREE = {"numpy", "scipy", "drivetool"} | set(sys.stdlib_module_names)
FENCED = {"logs": {"mcap", "pyarrow", "msgspec", "lz4", "zstandard"}, "tune": {"control", "numba"},
          "drive": {"llvmlite", "numba"},
          "cli": {"typer", "rich", "dask"},
          "files": {"yaml", "rich", "matplotlib", "msgspec", "pyarrow"}}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_structure(path):
    room = path.relative_to(ROOT).parts[0].removesuffix(".py")
    source = path.read_text(encoding="utf-8")
    assert source.count("\n") <= 400, "a file has at most 400 lines"
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            assert node.end_lineno - node.lineno < 60, f"{node.name} has more than 60 lines"
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names = [f"{node.module}.{a.name}" for a in node.names]
        for top, *rest in (name.split(".") for name in names):
            assert top in FREE | FENCED.get(room, set()), f"{top} is not for {room}"
            if top == "drivetool" and rest and rest[0] in LOWER and rest[0] != "__init__":
                assert rest[0] in LOWER[room] | {room}, f"{room} must not import {rest[0]}"


def test_no_folder_of_check_is_crowded():
    """Fifteen files side by side are what a reader takes in; the causes are a catalogue."""
    folders = {path.parent for path in FILES if path.is_relative_to(ROOT / "check")} - {ROOT / "check" / "causes"}
    assert {f.name: n for f in folders if (n := len([*f.glob("*.py")])) > 15} == {}


def test_no_files_of_check_import_each_other():
    files = {".".join(("drivetool", *path.relative_to(ROOT).with_suffix("").parts)): path for path in FILES
             if path.is_relative_to(ROOT / "check") and path.name != "__init__.py"}
    order = TopologicalSorter({name: _imported(path) & files.keys() for name, path in files.items()})
    order.prepare()  # raises where there is a circle, and names it


def _imported(path):
    """Modules that a file imports, or may: a name taken from a package may be one."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {name for node in froms for a in node.names for name in (node.module, f"{node.module}.{a.name}")}
