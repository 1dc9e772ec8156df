"""The catalogue of causes of diagnose: every file of this folder that has causes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import MappingProxyType
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.errors import BadOption, nearest
from drivetool.quantity import quantity_of

if TYPE_CHECKING:
    from drivetool.drive import Drive
    from drivetool.identify.estimate import Parameter

_FOLDER = __name__.rpartition(".")[0]
_files = (import_module(f"{_FOLDER}.{found.name}") for found in iter_modules([str(Path(__file__).parent)])
          if found.name != Path(__file__).stem)
CAUSES: Mapping[str, Cause] = MappingProxyType({
    cause.code: cause for file in _files for cause in getattr(file, "CAUSES", ())})
FITTED = tuple(cause for cause in CAUSES.values() if not cause.of_record)
# The experiment that decides between two causes, in either order.
DECISIVE_EXPERIMENTS: Mapping[frozenset[str], str] = MappingProxyType({
    frozenset((cause.code, other)): text for cause in CAUSES.values() for other, text in cause.alike.items()})


def chosen_causes(codes: Iterable[str], drive: Drive) -> tuple[str, ...]:
    """The codes as requested, each once; empty stays empty: all of them.

    drive   that may lack the shaft some of them need
    raises  BadOption: an unknown code, or none that this drive can have
    """
    found = tuple(dict.fromkeys(codes))
    for code in found:
        if code not in CAUSES:
            raise BadOption("causes of the catalogue after --candidates", f"'{code}'",
                            f"{nearest(code, CAUSES)} See drivetool effects.")
    possible = tuple(code for code in found if CAUSES[code].bodies <= len(drive.bodies))
    if found and not possible:
        raise BadOption(
            "at least one cause to look for", f"{', '.join(found)}, which the {drive.name} drive cannot have",
            "Name others after --candidates, or leave it out to look for all of them.",
            [code for code, cause in CAUSES.items() if cause.bodies <= len(drive.bodies)])
    return possible


def size_parameters(code: str, parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """The fitted parameters that give the size of a cause; all for a code outside the catalogue."""
    cause = CAUSES.get(code)
    sizes = [p for size in cause.sizes for p in parameters
            if quantity_of(p.name) == size and cause.has(p.name)] if cause else []
    return tuple(sizes or parameters)


def mistaken_for(codes: Iterable[str]) -> set[str]:
    """Causes that are known look-alikes of one of these."""
    return {other for pair in DECISIVE_EXPERIMENTS for other in pair if pair & set(codes)}
