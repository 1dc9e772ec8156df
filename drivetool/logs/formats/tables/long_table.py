"""Tables with one row per value: a column with the channel's name, the time and the value."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from drivetool.errors import BadRecording
from drivetool.finding import Finding
from drivetool.logs import Channel, Recording
from drivetool.logs.channels import ChannelMap, Choose
from drivetool.logs.formats.tables.columns import column_numbers
from drivetool.logs.formats.tables.table_time import table_time, time_column

CHANNEL_NAMES = ("channel", "signal", "name", "variable", "tag", "topic", "parameter")
VALUE_NAMES = ("value", "values", "data")
UNIT_NAMES = ("unit", "units")


def is_long(schema: pa.Schema, channel_map: ChannelMap | None) -> bool:
    """Whether a table has one row per value: texts under a name for channels, and one column of values.

    A map that names columns of the table means them, whatever they are called.
    """
    if channel_map and any(entry.channel in schema.names for entry in channel_map.roles.values()):
        return False
    channel, value = _find_column(schema, CHANNEL_NAMES), _find_column(schema, VALUE_NAMES)
    if channel is None or value is None:
        return False
    kind = schema.field(channel).type
    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind)


def read_long(tables: list[pa.Table], schema: pa.Schema, log: str, choose: Choose,
              channel_map: ChannelMap | None, findings: list[Finding], lenient: bool = False) -> Recording:
    """The channels of a long table, each on its own clock; rows of one channel in their order.

    A column called `unit` gives the units.

    lenient  leave out what cannot be read instead of refusing it
    raises   BadRecording: no time column, values that are no numbers, a role with a clock of its own, a channel
             in several units
    """
    own = [role for role, entry in (channel_map.roles if channel_map else {}).items() if entry.clock]
    if own:
        raise BadRecording(f"one time column for all channels of {log}, which has a row per value",
                           f"`time` at {', '.join(own)} in the channel map", "Leave it out there.")
    table = pa.concat_tables(tables, promote_options="permissive")
    stamp = time_column(schema, channel_map.time if channel_map else None, log)
    if stamp is None:
        raise BadRecording(f"a time column in {log}", f"columns {', '.join(schema.names)}",
                           "Name it with `time: {channel: ..., unit: ...}` in the channel map.")
    names, codes = _dictionary_codes(table, _find_column(schema, CHANNEL_NAMES))
    time, origin = table_time(table, stamp, schema, channel_map.time if channel_map else None, log)
    values = column_numbers(table, (_find_column(schema, VALUE_NAMES),), "value", log)
    unit_column = _find_column(schema, UNIT_NAMES)
    units, unit_codes = _dictionary_codes(table, unit_column) if unit_column \
        else ([None], np.zeros(len(codes), int))
    order = np.argsort(codes, kind="stable")
    edges = np.searchsorted(codes[order], np.arange(len(names) + 1))
    wanted = list(dict.fromkeys(choose([name for name in names if name is not None])))
    channels: dict[str, Channel] = {}
    unreadable: dict[str, str] = {}
    for name in wanted:
        code = names.index(name)
        rows = order[edges[code]:edges[code + 1]]
        given = [units[each] for each in np.unique(unit_codes[rows])]
        if len(given) > 1:
            found = f"it comes in several units ({', '.join(str(unit or 'none') for unit in given)})"
            if not lenient:
                raise BadRecording(f"one unit of channel '{name}' in {log}", found,
                                   "Give the values in each unit a channel of their own.")
            unreadable[name] = found
            continue
        unit = given[0] if given else None
        own = next((c.time for c in channels.values() if np.array_equal(c.time, time[rows], equal_nan=True)),
                   None)
        channels[name] = Channel(time[rows] if own is None else own, values[rows], unit)
    return Recording(log, "", channels, tuple(findings), origin, unreadable)


def _find_column(schema: pa.Schema, known: tuple[str, ...]) -> str | None:
    """The column with one of the names."""
    return next((name for wanted in known for name in schema.names if name.strip().lower() == wanted), None)


def _dictionary_codes(table: pa.Table, column: str) -> tuple[list[str | None], np.ndarray]:
    """(texts, (n,) which of them each row has); rows without a text have the last code."""
    encoded = table.column(column)
    if not pa.types.is_dictionary(encoded.type):
        encoded = encoded.dictionary_encode()
    encoded = encoded.unify_dictionaries().combine_chunks()
    if isinstance(encoded, pa.ChunkedArray):
        encoded = encoded.chunk(0)
    texts = encoded.dictionary.to_pylist()
    codes = encoded.indices.fill_null(len(texts)) if encoded.null_count else encoded.indices
    return [*texts, None], np.asarray(codes.to_numpy(zero_copy_only=False), np.int64)
