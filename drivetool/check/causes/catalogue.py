"""The catalogue of what diagnose looks for: every file of this folder that has causes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import MappingProxyType
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.errors import BadOption, nearest

if TYPE_CHECKING:
    from drivetool.drive import Drive
    from drivetool.identify.estimate import Parameter

_FOLDER = __name__.rpartition(".")[0]
_files = (import_module(f"{_FOLDER}.{found.name}") for found in iter_modules([str(Path(__file__).parent)])
          if found.name != Path(__file__).stem)
CAUSES: Mapping[str, Cause] = MappingProxyType({
    cause.code: cause for file in _files for cause in getattr(file, "CAUSES", ())})
FITTED = tuple(cause for cause in CAUSES.values() if not cause.of_record)
# What decides between two causes, in either order.
DECIDES: Mapping[frozenset[str], str] = MappingProxyType({
    frozenset((cause.code, other)): text for cause in CAUSES.values() for other, text in cause.alike.items()})


def chosen_causes(codes: Iterable[str], drive: Drive) -> tuple[str, ...]:
    """The codes as they were asked for, each once; empty stays empty: all of them.

    drive   that may lack the shaft some of them need
    raises  BadOption: a code nobody knows, or none that this drive can have
    """
    found = tuple(dict.fromkeys(codes))
    for code in found:
        if code not in CAUSES:
            raise BadOption("causes of the catalogue after --candidates", f"'{code}'",
                            f"{nearest(code, CAUSES)} See drivetool effects.")
    left = tuple(code for code in found if CAUSES[code].bodies <= len(drive.bodies))
    if found and not left:
        raise BadOption(
            "at least one cause to look for", f"{', '.join(found)}, which the {drive.name} drive cannot have",
            "Name others after --candidates, or leave it out to look for all of them.",
            [code for code, cause in CAUSES.items() if cause.bodies <= len(drive.bodies)])
    return left


def told_sizes(code: str, parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Those of the fitted parameters that say how large a cause is; all where it is not known which."""
    cause = CAUSES.get(code)
    told = [p for size in cause.sizes for p in parameters
            if p.name.endswith(f".{size}") and cause.has(p.name)] if cause else []
    return tuple(told or parameters)


def mistaken_for(codes: Iterable[str]) -> set[str]:
    """Causes that are known to look like one of these."""
    return {other for pair in DECIDES for other in pair if pair & set(codes)}
