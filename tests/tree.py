"""The product's tree as its imports show it: modules, folders, arrows, and what a folder lets others use.

An import inside a function is an arrow like any other. A name that is taken from a folder's face is an arrow to the
module that the face takes it from.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent / "drivetool"
PRODUCT = "drivetool"
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


@dataclass(frozen=True)
class Arrow:
    """A name that a module imports from another.

    inside  a function; typed: for types alone; face: taken from the face of the other's folder
    """

    source: str
    target: str
    name: str
    inside: bool
    typed: bool
    face: bool
    line: int


@cache
def modules() -> dict[str, Path]:
    """Dotted name of each module, with its file; a folder's own is the name of the folder."""
    return {_dotted(path): path for path in sorted(ROOT.rglob("*.py"))}


def _dotted(path: Path) -> str:
    parts = (PRODUCT, *path.relative_to(ROOT).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def folders() -> list[str]:
    """Dotted names of the folders."""
    return [name for name, path in modules().items() if path.name == "__init__.py"]


def folder_of(module: str) -> str:
    """The folder in which a module lies; that of a folder's own file is the folder."""
    return module if modules()[module].name == "__init__.py" else module.rpartition(".")[0]


@cache
def face_of(folder: str) -> dict[str, str]:
    """What a folder lets others use: name -> module that it is taken from, by the stub beside its own file."""
    stub = modules()[folder].with_suffix(".pyi")
    if not stub.exists():
        return {}
    return {a.name: f"{folder}.{node.module or a.name}" for node in ast.parse(stub.read_text(encoding="utf-8")).body
            for a in node.names}


@cache
def arrows() -> tuple[Arrow, ...]:
    """Every import of the product's own, from each of its modules."""
    return tuple(arrow for name, path in modules().items() for arrow in arrows_of(name, path))


def arrows_of(source: str, path: Path) -> Iterator[Arrow]:
    """The imports of one file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = [node for node in ast.walk(tree) if isinstance(node, FUNCTIONS)]
    within = {id(node) for function in functions for node in ast.walk(function)}
    blocks = [node for node in ast.walk(tree) if isinstance(node, ast.If)]
    typed = {id(node) for block in blocks if ast.unparse(block.test) == "TYPE_CHECKING" for node in ast.walk(block)}
    for node in ast.walk(tree):
        if not (isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == PRODUCT):
            continue
        for a in node.names:
            face = face_of(node.module).get(a.name) if node.module in folders() else None
            whole = f"{node.module}.{a.name}"
            target = face or (whole if whole in modules() else node.module)
            yield Arrow(source, target, a.name, inside=id(node) in within, typed=id(node) in typed,
                        face=face is not None, line=node.lineno)


def circles(graph: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """Strongly connected components of more than one node, each sorted (Tarjan 1972)."""
    index: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = lowest[node] = len(index)
        stack.append(node)
        for other in graph.get(node, ()):
            if other not in index:
                visit(other)
            if other in stack:
                lowest[node] = min(lowest[node], lowest[other])
        if lowest[node] == index[node]:
            at = stack.index(node)
            if len(stack) - at > 1:
                found.append(sorted(stack[at:]))
            del stack[at:]

    for node in graph:
        if node not in index:
            visit(node)
    return found


def graph_of(node_of: Callable[[str], str | None], among: Iterable[Arrow]) -> dict[str, set[str]]:
    """The graph of what modules are parts of; None: of nothing in it."""
    graph: dict[str, set[str]] = {}
    for arrow in among:
        a, b = node_of(arrow.source), node_of(arrow.target)
        if a is not None and b is not None:
            graph.setdefault(a, set())
            graph.setdefault(b, set())
            if a != b:
                graph[a].add(b)
    return graph


def child_of(parent: str) -> Callable[[str], str | None]:
    """The part of a folder in which a module lies: a folder in it, or itself for the files beside these."""
    def node(module: str) -> str | None:
        if module != parent and not module.startswith(f"{parent}."):
            return None
        folder = folder_of(module)
        return folder if folder == parent else ".".join(folder.split(".")[:parent.count(".") + 2])
    return node
