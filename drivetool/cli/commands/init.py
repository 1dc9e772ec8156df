"""A first site file for batch, with comments, from what inspect sees in some recordings."""

from __future__ import annotations

import glob
import os
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivetool.cli.options import common as cli
from drivetool.cli.output import DONE, say, write_stdout
from drivetool.errors import BadOption, DriveToolError
from drivetool.files.disk import check_target, write_whole

if TYPE_CHECKING:
    from drivetool.site.plan import RecordingGroup

EXAMPLE = "drivetool init logs --out site.yaml"

Logs = Annotated[list[str], typer.Argument(
    metavar="LOG", help="Recordings, Parquet or MCAP, or folders that have some in or below them.")]
Out = Annotated[str, typer.Option(
    "--out", "-o", metavar="FILE", help="Where the site file goes; - is standard output. One that is there stays.")]


def command(logs: Logs, out: Out = "site.yaml", debug: cli.Debug = False, quiet: cli.Quiet = False) -> int:
    """Its options; the exit code."""
    from drivetool.site.plan import first_site

    if out != "-":
        check_target(out)
        if os.path.exists(out):
            raise BadOption("a file that is not there yet, to write a site file", out,
                            "Give another name with --out; an existing site file is never overwritten.")
    folder = Path.cwd() if out == "-" else Path(os.path.abspath(out)).parent
    text = first_site(_recording_groups(_recordings(logs), folder))
    if out == "-":
        write_stdout(text)
        return DONE
    write_whole(out, text)
    if not quiet:
        say("init", f"wrote {out}; look at it, then run: drivetool batch {out}")
    return DONE


def _recordings(logs: list[str]) -> list[Path]:
    """The recordings, those of folders in all folders below."""
    from drivetool.files.disk import RECORDING_SUFFIXES
    from drivetool.logs import natural_order
    from drivetool.site.plan import is_recording

    found: list[Path] = []
    for log in map(Path, logs):
        below = [p for p in (log.rglob("*") if log.is_dir() else [log]) if is_recording(p, log)]
        if not below:
            raise BadOption(f"recordings ({', '.join(RECORDING_SUFFIXES)})",
                            f"none in {log}" if log.exists() else f"no file or folder {log}", "Correct the path.")
        found += sorted(below, key=natural_order)
    return list(dict.fromkeys(found))


def _recording_groups(paths: list[Path], folder: Path) -> list[RecordingGroup]:
    """The recordings in groups of one kind and suffix, the more special names first."""
    from drivetool.site.plan import kinds_of

    kinds = kinds_of([path.stem for path in paths])
    groups: dict[tuple[str, str, str], list[Path]] = {}
    for path in paths:
        groups.setdefault((*kinds[path.stem], path.suffix), []).append(path)
    root = os.path.relpath(os.path.commonpath([os.path.abspath(path.parent) for path in paths]), folder)
    ordered = sorted(groups, key=lambda group: (-len(group[0]), group))
    return [_group_summary(kind, Path(glob.escape(root), "**", f"{words}{suffix}").as_posix(),
                           groups[kind, words, suffix])
            for kind, words, suffix in ordered]


def _group_summary(kind: str, pattern: str, paths: list[Path]) -> RecordingGroup:
    """What is said of a group, its first recording standing for all."""
    from drivetool.identify.plateaus import find_intervals
    from drivetool.logs.door import inspect_log
    from drivetool.logs.formats import read_header
    from drivetool.site.plan import RecordingGroup

    example, channels, usable, steady = paths[0], [], False, False
    try:
        found = inspect_log(example)
        channels = [f"{c.name} [{c.unit or '?'}]" for c in found.channels]
        usable = found.experiment is not None
        steady = usable and bool(find_intervals(found.experiment))  # of constant speed
    except DriveToolError:  # the steps report the error; the file can be written all the same
        pass
    folders = Counter(path.resolve().parent.name for path in paths)
    return RecordingGroup(kind, pattern, example.name, channels, usable, steady, len(paths), sorted(folders),
                max(folders.values()) > 1, sorted(read_header(example).metadata))
