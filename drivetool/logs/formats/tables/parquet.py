"""Parquet: a table with a column per channel, or one row per value; a file or a folder of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from drivetool.errors import BadRecording
from drivetool.finding import Finding
from drivetool.logs import ROLES, Channel, Recording, display_name, natural_order
from drivetool.logs.channels import ChannelMap, Choose, TimeEntry, resolve_channel
from drivetool.logs.formats.tables.columns import column_numbers, column_path, flat_names, unit_of
from drivetool.logs.formats.tables.long_table import is_long, read_long
from drivetool.logs.formats.tables.table_time import from_step, origin_of, table_time, time_column


def read_parquet(path: Path, choose: Choose, channel_map: ChannelMap | None,
                 lenient: bool = False) -> Recording:
    """A Parquet table, or the folder of its parts; only the requested columns are read.

    choose   called with the names of all columns but the time (long: of all channels); returns those
             to read
    lenient  leave out columns that hold no numbers instead of refusing them
    returns  Recording. Wide: on one clock, the time column (named in the map, or time, t, timestamp and
             the like, which may end in _s, _ms, _us or _ns), or the schema metadata `step` [s] if there
             is no such column. Long: every channel on its own clock
    raises   BadRecording: not Parquet, no rows, no time, columns that hold no numbers
    """
    with ExitStack() as stack:
        files, findings = _open_parts(path, stack)
        schema, repeated = _unique_columns(files[0].schema_arrow, display_name(path))
        if all(file.metadata.num_rows == 0 for file in files):
            raise BadRecording(f"samples in {display_name(path)}", "a table without rows",
                               "Record or export it again.")
        if is_long(schema, channel_map):
            tables = _read_tables(files, None, display_name(path), findings)
            return read_long(tables, schema, display_name(path), choose, channel_map, findings, lenient)
        stamps = _clock_columns(schema, channel_map, display_name(path))
        names = flat_names(schema, [each for each in stamps.values() if each])
        if channel_map:
            mapped = [entry.channel for entry in channel_map.roles.values()]
            names |= {text: steps for text in mapped if text not in names for steps in [column_path(text, schema)]
                      if steps}
        if not lenient:
            _refuse_repeated(repeated, channel_map, display_name(path))
        wanted = list(dict.fromkeys(choose(list(names))))
        clocks = [column_path(each, schema)[0] for each in stamps.values() if each]
        columns = list(dict.fromkeys([*clocks, *(names[name][0] for name in wanted)]))
        unreadable = {name: f"{count} columns have this name" for name, count in repeated.items()}
        lost: list[Finding] = []
        tables = _read_tables(files, columns, display_name(path), lost, lenient)
        if lost and lenient:
            # One damaged column must not cost the rows of the others.
            columns = [*clocks, *_undamaged_columns(files, columns[len(set(clocks)):], unreadable)]
            wanted, lost = [name for name in wanted if names[name][0] in columns], []
            tables = _read_tables(files, columns, display_name(path), lost)
        findings += lost
    return _recording(tables, schema, wanted, names, stamps, channel_map, display_name(path), findings,
                      unreadable if lenient else None)


def _unique_columns(schema: pa.Schema, log: str) -> tuple[pa.Schema, dict[str, int]]:
    """(the columns whose name is theirs alone; how many columns have each of the other names).

    raises  BadRecording: there is no such column
    """
    counts = Counter(schema.names)
    kept = [field for field in schema if counts[field.name] == 1]
    if schema.names and not kept:
        raise BadRecording(f"columns with names of their own in {log}", f"{len(schema.names)} columns that share "
                           f"{', '.join(counts)}", "Export it with a name for each column.")
    return pa.schema(kept, schema.metadata), {name: count for name, count in counts.items() if count > 1}


def _refuse_repeated(repeated: Mapping[str, int], channel_map: ChannelMap | None, log: str) -> None:
    """A role must not depend on which of several columns of one name is meant."""
    mapped = [entry.channel for entry in channel_map.roles.values()] if channel_map else ROLES
    for name in mapped:
        if name in repeated:
            raise BadRecording(f"one column '{name}' in {log}", f"{repeated[name]}",
                               "Rename one of them, or leave it out when exporting.")


def _open_parts(path: Path, stack: ExitStack) -> tuple[list[pq.ParquetFile], list[Finding]]:
    """(the file, or those of the folder that can be read; what cannot be)."""
    parts = sorted(path.rglob("*.parquet"), key=natural_order) if path.is_dir() else [path]
    files, broken, reason = [], [], ""
    for part in parts:
        try:
            file = stack.enter_context(pq.ParquetFile(part, page_checksum_verification=True))
            _ = file.schema_arrow.names, file.schema_arrow.metadata  # names that are no text fail here
            files.append(file)
        except (pa.ArrowException, OSError, ValueError) as problem:
            broken.append(part.name)
            reason = str(problem).splitlines()[0].split(". ")[0][:100]
    if not files:
        raise BadRecording(
            f"Parquet files in the folder {display_name(path)}" if path.is_dir()
            else f"a Parquet file in {display_name(path)}",
            f"something else ({reason})" if reason else "none",
            "Record or export it again; a half-written Parquet file cannot be read.")
    first = files[0].schema_arrow
    for part, file in zip([p for p in parts if p.name not in broken], files, strict=False):
        if set(file.schema_arrow.names) != set(first.names):
            raise BadRecording(f"the same columns in all files of {display_name(path)}",
                               f"{', '.join(file.schema_arrow.names)} in {part.name}",
                               "Put recordings of different kinds into different folders.", first.names)
    findings = [Finding("warning", "log-damaged",
                        f"{', '.join(broken)} of {display_name(path)} cannot be read ({reason}); the other "
                        f"{len(files)} files are used.", {"files": len(broken), "of": len(parts)},
                        "Record or export it again.")] if broken else []
    return files, findings


def _read_tables(files: Sequence[pq.ParquetFile], columns: list[str] | None, log: str,
                 findings: list[Finding], lenient: bool = False) -> list[pa.Table]:
    """The columns of every file, files without rows left out; damaged row groups are left out and reported.

    raises  BadRecording: nothing is left, unless lenient
    """
    tables, lost, groups, problem = [], 0, 0, ""
    for file in files:
        try:
            tables.append(file.read(columns=columns))
            continue
        except (pa.ArrowException, OSError, ValueError) as damage:
            problem = str(damage)[:100]
        groups += file.num_row_groups
        for i in range(file.num_row_groups):
            try:
                tables.append(file.read_row_group(i, columns=columns))
            except (pa.ArrowException, OSError, ValueError):
                lost += 1
    if lost:
        findings.append(Finding(
            "warning", "log-damaged", f"{lost} row groups of {log} are damaged ({problem}); the others are used.",
            {"groups": lost, "of": groups}, "Record or export it again."))
    whole = [table for table in tables if not set(columns or ()) - set(table.column_names)]
    if len(whole) < len(tables):
        tables, problem = whole, "names of columns that do not agree"
    if not tables and not lenient:
        raise BadRecording(f"readable data in {log}", problem,
                           "The file is damaged; record or export it again.")
    return [table for table in tables if table.num_rows] or tables[:1]


def _undamaged_columns(files: Sequence[pq.ParquetFile], columns: list[str],
                       unreadable: dict[str, str]) -> list[str]:
    """The columns without damage; the others and why go into `unreadable`."""
    for file in files:
        for column in columns:
            try:
                file.read(columns=[column])
            except (pa.ArrowException, OSError, ValueError) as damage:
                unreadable[column] = f"damaged ({str(damage)[:60]})"
    return [column for column in columns if column not in unreadable]


def _clock_columns(schema: pa.Schema, channel_map: ChannelMap | None,
                   log: str) -> dict[TimeEntry | None, str | None]:
    """Clock entry -> its column; None is the clock of all that have none of their own."""
    stamps = {None: time_column(schema, channel_map.time if channel_map else None, log)}
    for entry in channel_map.roles.values() if channel_map else ():
        if entry.clock:
            stamps[entry.clock] = time_column(schema, entry.clock, log)
    return stamps


def _recording(tables: list[pa.Table], schema: pa.Schema, wanted: list[str], names: dict, stamps: dict,
               channel_map: ChannelMap | None, log: str, findings: list[Finding],
               unreadable: dict[str, str] | None) -> Recording:
    """Columns as channels, the parts in the order of their first stamps.

    unreadable  collects columns that hold no numbers; None: they are refused
    """
    if len(tables) > 1 and stamps[None]:
        firsts = [_first_stamp(table_time(each, stamps[None], schema, channel_map and channel_map.time, log))
                  for each in tables]
        tables = [tables[i] for i in np.argsort(firsts, kind="stable")]
    table = pa.concat_tables(tables, promote_options="permissive")
    clocks = {}
    for entry, column in stamps.items():
        given = entry or (channel_map.time if channel_map else None)
        clocks[entry] = table_time(table, column, schema, given, log) if column else \
            (from_step(schema, table.num_rows, log), origin_of(schema))
    own = {}
    for entry in channel_map.roles.values() if channel_map else ():
        name = resolve_channel(entry.channel, names) if entry.clock else None
        if name:
            own[name] = entry.clock
    origin = clocks[None][1]
    times = {entry: seconds + (start - origin) if entry else seconds
             for entry, (seconds, start) in clocks.items()}
    channels = {}
    for name in wanted:
        try:
            values = column_numbers(table, names[name], name, log)
        except BadRecording as problem:
            if unreadable is None:
                raise
            unreadable[name] = problem.found.removesuffix(f" in {log}")
            continue
        channels[name] = Channel(times[own.get(name)], values, unit_of(schema, names[name]))
    return Recording(log, "", channels, tuple(findings), origin, unreadable or {})


def _first_stamp(clock: tuple[np.ndarray, float]) -> float:
    """The first stamp of a clock that is one."""
    seconds, origin = clock
    known = seconds[np.isfinite(seconds)]
    return origin + float(known[0]) if len(known) else np.inf
