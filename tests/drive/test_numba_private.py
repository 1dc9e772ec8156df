"""Numba's internals that the kernel uses exist unchanged: Numba does not announce changes of them."""

import ast
import importlib
import inspect
import re
from pathlib import Path

import numba
import pytest

from drivetool.drive.compile import numba_private

ROOT = Path(__file__).parents[2] / "drivetool"
ADAPTER = Path(numba_private.__file__)
# Name -> parameters, or None if it is no function.
USED = {
    # patched: the work of each function is deferred to the end
    "numba.core.codegen:CPUCodeLibrary._optimize_final_module": "self",
    "numba.core.codegen:JITCodeLibrary._finalize_specific": "self",
    "numba.core.codegen:JITCodeLibrary.get_pointer_to_function": "self name",
    "numba.core.codegen:JITCPUCodegen.set_env": "self env_name env",
    "numba.core.codegen:JITCodeLibrary._ensure_finalized": "self",
    # arrays that do not overlap
    "numba.core.compiler:Compiler.__init__": "self typingctx targetctx library args return_type flags locals",
    "numba.core.compiler:Flags.noalias": None,
    # options of njit that its manual does not list, and the flags that they set
    "numba.core.options:DefaultOptions._nrt": None,
    "numba.core.options:DefaultOptions.no_cpython_wrapper": None,
    "numba.core.options:DefaultOptions.no_cfunc_wrapper": None,
    "numba.core.options:DefaultOptions.forceinline": None,
    "numba.core.compiler:Flags.nrt": None,
    "numba.core.compiler:Flags.no_cpython_wrapper": None,
    "numba.core.compiler:Flags.no_cfunc_wrapper": None,
    "numba.core.compiler:Flags.forceinline": None,
    # code of intrinsics
    "numba.core.base:BaseContext.get_value_type": "self ty",
    "numba.core.base:BaseContext.get_dummy_value": "self",
    "numba.core.base:BaseContext.make_array": "self typ",
    "numba.core.base:BaseContext.make_tuple": "self builder typ values",
    "numba.core.cgutils:unpack_tuple": "builder tup count",
    "numba.np.arrayobj:populate_array": "array data shape strides itemsize meminfo parent",
    "numba.core.cgutils:_StructProxy._getvalue": "self",
    # attributes of a type
    "numba.core.typing.templates:AttributeTemplate.__init__": "self context",
    "numba.core.typing.templates:AttributeTemplate.generic_resolve": None,
    # in numba.extending, and not in the manual
    "numba.extending:infer_getattr": "item",
    "numba.extending:lower_getattr_generic": "ty",
    "numba.extending:models.OpaqueModel.__init__": "self dmm fe_type",
    "numba.extending:models.PrimitiveModel.__init__": "self dmm fe_type be_type",
}


def interface_change(name: str, parameters: str | None) -> str:
    """How the installed Numba differs from what the kernel relies on, as a sentence; empty if it does not."""
    module, _, path = name.partition(":")
    do = f"Put it right in {ADAPTER.name}, or keep Numba below {numba.__version__} in pyproject.toml."
    try:
        found = importlib.import_module(module)
        for part in path.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError):
        return f"Numba {numba.__version__} has no {module}.{path}, which the kernel uses. {do}"
    if parameters is not None and (now := " ".join(inspect.signature(found).parameters)) != parameters:
        return (f"{module}.{path} of Numba {numba.__version__} takes ({now}), where the kernel counts on "
                f"({parameters}). {do}")
    return ""


@pytest.mark.parametrize("name", USED)
def test_numba_has_what_the_kernel_uses(name):
    assert not interface_change(name, USED[name])


@pytest.mark.parametrize("name, parameters, sentence", [
    ("numba.core.codegen:CPUCodeLibrary._optimise", "self",
     r"Numba \S+ has no numba.core.codegen.CPUCodeLibrary._optimise, which the kernel uses. Put it right"),
    ("numba.gone:anything", None, r"Numba \S+ has no numba.gone.anything"),
    ("numba.core.cgutils:unpack_tuple", "builder values",
     r"takes \(builder tup count\), where .* \(builder values\)")])
def test_a_changed_interface_is_reported(name, parameters, sentence):
    assert re.search(sentence, interface_change(name, parameters))


def names_of(path):
    """(modules that a file imports from, attributes that it takes of something by name)."""
    tree = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    modules = {a.name for node in tree if isinstance(node, ast.Import) for a in node.names}
    modules |= {node.module for node in tree if isinstance(node, ast.ImportFrom)}
    return modules, {(node.value.id, node.attr) for node in tree
                     if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)}


@pytest.mark.parametrize("path", sorted(set(ROOT.rglob("*.py")) - {ADAPTER}), ids=lambda path: path.stem)
def test_nobody_else_looks_inside_numba(path):
    modules, attributes = names_of(path)
    assert {m for m in modules if m.split(".")[0] == "numba"} <= {"numba", "numba.extending"}
    assert not {attribute for owner, attribute in attributes if owner in ("context", "cgutils", "arrayobj")}
    assert not {attribute for owner, attribute in attributes if owner == "numba"} - {"njit", "cfunc"}


def test_only_what_is_compiled_imports_numba():
    """And what compiles it: with the text that comes with the sources nothing needs Numba."""
    found = {path.relative_to(ROOT / "drive").as_posix() for path in ROOT.rglob("*.py")
             if any(m and m.split(".")[0] == "numba" for m in names_of(path)[0])}
    outside = {name for name in found if not name.startswith("kernel/")}
    assert outside == {f"compile/{name}.py" for name in ("compiled", "numba_private", "views")}


def test_all_that_the_adapter_takes_is_named_here():
    """Except the fields of an array, data and shape."""
    _, attributes = names_of(ADAPTER)
    named = {part for name in USED for part in name.partition(":")[2].split(".")}
    taken = {attribute for owner, attribute in attributes
             if owner in ("codegen", "context", "cgutils", "library", "array", "flags")}
    assert taken and not taken - named - {"data", "shape"}
