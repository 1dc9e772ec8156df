"""Imports go one way, third parties stay behind their fences, files and functions stay small."""

import ast
import sys
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
          "cli": {"typer", "rich"},
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
