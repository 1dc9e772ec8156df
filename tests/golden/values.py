"""Where two contents differ, by value."""

from __future__ import annotations

import difflib
import hashlib
import io
import json
import math
import re
from base64 import b64decode
from collections.abc import Callable, Iterator, Mapping

import yaml

from tests.golden.masks import COSTS, Masks, same_sentence, without_costs

SHOWN = 8  # differences of one file that are shown
EMBEDDED = re.compile(r"data:image/png;base64,([A-Za-z0-9+/=\s]+)")
WHOLE = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?|[-+]?\.(inf|nan)|null|true|false", re.IGNORECASE)
# Scalars stay the text they are.
Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)


def differences(name: str, old: bytes, new: bytes, masks: Masks) -> list[str]:
    """What differs between two contents of one name, a line each; empty if nothing does but what is masked."""
    if old == new:
        return []
    ending = name.rpartition(".")[2]
    if ending == "parquet":
        return list(_parquets(old, new, masks))
    if ending == "png":
        return pictures(old, new)
    try:
        before, after = old.decode(), new.decode()
    except UnicodeDecodeError:
        return [f"bytes differ: {len(old)} before, {len(new)} now"]
    return texts(name, before, after, masks)


def texts(name: str, old: str, new: str, masks: Masks) -> list[str]:
    """Of two texts: by value where both are YAML or JSON."""
    masked = masks.apply(old)
    touched = masked != old
    before, after = (EMBEDDED.sub(_pixels, without_costs(name, text, masks)) for text in (masked, new))
    if before == after:
        return []
    trees = _trees(name, before, after)
    if trees is not None:
        found = list(_unequal(*trees, masks))
        if found:
            return _first(found, SHOWN)
        # A longer name or number breaks lines elsewhere.
        if (touched or _written(*trees)) and same_sentence(_words(before), _words(after)):
            return []
    elif same_sentence(before, after) or (touched and same_sentence(_words(before), _words(after))):
        masks.used["number"] += 1
        return []
    return _lines(before, after)


def _words(text: str) -> str:
    """A text whose lines and columns are free."""
    return " ".join(re.sub(r"[─-╿]+|-{3,}", " ", text).split())


def _pixels(found: re.Match[str]) -> str:
    """A picture in a page by its data."""
    return f"data:picture {pixels(b64decode(found[1]))[1]}"


def _trees(name: str, *texts: str) -> tuple[object, object] | None:
    """Both contents, scalars as text; None for what is no YAML or JSON."""
    def loaded(text: str) -> object:
        if text.lstrip()[:1] in ("{", "["):
            return json.loads(text, parse_float=str, parse_int=str, parse_constant=str)
        return yaml.load(text, Loader=Loader)

    if not (name.endswith((".yaml", ".json")) or all(t.startswith(("{", "schema:", "- code:")) for t in texts)):
        return None
    try:
        found = tuple(loaded(text) for text in texts)
    except (ValueError, yaml.YAMLError):
        return None
    return found if all(isinstance(each, dict | list) for each in found) else None


def _unequal(old: object, new: object, masks: Masks, path: str = "") -> Iterator[str]:
    """Every place in which two trees differ."""
    if isinstance(old, dict) and isinstance(new, dict):
        yield from _mappings(old, new, masks, path)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f"{path or 'top'}: {len(old)} entries before, {len(new)} now"
        for i, pair in enumerate(zip(old, new, strict=False)):
            yield from _unequal(*pair, masks, f"{path}[{i}]")
    elif old != new or type(old) is not type(new):
        sentences = all(isinstance(each, str) and not WHOLE.fullmatch(each) for each in (old, new))
        if sentences and same_sentence(old, new):
            masks.used["number"] += 1
        else:
            yield f"{path}: {_short(old)} before, {_short(new)} now{_relative(old, new)}"


def _mappings(old: Mapping, new: Mapping, masks: Masks, path: str) -> Iterator[str]:
    """The same of two mappings, their order too."""
    for key in [key for key in old if key not in new]:
        yield f"{path}.{key}: {_short(old[key])} before, missing now"
    for key in [key for key in new if key not in old]:
        yield f"{path}.{key}: missing before, {_short(new[key])} now"
    shared = [[key for key in each if key in other] for each, other in ((old, new), (new, old))]
    if shared[0] != shared[1]:
        at = next(i for i, pair in enumerate(zip(*shared, strict=True)) if pair[0] != pair[1])
        yield f"{path or 'top'}: order of keys, {shared[0][at]} before, {shared[1][at]} now at place {at + 1}"
    for key in shared[0]:
        yield from _unequal(old[key], new[key], masks, f"{path}.{key}")


def _written(old: object, new: object) -> bool:
    """Whether two trees of equal values have a sentence that is written otherwise."""
    if isinstance(old, dict) and isinstance(new, dict):
        return any(_written(old[key], new[key]) for key in old)
    if isinstance(old, list) and isinstance(new, list):
        return any(map(_written, old, new))
    return old != new


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 160 else f"{text[:157]}..."


def _relative(old: object, new: object) -> str:
    """By how much two numbers differ."""
    try:
        before, after = float(old), float(new)
    except (TypeError, ValueError):
        return ""
    known = before and math.isfinite(after - before)
    return f" (by {abs(after - before) / abs(before):.2g} of it)" if known else ""


def _lines(old: str, new: str) -> list[str]:
    """A small difference of two texts."""
    found = [line for line in difflib.unified_diff(old.splitlines(), new.splitlines(), "before", "now", n=0)
             if not line.startswith(("---", "+++", "@@"))]
    if not found:
        return ["ends of lines differ"]
    return _first(list(map(_short, found)), 2 * SHOWN)


def _first(lines: list[str], count: int) -> list[str]:
    """The first of them, and how many more there are."""
    return [*lines[:count], f"and {len(lines) - count} more"] if len(lines) > count else lines


def pixels(data: bytes) -> tuple[object, str]:
    """(the picture, a hash of its size and pixels)."""
    from PIL import Image

    picture = Image.open(io.BytesIO(data)).convert("RGBA")
    return picture, hashlib.sha256(f"{picture.size}".encode() + picture.tobytes()).hexdigest()


def pictures(old: bytes, new: bytes) -> list[str]:
    """Of two pictures: their pixels."""
    from PIL import ImageChops

    (before, one), (after, other) = pixels(old), pixels(new)
    if one == other:
        return []
    if before.size != after.size:
        return [f"size {before.size} before, {after.size} now"]
    bands = [ImageChops.difference(*pair) for pair in zip(before.split(), after.split(), strict=True)]
    several = bands[0]
    for band in bands[1:]:
        several = ImageChops.lighter(several, band)
    count = sum(several.histogram()[1:])
    box = several.getbbox()
    return [f"{count} pixels differ, the first at {box[:2]}: {before.getpixel(box[:2])} before, "
            f"{after.getpixel(box[:2])} now" if count == 1 else f"{count} pixels differ, within {box}"]


def _parquets(old: bytes, new: bytes, masks: Masks) -> Iterator[str]:
    """Of two tables: names, types, metadata, and every column."""
    import pyarrow.parquet as pq

    tables = [pq.read_table(io.BytesIO(each)) for each in (old, new)]
    costs = [name for name in COSTS if all(name in table.column_names for table in tables)]
    masks.used["cost"] += bool(costs)
    before, after = (table.drop_columns(costs) for table in tables)
    count = masks.used.total()
    found = [*_named("columns", before.column_names, after.column_names),
             *_named("metadata", _metadata(before, masks.apply), _metadata(after, str))]
    if before.num_rows != after.num_rows:
        found.append(f"{before.num_rows} rows before, {after.num_rows} now")
    elif before.column_names == after.column_names:
        for name in before.column_names:
            found += _columns(name, before[name], after[name], masks)
    if not found and not costs and masks.used.total() == count:
        found = ["the same columns, other bytes"]
    yield from found


def _named(what: str, old: object, new: object) -> list[str]:
    return [] if old == new else [f"{what}: {_short(old)} before, {_short(new)} now"]


def _metadata(table, apply: Callable[[str], str]) -> list[tuple[str, str, str]]:
    """(column, type, metadata) with that of the table first."""
    def text(found: Mapping[bytes, bytes] | None) -> str:
        return apply("; ".join(f"{key.decode()}={value.decode(errors='replace')}"
                               for key, value in (found or {}).items()))

    return [("", "", text(table.schema.metadata)),
            *((each.name, str(each.type), text(each.metadata)) for each in table.schema)]


def _columns(name: str, old, new, masks: Masks) -> list[str]:
    """Of two columns: the first row, and how many."""
    if old.equals(new):
        return []
    rows = [(i, left, right) for i, (left, right) in enumerate(
        zip(old.to_pylist(), new.to_pylist(), strict=True)) if not _equal(left, right, masks)]
    if not rows:
        return []
    i, left, right = rows[0]
    return [f"{name}: {len(rows)} rows, the first of them {i}: {_short(left)} before, "
            f"{_short(right)} now{_relative(left, right)}"]


def _equal(old: object, new: object, masks: Masks) -> bool:
    if isinstance(old, str) and isinstance(new, str):
        return same_sentence(masks.apply(old), new)
    return old == new or (old != old and new != new)
