"""Where two Parquet tables differ."""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from tests.golden.masks import COSTS, Masks
from tests.golden.shown import relative, short


def tables(name: str, old: bytes, new: bytes, masks: Masks) -> list[str]:
    """What differs: names, order, types and metadata of columns, and every value; of a cost, whether it is."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        before, after = (pq.read_table(io.BytesIO(each)) for each in (old, new))
    except pa.ArrowInvalid:
        return [] if old == new else [f"bytes differ: {len(old)} before, {len(new)} now"]
    # Only a summary has costs; another file may well have seconds.
    costs = [each for each in COSTS if Path(name).name == "summary.parquet" and each in before.column_names]
    count = masks.used.total()
    found = [*_named("columns", before.column_names, after.column_names),
             *_named("types and metadata", _metadata(before, masks.apply), _metadata(after, str)),
             *_named("writer", *(_writer(pq.ParquetFile(io.BytesIO(each))) for each in (old, new)))]
    if before.num_rows != after.num_rows:
        found.append(f"{before.num_rows} rows before, {after.num_rows} now")
    elif before.column_names == after.column_names:
        for i, column in enumerate(before.column_names):
            found += _columns(column, before.column(i), after.column(i), column in costs, masks)
    if not found and old != new and not costs and masks.used.total() == count:
        found = ["the same columns, other bytes"]
    masks.used["cost"] += bool(costs) and old != new
    return found


def _named(what: str, old: object, new: object) -> Iterator[str]:
    if old != new:
        yield f"{what}: {short(old)} before, {short(new)} now"


def _metadata(table, apply: Callable[[str], str]) -> list[tuple[str, str, bool, str]]:
    """(column, type, whether it may have gaps, metadata) with that of the table first."""
    def text(found: Mapping[bytes, bytes] | None) -> str:
        return apply("; ".join(f"{key.decode(errors='backslashreplace')}={value.decode(errors='backslashreplace')}"
                               for key, value in (found or {}).items()))

    return [("", "", False, text(table.schema.metadata)),
            *((each.name, str(each.type), each.nullable, text(each.metadata)) for each in table.schema)]


def _writer(file) -> tuple[str, str, int]:
    """What a file says of itself."""
    return file.metadata.created_by, file.metadata.format_version, file.metadata.num_row_groups


def _columns(name: str, old, new, cost: bool, masks: Masks) -> Iterator[str]:
    """Of two columns: the first row, and how many."""
    import pyarrow as pa

    if old.type != new.type:  # said before
        return
    if not cost and pa.types.is_floating(old.type):
        rows = _bits(old, new)
    else:
        same = _same_cost if cost else lambda *pair: _same(*pair, masks)
        rows = [i for i, pair in enumerate(zip(old.to_pylist(), new.to_pylist(), strict=True)) if not same(*pair)]
    if len(rows):
        left, right = (each[int(rows[0])].as_py() for each in (old, new))
        yield (f"{name}: {len(rows)} rows, the first of them {rows[0]}: {short(left)} before, "
               f"{short(right)} now{relative(left, right)}")


def _bits(old, new) -> np.ndarray:
    """The rows in which two columns of floats differ, in the sign of zero or the bits of NaN too."""
    def parts(column) -> tuple[np.ndarray, np.ndarray]:
        values = np.ascontiguousarray(column.to_numpy(zero_copy_only=False))
        return column.is_null().to_numpy(zero_copy_only=False), values.view(f"u{values.dtype.itemsize}")

    (gone, before), (missing, after) = parts(old), parts(new)
    return np.flatnonzero((gone != missing) | (~gone & (before != after)))


def _same(old: object, new: object, masks: Masks) -> bool:
    """Of two values of a column."""
    if type(old) is not type(new):
        return False
    if isinstance(old, str):
        return masks.apply(old) == new
    if isinstance(old, float):
        return struct.pack("<d", old) == struct.pack("<d", new)
    if isinstance(old, list | tuple):
        return len(old) == len(new) and all(_same(*pair, masks) for pair in zip(old, new, strict=True))
    if isinstance(old, dict):
        return list(old) == list(new) and all(_same(old[key], new[key], masks) for key in old)
    return old == new


def _same_cost(old: float | None, new: float | None) -> bool:
    """Whether both are numbers, or both none."""
    return _kind(old) == _kind(new)


def _kind(cost: float | None) -> str:
    """What a cost is, but for how large."""
    if cost is None or not math.isfinite(cost):
        return str(cost)
    return "negative" if math.copysign(1.0, cost) < 0.0 else "number"
