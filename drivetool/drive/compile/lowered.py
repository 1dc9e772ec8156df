"""The kernel as LLVM text, made when it is packaged: a fresh machine optimises and emits it, and needs no Numba.

Numba's share of a compilation is two thirds, and its result does not depend on the processor. The text bears a
digest of the sources, so that it is not used with others.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import lzma
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

# The compiled sources are below this folder.
SOURCES = Path(importlib.util.find_spec("drivetool.drive").submodule_search_locations[0])
# Each archive is decompressed as a whole: one for drives without smooth laws, one for the others.
ARCHIVES = ("kernel.xz", "laws.xz")
# Docstrings, comments and blank lines.
NO_CODE = re.compile(r'^\s*(?:"""(?:.|\n)*?"""|#.*)?$\n?', re.MULTILINE)


@cache
def source_digest(sources: Path = SOURCES) -> str:
    """Digest of the code that is compiled, without its docstrings, comments and blank lines."""
    files = [sources / "compile" / f"{name}.py" for name in ("compiled", "views", "numba_private")]
    files += [f for name in ("kernel", "arrays") for f in sorted((sources / name).glob("*.py"))]
    effects = [(f, f.read_text(encoding="utf-8")) for f in sorted((sources / "effects").glob("*.py"))]
    # Of the effects the laws are compiled, by their place in the catalogue.
    texts = [text for f, text in effects if "def torque(" in text or f.name == "catalogue.py"]
    texts += [f.read_text(encoding="utf-8") for f in files]
    return hashlib.sha256(NO_CODE.sub("", "\n".join(texts)).encode()).hexdigest()


def text_of(part: str) -> str | None:
    """The LLVM text of a part; None if there is none, or only of other sources."""
    return next((texts[part] for name in ARCHIVES if part in (texts := archive(SOURCES / "kernel" / name))),
                None)


@cache
def archive(file: Path) -> Mapping[str, str]:
    """Part -> text of an intact archive of these sources, else empty."""
    try:
        digest, texts = json.loads(lzma.decompress(file.read_bytes()))
    except (OSError, EOFError, lzma.LZMAError, ValueError):
        return {}
    return texts if digest == source_digest() else {}


def write_archive(file: Path, texts: Mapping[str, str]) -> None:
    """Store the texts of parts, in their order."""
    content = json.dumps((source_digest(), dict(texts))).encode()
    file.write_bytes(lzma.compress(content, preset=9 | lzma.PRESET_EXTREME))
