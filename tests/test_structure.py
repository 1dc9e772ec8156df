"""Imports go one way, parties stay behind their fences, folders have faces, files and functions stay small."""

import ast
import pkgutil
import re
import subprocess
import sys
from collections import Counter

import pytest

from drivetool.drive import effects
from drivetool.drive.effects import EFFECTS
from tests import tree

FILES = sorted(tree.ROOT.rglob("*.py"))
BASE = {"quantity", "errors", "progress", "finding", "finding_codes", "results"}
LOWER = {"logs": BASE, "drive": BASE, "identify": BASE | {"logs", "drive"}}
LOWER["check"] = LOWER["tune"] = LOWER["identify"] | {"identify"}
LOWER["files"] = LOWER["check"] | {"check", "tune"}
LOWER["site"] = LOWER["files"] | {"files"}
LOWER["cli"] = LOWER["site"] | {"site"}
LOWER["__main__"] = {"cli"}
LOWER["finding"] = {"finding_codes", "results"}
LOWER["errors"] = LOWER["finding_codes"] = LOWER["quantity"] = LOWER["progress"] = LOWER["results"] = set()
LOWER["__init__"] = set()
FREE = {"numpy", "scipy", "drivetool", "msgspec", "lazy_loader"} | set(sys.stdlib_module_names)
FENCED = {"logs": {"mcap", "pyarrow", "lz4", "zstandard"}, "tune": {"control"},
          "drive": {"llvmlite", "numba"},
          "site": {"dask", "matplotlib"},  # the second for the types of a picture that files draws
          "cli": {"typer", "rich"},
          "files": {"jinja2", "yaml", "rich", "matplotlib", "pyarrow"}}
CROWDED = 15  # modules side by side are what a reader takes in
CATALOGUES = ("drivetool.drive.effects", "drivetool.check.causes", "drivetool.cli.commands")
# What may be imported inside a function: these, and modules that load one of them.
HEAVY = {"scipy", "numba", "llvmlite", "matplotlib", "pyarrow", "rich", "control", "dask", "jinja2"}
# And there what `drivetool --help` (test_boundary) and a Parquet log (test_mcap) must not wait for.
LATER = {"drivetool.cli": {"numpy", "yaml", "msgspec"}, "drivetool.logs.formats.read": {"mcap"}}
# Modules are loaded by a name that is computed in these files alone; none loads what imports it.
BY_NAME = {"drivetool.drive.compile.build", "drivetool.check.causes.catalogue", "drivetool.site.pool.worker"}
FACE = "__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)"

@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(tree.ROOT)))
def test_structure(path):
    room = path.relative_to(tree.ROOT).parts[0].removesuffix(".py")
    source = path.read_text(encoding="utf-8")
    assert source.count("\n") <= 400, "a file has at most 400 lines"
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert node.end_lineno - node.lineno < 60, f"{node.name} has more than 60 lines"
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        assert not any(name.startswith("drivetool.") for name in names), "names are taken from a module"
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names = [f"{node.module}.{a.name}" for a in node.names]
        for top, *rest in (name.split(".") for name in names):
            assert top in FREE | FENCED.get(room, set()), f"{top} is not for {room}"
            if top == "drivetool" and rest and rest[0] in LOWER and rest[0] != "__init__":
                assert rest[0] in LOWER[room] | {room}, f"{room} must not import {rest[0]}"


def test_no_files_import_each_other():
    assert tree.circles(tree.graph_of(lambda module: module, tree.arrows())) == []


def test_assembly_and_chain_know_no_effect_by_name():
    """They take effects from the catalogue. A shaft and its ratio make the chain, whatever else the effect is."""
    owned = {name for e in EFFECTS for name in (e.code, *e.quantities)} - {"shaft", "ratio"}
    for module in ("assemble", "chain"):
        parsed = ast.parse((tree.ROOT / "drive" / f"{module}.py").read_text(encoding="utf-8"))
        prose = {id(n.value) for n in ast.walk(parsed) if isinstance(n, ast.Expr)}
        words = {n.value for n in ast.walk(parsed)
                 if isinstance(n, ast.Constant) and isinstance(n.value, str) and id(n) not in prose}
        assert not owned & {part for word in words for part in word.split(".")}, module
        taken = [n for n in ast.walk(parsed) if isinstance(n, ast.ImportFrom) and n.module.startswith(
            "drivetool.drive.effects")]
        assert not {a.name for n in taken for a in n.names} & {
            e.name for e in pkgutil.iter_modules(effects.__path__)}, module


def test_no_folders_import_each_other():
    """In every folder, with all that lies below: the folders in it, and the files beside them as one more."""
    found = {parent: circle for parent in tree.folders() if parent != tree.PRODUCT
             if (circle := tree.circles(tree.graph_of(tree.child_of(parent), tree.arrows())))}
    assert found == {}


def test_no_folder_is_crowded():
    beside = Counter(tree.folder_of(m) for m, path in tree.modules().items() if path.name != "__init__.py")
    assert {f: n for f, n in beside.items() if n > CROWDED and f not in CATALOGUES} == {}


def test_every_folder_of_modules_is_a_package_and_every_room_is_known():
    assert {path.parent for path in FILES if not (path.parent / "__init__.py").exists()} == set()
    assert {path.relative_to(tree.ROOT).parts[0].removesuffix(".py") for path in FILES} == set(LOWER) | {"cli"}


def test_modules_are_loaded_by_a_computed_name_in_known_files_alone():
    found = {module for module, path in tree.modules().items() if re.search(
        r"\b(import_module|__import__)\(", path.read_text(encoding="utf-8"))}
    assert found == BY_NAME


def test_a_folder_is_used_through_its_face():
    """Tests may reach inside; the product may not."""
    inside = [a for a in tree.arrows() if not a.face and tree.folder_of(a.source) != tree.folder_of(a.target)
              and tree.folder_of(a.target) != tree.PRODUCT]
    assert [f"{a.source}:{a.line} takes {a.name} from {a.target}" for a in inside] == []


@pytest.mark.parametrize("folder", [f for f in tree.folders() if f != tree.PRODUCT])
def test_a_face_says_what_comes_in_and_out_and_has_no_name_that_nobody_uses(folder):
    module = ast.parse(tree.modules()[folder].read_text(encoding="utf-8"))
    sentences = re.split(r"[.:]\s", ast.get_docstring(module) or "")
    assert len(sentences) > 1, "a paragraph on what comes in and what goes out"
    body = [ast.unparse(node) for node in module.body[1:]]
    assert body in ([], ["import lazy_loader", FACE]), "a face loads nothing by itself"
    used = {a.name for a in tree.arrows() if a.face and a.target.startswith(f"{folder}.")
            and tree.folder_of(a.source) != folder}
    assert set(tree.face_of(folder)) - used == set()
    names = Counter(a.name for node in ast.parse(_stub(folder)).body for a in node.names)
    beside = {m.rpartition(".")[2] for m in tree.modules() if m.rpartition(".")[0] == folder}
    assert {n for n, times in names.items() if times > 1} == set()
    assert {n for n in names if n in beside and tree.face_of(folder)[n] != f"{folder}.{n}"} == set()


def _stub(folder):
    path = tree.modules()[folder].with_suffix(".pyi")
    return path.read_text(encoding="utf-8") if path.exists() else ""


def test_every_name_of_a_face_is_there_and_faces_load_nothing_heavy():
    faces = {folder: sorted(tree.face_of(folder)) for folder in tree.folders() if tree.face_of(folder)}
    program = (f"import importlib, sys\nfaces = {faces!r}\nloaded = [importlib.import_module(f) for f in faces]\n"
               f"heavy = sorted({HEAVY!r} & set(sys.modules))\nassert not heavy, heavy\n"
               "assert all(sorted(m.__all__) == faces[m.__name__] for m in loaded)\n"
               "missing = [(m.__name__, n) for m in loaded for n in m.__all__ if not hasattr(m, n)]\n"
               "assert not missing, missing")
    subprocess.run([sys.executable, "-c", program], check=True)


def test_only_slow_imports_stand_inside_a_function():
    heavy = {place: _modules_that_load(HEAVY | more) for place, more in {"": set(), **LATER}.items()}
    cheap = [a for a in tree.arrows() if a.inside
             and a.target not in heavy[next((place for place in LATER if a.source.startswith(place)), "")]]
    assert [f"{a.source}:{a.line} imports {a.target} inside a function" for a in cheap] == []


def _modules_that_load(heavy):
    """Modules that load something heavy when they are imported, themselves or through others."""
    found = {m for m, path in tree.modules().items() if _loads(path) & heavy} | BY_NAME
    above = [a for a in tree.arrows() if not a.inside and not a.typed]
    while more := {a.source for a in above if a.target in found} - found:
        found |= more
    return found


def _loads(path):
    """Third parties that a file imports on its top level."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    names = {a.name for node in body if isinstance(node, ast.Import) for a in node.names}
    return {n.split(".")[0] for n in names | {n.module for n in body if isinstance(n, ast.ImportFrom)}}


PLANTED = {
    "from drivetool.finding import Finding": ("drivetool.finding", False, False),
    "def f():\n    from drivetool.finding import Finding": ("drivetool.finding", True, False),
    "async def f():\n    from drivetool.finding import Finding": ("drivetool.finding", True, False),
    "class A:\n    def f(self):\n        from drivetool.logs import Experiment": (
        "drivetool.logs.experiment", True, False),
    "if TYPE_CHECKING:\n    from drivetool.logs.units import Unit": ("drivetool.logs.units", False, True),
    "from drivetool.logs import units": ("drivetool.logs.units", False, False)}


@pytest.mark.parametrize("source", PLANTED)
def test_every_form_of_an_import_is_an_arrow(tmp_path, source):
    (tmp_path / "a.py").write_text(source)
    [arrow] = tree.arrows_of("drivetool.tune.design", tmp_path / "a.py")
    assert (arrow.target, arrow.inside, arrow.typed) == PLANTED[source]


def test_circles_are_found():
    assert tree.circles({"a": "b", "b": "c", "c": "ad", "d": "e", "e": "", "f": "g", "g": "f"}) == [
        ["a", "b", "c"], ["f", "g"]]
