"""How many statements each room has, and that all together have no more than `size.txt` says.

The stubs of faces are lists of names, of which no line runs; the table lists their lines separately.
"""

import ast
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "drivetool"
LIMIT = int((Path(__file__).parent / "size.txt").read_text())


def statements(source):
    """Statements of a source text without its docstrings, or other strings that stand by themselves."""
    return sum(isinstance(node, ast.stmt) and not (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str))
        for node in ast.walk(ast.parse(source)))


def rooms():
    """Statements by room; a module beside the rooms is one of its own."""
    found = Counter()
    for path in ROOT.rglob("*.py"):
        found[path.relative_to(ROOT).parts[0]] += statements(path.read_text(encoding="utf-8"))
    return found


def test_the_tool_has_not_grown():
    """-s prints the table; CONTRIBUTING.md says what becomes of the number."""
    found = rooms()
    table = "\n".join(f"{count:7d}  {room}" for room, count in [*found.most_common(), ("in all", found.total())])
    stubs = sum(statements(path.read_text(encoding="utf-8")) for path in ROOT.rglob("*.pyi"))
    print(f"\n{table}\n{stubs:7d}  in stubs")
    assert found.total() <= LIMIT, f"{found.total() - LIMIT} statements more than tests/size.txt allows\n{table}"


@pytest.mark.parametrize(("source", "count"), [
    ("", 0), ('"""Text."""\n', 0), ('def f():\n    """Text."""\n    return 1\n', 2), ("x = 1; y = 2", 2),
    ("x: int\n'''Text.'''\n", 1), ("if x:\n    f(a)\nelse:\n    pass\n", 3), ("class A:\n    b = [1, 2]\n", 2)])
def test_what_counts(source, count):
    assert statements(source) == count
