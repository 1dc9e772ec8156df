"""A parameter's name is put together and cut in one place."""

import ast

import pytest

from drivetool.drive import TOTALS, two_mass
from drivetool.quantity import (
    ParameterName,
    name_of,
    names_of,
    owner_of,
    parse_name,
    quantity_of,
    record_of,
    shared,
    with_parts,
)
from tests import tree

QUANTITIES = {quantity_of(name) for name in two_mass().quantities}
ROOMS = ("drive", "identify", "check", "tune")
FILES = sorted(path for room in ROOMS for path in (tree.ROOT / room).rglob("*.py")
               if not {"kernel", "compile"} & set(path.relative_to(tree.ROOT).parts))
# Where OWNER.speed is a state of a simulation, NAME.fitted a figure of a finding, or a module.
OTHERS = {"chain_torque.py", "limit_cycle.py", "between_records.py", "catalogue.py"}


@pytest.mark.parametrize("text, parts", [
    ("motor.inertia", ("motor", "inertia", "")), ("total.viscous", ("total", "viscous", "")),
    ("motor.added_inertia@run.1.parquet", ("motor", "added_inertia", "run.1.parquet"))])
def test_a_name_has_parts_and_comes_back(text, parts):
    name = parse_name(text)
    assert name == ParameterName(*parts) and str(name) == text == name_of(*parts)
    assert (owner_of(text), quantity_of(text), record_of(text)) == parts and shared(text) == name_of(*parts[:2])
    assert with_parts(text, quantity="coulomb") == name_of(parts[0], "coulomb", parts[2])


def test_every_name_of_a_drive_is_of_this_form():
    drive = two_mass()
    assert {name_of(*parse_name(name)) for name in drive.quantities} == set(drive.quantities) > set(TOTALS)
    assert names_of(drive.bodies, "coulomb") == ["motor.coulomb", "load.coulomb"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(tree.ROOT)))
def test_no_name_is_put_together_or_cut_as_text(path):
    found = [node.lineno for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
             if composes(node, path) or cuts(node)]
    assert not found


def composes(node, path):
    """f"{owner}.inertia", or f"{owner}.{quantity}"."""
    if not isinstance(node, ast.JoinedStr) or not isinstance(node.values[0], ast.FormattedValue):
        return False
    rest = node.values[1:]
    if len(rest) == 1 and isinstance(rest[0], ast.Constant):
        return rest[0].value.removeprefix(".") in QUANTITIES and rest[0].value[0] == "."
    return (len(rest) == 2 and isinstance(rest[0], ast.Constant) and rest[0].value == "."
            and isinstance(rest[1], ast.FormattedValue) and path.name not in OTHERS)


def cuts(node):
    """name.endswith(".inertia"), name.partition(".") and the like."""
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute) or not node.args:
        return False
    texts = [each.value for each in ast.walk(node.args[0]) if isinstance(each, ast.Constant)]
    if node.func.attr in ("endswith", "removesuffix"):
        return any(isinstance(text, str) and text[:1] == "." and text[1:] in QUANTITIES for text in texts)
    return node.func.attr in ("partition", "rpartition", "split", "rsplit") and texts == ["."] and not (
        isinstance(node.func.value, ast.Name) and node.func.value.id == "__name__")  # a module's
