"""Compiled functions that are cached between calls: loaded if they are intact, else recompiled."""

import os
import shutil

import pytest

from drivetool.drive.compile import numba_private
from drivetool.drive.compile.numba_private import cached_in_folder


def twice(x):
    return 2.0 * x


def thrice(x):
    return 3.0 * x


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setattr(numba_private, "folder", lambda: tmp_path)
    return tmp_path


def called(function):
    """Result of a fresh dispatcher, and whether it was loaded."""
    compiled = cached_in_folder(function)
    result = compiled(1.5)
    return result, sum(compiled.stats.cache_hits.values()) == 1


def file_of(place, function):
    return next(place.rglob(f"*{function.__name__}*.code"))


def cut(file):
    file.write_bytes(file.read_bytes()[:-1])


def empty(file):
    file.write_bytes(b"")


def flip(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def pipe(file):
    file.unlink()
    os.mkfifo(file)


def another(file):
    called(thrice)
    shutil.copy(file_of(file.parent, thrice), file)


def test_code_is_loaded_and_nothing_else_is_written(place):
    assert called(twice) == (3.0, False)
    assert called(twice) == (3.0, True)
    assert [f.suffix for f in place.rglob("*") if f.is_file()] == [".code"]


@pytest.mark.parametrize("damage", [cut, empty, flip, pipe, another])
def test_a_damaged_file_is_compiled_anew_once(place, damage):
    called(twice)
    damage(file_of(place, twice))
    assert called(twice) == (3.0, False)
    assert called(twice) == (3.0, True)
