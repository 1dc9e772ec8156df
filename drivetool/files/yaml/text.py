"""YAML and JSON text, in and out: the same value always gives the same bytes."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import msgspec
import yaml

from drivetool.errors import BadParameters
from drivetool.results import Shape

Result = TypeVar("Result", bound=Shape)

# YAML 1.1, which PyYAML follows, takes 1e-5 for text; a person who writes it means a number.
_NUMBER = re.compile(r"^[-+]?(?:\.[0-9]+|[0-9]+\.?[0-9]*)[eE][-+]?[0-9]+$")
# Largest double of ten digits: rounding the largest finite one (1.7976931348...e308) up would give infinity.
_LARGEST_ROUNDED = 1.797693134e308
MAX_NAMES_LISTED = 5  # A choice: names in a readable sentence; the rest is counted.
# YAML reads these as line breaks, and the first as a plain one.
_LINE_BREAKS = re.compile("[\x85\u2028\u2029]")
# A terminal obeys control characters, UTF-8 has no lone surrogates, and XML 1.0 has no place for most of these, not
# even escaped (section 2.2). Characters that turn the direction of text show a name as another one.
_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")


class _Loader(yaml.SafeLoader):
    """Safe loader that also refuses a key written twice."""

    def construct_mapping(self, node, deep=False):
        """The mapping, unless two keys are the same: one of them would be lost silently."""
        seen = set()
        for key, _ in getattr(node, "value", ()):
            if isinstance(key, yaml.ScalarNode) and key.tag != "tag:yaml.org,2002:merge":
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"key '{key.value}' for the second time", key.start_mark)
                seen.add(key.value)
        return super().construct_mapping(node, deep)


class _Dumper(yaml.SafeDumper):
    """Safe dumper: numbers as `number_text`, lists of plain values on one line, text as it is."""

    def ignore_aliases(self, data):
        """Never anchors: a person edits the file."""
        return True


def number_text(value: float) -> str:
    """A finite float with 10 significant digits that YAML 1.1 reads as a float again.

    value    any finite float
    returns  for example '0.5871', '3310.0', '1.0e-05'
    """
    text = f"{_rounded(value):.10g}"
    mantissa, e, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return mantissa + e + exponent


def _rounded(value: float) -> float:
    """10 significant digits; minus zero becomes zero, and rounding never overflows."""
    rounded = float(f"{value:.10g}")
    if math.isinf(rounded):
        return math.copysign(_LARGEST_ROUNDED, value)
    return rounded if rounded else 0.0


def to_plain(value: Any) -> Any:
    """Mappings, lists, text, whole numbers and rounded floats only; NaN and infinity are None.

    A struct becomes a mapping, without what is left out.
    """
    if isinstance(value, msgspec.Struct):
        fields = {name: getattr(value, name) for name in value.__struct_fields__}
        return to_plain({name: each for name, each in fields.items() if each is not msgspec.UNSET})
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return _rounded(float(value)) if math.isfinite(value) else None
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, without importing NumPy
        return to_plain(value.tolist())
    raise TypeError(f"{type(value).__name__} cannot be written to a file; give numbers, text, lists or mappings")


def written(section: Shape, kind: type[Result]) -> Result:
    """What a file has of a result, a struct of that kind or with further fields, its numbers rounded.

    None, as of a number that is not finite, is left out where the kind leaves a value out.
    """
    plain = {name: to_plain(value) for name in kind.__struct_fields__
             if (value := getattr(section, name)) is not msgspec.UNSET}
    left_out = {field.name for field in msgspec.structs.fields(kind) if field.default is msgspec.UNSET}
    return msgspec.convert({n: v for n, v in plain.items() if not (v is None and n in left_out)}, kind)


def counted_noun(n: int, noun: str) -> str:
    """'no recordings', '1 recording', '2 recordings'."""
    return f"{n or 'no'} {noun}{'' if n == 1 or noun.endswith('s') else 's'}"


def first_of(names: Sequence[str], most: int = MAX_NAMES_LISTED) -> str:
    """The first of some names, and how many more there are."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def to_yaml(document: Mapping[str, Any]) -> str:
    """Block YAML in the order given; unprintable characters, and bytes of a file name that are no text, escaped."""
    return yaml.dump(to_plain(document), Dumper=_Dumper, sort_keys=False, default_flow_style=False,
                     allow_unicode=True, width=110)


def to_json(document: Mapping[str, Any]) -> str:
    """The same content as `to_yaml`, as indented JSON."""
    text = json.dumps(to_plain(document), indent=2, ensure_ascii=False, allow_nan=False)
    return escape_unprintable(text) + "\n"


def escape_unprintable(text: str) -> str:
    """The text with characters that a file or a terminal cannot show as escape sequences."""
    return _UNPRINTABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def from_yaml(data: bytes | str, name: str) -> dict[Any, Any]:
    """The mapping in a YAML text, read safely.

    data    the text, or its bytes in UTF-8
    name    of the file, for messages
    raises  BadParameters: not UTF-8, not YAML, empty, a key twice, or not a mapping
    """
    wanted = "a YAML file with a mapping of keys"
    try:
        text = data.decode("utf-8-sig") if isinstance(data, bytes) else data
        value = yaml.load(text, Loader=_Loader)
    except UnicodeDecodeError:
        raise BadParameters(
            wanted, f"bytes in {name} that are not UTF-8 text",
            "Check the file; give a log without --params.") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f"line {mark.line + 1} of " if mark else ""
        problem = (getattr(error, "problem", None) or "something that is not YAML").removeprefix("found ")
        raise BadParameters(wanted, f"{problem} in {place}{name}",
                            "Correct the line; indent with spaces, not tabs.") from None
    if value is None:
        raise BadParameters(
            wanted, f"{name} empty", "Check the file; the program that wrote it may have failed.")
    if not isinstance(value, dict):
        raise BadParameters(wanted, f"a {_type_word(value)} in {name}",
                            "Check that the right file was given.")
    return value


def _type_word(value: Any) -> str:
    """The YAML word for a value's type."""
    return {list: "list", str: "text", bool: "boolean", int: "number", float: "number"}.get(
        type(value), type(value).__name__)


def _fits_one_line(items: list[Any]) -> bool:
    """Whether a list reads best on one line."""
    return all(not isinstance(item, dict | list) and len(str(item)) <= 40 for item in items)


_FLOAT = "tag:yaml.org,2002:float"
for _class in (_Loader, _Dumper):
    _class.add_implicit_resolver(_FLOAT, _NUMBER, list("-+.0123456789"))
_Dumper.add_representer(float, lambda dumper, value: dumper.represent_scalar(_FLOAT, number_text(value)))
_Dumper.add_representer(str, lambda dumper, text: dumper.represent_scalar(
    "tag:yaml.org,2002:str", text, style='"' if _LINE_BREAKS.search(text) else None))
_Dumper.add_representer(list, lambda dumper, items: dumper.represent_sequence(
    "tag:yaml.org,2002:seq", items, flow_style=_fits_one_line(items)))
