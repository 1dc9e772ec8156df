"""The folder of the machine code: permitted owners, candidate places, and the removal of old folders."""

import os
import shutil
import tempfile
import time
import warnings
from pathlib import Path

import llvmlite
import pytest

from drivetool.drive.compile import code_folder, lowered
from drivetool.drive.compile.lowered import SOURCES
from drivetool.errors import DriveToolError, Notice

NAME = code_folder.folder_name()
OTHER_USER = 4711  # another user's id
uncached_folder = code_folder.folder.__wrapped__  # without the cached result


@pytest.fixture
def places(monkeypatch, tmp_path):
    """Candidate places for the code: the requested folder, the user's cache, the temporary files."""
    found = [(tmp_path / name).resolve() for name in ("requested", "cache", "temporary")]
    for place in found:
        place.mkdir(0o700)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(found[0]))
    monkeypatch.setenv("XDG_CACHE_HOME", str(found[1]))
    monkeypatch.setattr(tempfile, "tempdir", str(found[2]))
    return found[0] / NAME, found[1] / "drivetool" / NAME, found[2] / f"drivetool-{os.geteuid()}" / NAME


def owned(monkeypatch, place, user):
    """Make a folder appear to belong to a user."""
    def seen(real):
        def status(path, **more):
            found = real(path, **more)
            same = isinstance(path, (str, Path)) and Path(path) == place
            return os.stat_result((*found[:4], user, *found[5:10])) if same else found

        return status

    monkeypatch.setattr(os, "stat", seen(os.stat))
    monkeypatch.setattr(os, "lstat", seen(os.lstat))


def folder_with_notice(places):
    """The folder in use, after a notice why NUMBA_CACHE_DIR is not used."""
    with pytest.warns(Notice, match=f"NUMBA_CACHE_DIR cannot be used: {places[0].parents[1]}"):
        return uncached_folder()


@pytest.mark.parametrize("mode", [0o770, 0o702, 0o1777], ids=oct)
def test_a_folder_that_others_may_write_to_is_not_used(places, mode):
    places[0].mkdir()
    places[0].chmod(mode)
    assert folder_with_notice(places) == places[1]


@pytest.mark.parametrize("mode, used", [(0o777, 1), (0o770, 1), (0o1777, 0), (0o755, 0)],
                         ids=["all", "group", "all, sticky", "none"])
def test_nor_one_that_others_may_rename(places, mode, used):
    places[0].parent.chmod(mode)
    assert (folder_with_notice(places) if used else uncached_folder()) == places[used]


@pytest.mark.parametrize("level, user, used", [(0, OTHER_USER, 1), (0, 0, 1), (1, OTHER_USER, 1), (1, 0, 0),
                                               (3, OTHER_USER, 2)],
                         ids=["another's", "root's", "in another's", "in root's", "far below another's"])
def test_it_belongs_to_the_user(monkeypatch, places, level, user, used):
    """Those above it may be root's, which may do all things anyway; the third level holds the user's cache too."""
    monkeypatch.setattr(os, "geteuid", lambda: 1234)
    for place in (*places[0].parents, places[0], *places[1].parents, *places[2].parents):
        owned(monkeypatch, place, 1234)
    places[0].mkdir()
    temporary = places[2].parents[1] / "drivetool-1234" / NAME
    for made in (places[1], temporary):
        made.mkdir(parents=True, mode=0o700)
        made.parent.chmod(0o700)
        owned(monkeypatch, made, 1234)
        owned(monkeypatch, made.parent, 1234)
    if level == 3:
        for place in (places[0].parent, places[1].parents[1]):
            owned(monkeypatch, place, user)
        with pytest.warns(UserWarning, match="another user"):
            assert uncached_folder() == temporary
        return
    owned(monkeypatch, [places[0], *places[0].parents][level], user)
    assert (folder_with_notice(places) if used else uncached_folder()) == places[used]


def test_no_link_is_followed_to_it(places, tmp_path):
    """The link could lead to a folder of the user's that holds what another user has made him fetch."""
    (tmp_path / "elsewhere").mkdir(0o700)
    places[0].symlink_to(tmp_path / "elsewhere")
    assert folder_with_notice(places) == places[1]
    assert not any((tmp_path / "elsewhere").iterdir())


def test_a_link_above_it_is_resolved_once(places, tmp_path):
    """So that nobody can change its target between the check and the use."""
    target = places[0].parent.rename((tmp_path / "target").resolve())
    places[0].parent.symlink_to(target)
    assert uncached_folder() == target / NAME


def test_what_is_made_is_private_whatever_the_mask(monkeypatch, places):
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setattr(code_folder, "SOURCES", places[0].parent / "no")
    (places[0].parent / "no").write_text("a file where the sources' folder is wanted")
    before = os.umask(0)
    try:
        place = uncached_folder()
    finally:
        os.umask(before)
    assert place == places[1]
    assert [f.stat().st_mode & 0o777 for f in (place, place.parent)] == [0o700, 0o700]


def blocked(places):
    """Neither the requested folder nor the user's cache can be created."""
    for place in (places[0].parent, places[1].parents[1]):
        place.rmdir()
        place.write_text("a file where a folder is wanted")


def test_where_no_place_takes_it_the_temporary_files_do(places):
    """The folder there remains after the process, and a warning says where it is and what to do."""
    blocked(places)
    for _ in range(2):
        with pytest.warns(UserWarning) as notices:
            assert uncached_folder() == places[2]
        assert len(notices) == 1
        text = str(notices[0].message)
        assert f"kept in {places[2].parent}" in text and f"{places[0].parent} is not a folder" in text
        assert "NUMBA_CACHE_DIR" in text and "XDG_CACHE_HOME" in text and "anew" not in text
        (places[2] / "part.o").touch()
    assert places[2].parent.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("planted", ["link", "open", "file"])
def test_a_folder_planted_there_is_not_used(monkeypatch, places, tmp_path, planted):
    """Its name is known to everybody: then the code is kept for this process only."""
    blocked(places)
    (tmp_path / "elsewhere").mkdir(0o700)
    if planted == "link":
        places[2].parent.symlink_to(tmp_path / "elsewhere")
    elif planted == "open":
        places[2].parent.mkdir()
        places[2].parent.chmod(0o777)
    else:
        places[2].parent.touch()
    mine = []
    monkeypatch.setattr(code_folder, "_temporary", mine)
    with pytest.warns(UserWarning, match=r"anew by every process .*drivetool-\d"):
        place = uncached_folder()
    assert place.parents[1] == places[2].parents[1] and place.parent != places[2].parent
    assert place.name == NAME and place.parent.stat().st_mode & 0o777 == 0o700
    assert not any((tmp_path / "elsewhere").iterdir())
    mine[0].cleanup()
    assert not place.exists()


def test_where_no_file_can_be_written_a_sentence_says_so(monkeypatch, places):
    blocked(places)
    monkeypatch.setattr(tempfile, "tempdir", str(places[0].parent / "nowhere"))
    with pytest.raises(DriveToolError, match="Set NUMBA_CACHE_DIR"):
        uncached_folder()


def test_a_home_that_is_not_known_is_not_made_up(monkeypatch, places, here):
    """'~' stays as it is where there is none: a folder of this name must not appear where the user is."""
    blocked(places)
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    with pytest.warns(UserWarning, match="kept in"):
        assert uncached_folder() == places[2]
    assert not (here / "~").exists()


@pytest.mark.usefixtures("here")
def test_a_relative_folder_stays_where_it_is(monkeypatch, places):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "requested")
    assert uncached_folder() == places[0] and places[0].is_absolute()


# What the code depends on

@pytest.mark.parametrize("name", ["kernel/run.py", "effects/drag.py"])
def test_the_folder_is_named_after_all_compiled_sources(tmp_path, name):
    """A part contains the code that it calls in other files; comments and docstrings are no code."""
    copy = shutil.copytree(SOURCES, tmp_path / "drive", ignore=shutil.ignore_patterns("__pycache__"))
    assert code_folder.folder_name(copy) == NAME
    lowered.source_digest.cache_clear()
    text = (copy / name).read_text()
    (copy / name).write_text(text.replace('"""', '"""More: ', 1) + "\n# a comment\n")
    assert code_folder.folder_name(copy) == NAME
    lowered.source_digest.cache_clear()
    (copy / name).write_text(text + "NAME = 1\n")
    assert code_folder.folder_name(copy) != NAME


def test_and_after_what_emits_it(monkeypatch):
    monkeypatch.setattr(llvmlite, "__version__", "99")
    assert code_folder.folder_name() != NAME


# Cleaning

def folder_of(place, days, marked=True):
    """A folder of machine code that was in use so many days ago."""
    place.mkdir(parents=True, mode=0o700)
    if marked:
        (place / code_folder.MARKER).write_bytes(code_folder.MARKER_CONTENT)
    (place / "run.o").touch()
    os.utime(place, (time.time() - 86400.0 * days,) * 2)
    return place


def test_machine_code_of_old_versions_is_removed(tmp_path):
    """Folders in use within a day stay, and the newest three; so do folders of other tools."""
    for name, days in (("kernel-a", 0.0), ("kernel-b", 0.1), ("kernel-c", 0.2), ("kernel-d", 0.3),
                       ("kernel-e", 2.0), ("kernel-now", 40.0), ("other", 40.0),
                       ("old/kernel-a", 2.0), ("old/kernel-b", 3.0),
                       ("old/kernel-c", 4.0), ("old/kernel-d", 5.0)):
        folder_of(tmp_path / name, days)
    (tmp_path / "old" / "kernel-new").mkdir()
    code_folder.prune(tmp_path / "kernel-now")
    code_folder.prune(tmp_path / "old" / "kernel-new")
    assert {f.name for f in tmp_path.iterdir()} == {*(f"kernel-{k}" for k in "abcd"), "kernel-now", "other", "old"}
    assert {f.name for f in (tmp_path / "old").iterdir()} == {"kernel-a", "kernel-b", "kernel-c", "kernel-new"}


@pytest.fixture
def old(tmp_path):
    """A folder old enough to be removed, if it is marked and nothing else is in it: three are newer."""
    for number in range(code_folder.MAX_OLD_FOLDERS):
        folder_of(tmp_path / f"kernel-newer-{number}", 2.0)
    (tmp_path / "kernel-now").mkdir(0o700)
    return folder_of(tmp_path / "kernel-old", 40.0)


def test_a_folder_that_this_tool_marked_is_one_that_it_removes(places, old):
    place = uncached_folder()
    aside = place.rename(old.parent / "kernel-made")
    os.utime(aside, (0.0, 0.0))
    code_folder.prune(old.parent / "kernel-now")
    assert not aside.exists() and not old.exists()


def test_all_files_of_ours_are_removed_with_it(old):
    """Also the files of a killed compiler."""
    (old / "lock").touch()
    (old / "run.o3fa9.part").touch()
    os.utime(old, (0.0, 0.0))
    code_folder.prune(old.parent / "kernel-now")
    assert not old.exists()


@pytest.mark.parametrize("mark", [None, b"", b"Signature: 8a477f597d28d172789f06886806bc55\n# of another tool\n"],
                         ids=["none", "empty", "another's"])
def test_a_folder_without_the_marker_stays_as_it_is(old, mark):
    (old / code_folder.MARKER).unlink()
    if mark is not None:
        (old / code_folder.MARKER).write_bytes(mark)
    os.utime(old, (0.0, 0.0))
    code_folder.prune(old.parent / "kernel-now")
    assert (old / "run.o").exists()


def test_another_users_folder_stays(monkeypatch, old):
    owned(monkeypatch, old, OTHER_USER)
    code_folder.prune(old.parent / "kernel-now")
    assert (old / "run.o").exists()


def test_links_lead_nowhere(old, tmp_path):
    """Neither one to a marked folder, nor a marker that is one, nor those inside a folder that is removed."""
    target = folder_of(tmp_path / "elsewhere" / "target", 40.0)
    (tmp_path / "kernel-link").symlink_to(target)
    fooled = folder_of(tmp_path / "kernel-fooled", 40.0, marked=False)
    (fooled / code_folder.MARKER).symlink_to(target / code_folder.MARKER)
    (old / "link").symlink_to(target)
    (old / "file.o").symlink_to(target / "run.o")
    os.utime(fooled, (0.0, 0.0))
    os.utime(old, (0.0, 0.0))
    code_folder.prune(tmp_path / "kernel-now")
    assert {f.name for f in target.iterdir()} == {"run.o", code_folder.MARKER}
    assert (tmp_path / "kernel-link").is_symlink() and (fooled / "run.o").exists()
    assert {f.name for f in old.iterdir()} == {"link", "file.o", code_folder.MARKER}


@pytest.mark.parametrize("name", ["notes.txt", "records/run.o"])
def test_a_file_of_somebody_else_is_never_removed(old, name):
    (old / name).parent.mkdir(exist_ok=True)
    (old / name).touch()
    os.utime(old, (0.0, 0.0))
    code_folder.prune(old.parent / "kernel-now")
    assert (old / name).exists() and not (old / "run.o").exists()


def test_a_file_that_cannot_be_finished_leaves_nothing(monkeypatch, tmp_path):
    (tmp_path / "run.o").write_bytes(b"before")

    def full(*_):
        raise OSError("no room")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="no room"):
        code_folder.write_whole(tmp_path / "run.o", b"after")
    assert [f.name for f in tmp_path.iterdir()] == ["run.o"] and (tmp_path / "run.o").read_bytes() == b"before"


def test_no_notice_where_all_is_well(places):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert uncached_folder() == places[0]
