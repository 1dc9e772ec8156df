"""Where two contents differ, by value."""

from __future__ import annotations

import hashlib
import io
import json
import re
import textwrap
from base64 import b64decode
from collections.abc import Iterator, Mapping

import yaml

from tests.golden.masks import Masks, without_costs
from tests.golden.sentences import Loader, documented, is_sentence, printed, same_blocks, same_sentence
from tests.golden.shown import MAX_DIFFERENCES, first, lines, relative, short
from tests.golden.tables import tables

STDOUT = "stdout"
EMBEDDED = re.compile(r"data:image/png;base64,([A-Za-z0-9+/=\s]+)")
# How YAML and JSON on standard output begin.
DOCUMENT = re.compile(r"[{\[]|- |[a-z_]+:\s")


def differences(name: str, old: bytes, new: bytes, masks: Masks) -> list[str]:
    """What differs between two contents of one name, a line each; empty if nothing does but what is masked."""
    if old == new and masks.idle:
        return []
    ending = name.rpartition(".")[2]
    if ending == "parquet":
        return tables(name, old, new, masks)
    if old == new and ending == "png":
        return []
    if ending == "png":
        return pictures(old, new)
    try:
        before, after = old.decode(), new.decode()
    except UnicodeDecodeError:
        return [] if old == new else [f"bytes differ: {len(old)} before, {len(new)} now"]
    return texts(name, before, after, masks)


def texts(name: str, old: str, new: str, masks: Masks) -> list[str]:
    """Of two texts: YAML and JSON by value, prose by its words, all else as it is."""
    masked = masks.apply(old)
    # What is equal on both sides is expected only where no mask acts.
    if masked == new:
        return []
    before, after = (EMBEDDED.sub(_pixels, without_costs(name, text, masks)) for text in (masked, new))
    if before == after:
        return []
    trees, count = _trees(name, old, new), masks.used["number"]
    if trees is not None:
        found = list(_unequal(_masked(trees[0], masks.uncounted()), trees[1], masks))
        if found:
            return first(found, MAX_DIFFERENCES)
    elif name != STDOUT:
        return lines(before, after)
    blocks = documented if trees is not None else printed
    if same_blocks(blocks(old), blocks(new), masks.uncounted(), None if trees is None else _same_scalars):
        masks.used["number"] += trees is None
        return []
    masks.used["number"] = count
    return lines(before, after)


def _pixels(found: re.Match[str]) -> str:
    """A picture in a page by its data."""
    return f"data:picture {pixels(b64decode(found[1]))[1]}"


def _trees(name: str, *texts: str) -> tuple[object, object] | None:
    """Both contents, scalars as text; None for what is no YAML or JSON."""
    def loaded(text: str) -> object:
        if text.lstrip()[:1] in ("{", "["):
            return json.loads(text, parse_float=str, parse_int=str, parse_constant=str)
        return yaml.load(text, Loader=Loader)

    if not (name.endswith((".yaml", ".json")) or (name == STDOUT and all(map(DOCUMENT.match, texts)))):
        return None
    try:
        found = tuple(loaded(text) for text in texts)
    except (ValueError, yaml.YAMLError):
        return None
    return found if all(isinstance(each, dict | list) for each in found) else None


def _masked(tree: object, masks: Masks) -> object:
    """A tree of BASE as it is expected now."""
    if isinstance(tree, dict):
        # A code that is a plain word is masked where a code stands.
        return {masks.apply(key): masks.apply(f"code: {value}").removeprefix("code: ")
                if key == "code" and isinstance(value, str) else _masked(value, masks)
                for key, value in tree.items()}
    if isinstance(tree, list):
        return [_masked(each, masks) for each in tree]
    return masks.apply(tree) if isinstance(tree, str) else tree


def _same_scalars(old: str, new: str, masks: Masks) -> bool:
    """Whether a mask changed a scalar, and no more: another text may need other quotes."""
    try:
        before, after = (yaml.load(textwrap.dedent(text), Loader=Loader) for text in (old, new))
    except yaml.YAMLError:
        return False
    expected = _masked(before, masks)
    return expected == after and expected != before


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
        if is_sentence(old) and is_sentence(new) and same_sentence(old, new):
            masks.used["number"] += 1
        else:
            yield f"{path}: {short(old)} before, {short(new)} now{relative(old, new)}"


def _mappings(old: Mapping, new: Mapping, masks: Masks, path: str) -> Iterator[str]:
    """The same of two mappings, their order too."""
    for key in [key for key in old if key not in new]:
        yield f"{path}.{key}: {short(old[key])} before, missing now"
    for key in [key for key in new if key not in old]:
        yield f"{path}.{key}: missing before, {short(new[key])} now"
    shared = [[key for key in each if key in other] for each, other in ((old, new), (new, old))]
    if shared[0] != shared[1]:
        at = next(i for i, pair in enumerate(zip(*shared, strict=True)) if pair[0] != pair[1])
        yield f"{path or 'top'}: order of keys, {shared[0][at]} before, {shared[1][at]} now at place {at + 1}"
    for key in shared[0]:
        yield from _unequal(old[key], new[key], masks, f"{path}.{key}")


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
