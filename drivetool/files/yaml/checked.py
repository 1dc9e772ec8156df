"""Checks parsed YAML and gives the typed file, or one sentence about the first error."""

from __future__ import annotations

import re
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from drivetool.errors import BadParameters, nearest
from drivetool.files.shapes import gains_shapes, parameter_shapes as shapes

Shape = TypeVar("Shape", bound=shapes.Shape)

_EXPECTED_PATTERN = re.compile(
    r"Expected `(?P<wanted>.*?)`(?: of length (?P<length>\d+))?, got `?(?P<found>[^`]*)`?")
_AT_LEAST_PATTERN = re.compile(r"Expected `(?:float|int)` >= (?P<least>[-+.0-9e]+)")
_PLACE_PATTERN = re.compile(r" - at `\$\.?(?P<path>.*)`$")
_TYPE_WORDS = {"float": "number", "int": "whole number", "str": "text", "object": "mapping",
          "array": "list", "bool": "true or false"}
_SECTION_SHAPES = {"tool": shapes.Tool, "drive": shapes.DriveSection, "covariance": shapes.CovarianceSection,
             "ratings": shapes.RatingsSection, "controller": shapes.ControllerSection,
             "diagnosis": shapes.DiagnosisSection}
_LIST_ITEM_SHAPES = {"findings": shapes.FindingSection, "records": shapes.FileSection, "data": shapes.FileSection,
          "inputs": shapes.FileSection}

OTHER_SCHEMA_ADVICE = "Write the file again with this version of drivetool, or check it and change its schema line."
_OTHER_FILE_ADVICE = {
    shapes.VALIDATION_SCHEMA: "Give the parameter file that was validated, not the file that validate wrote.",
    gains_shapes.GAINS_SCHEMA: "Give the parameter file that was tuned; the file that tune wrote goes to --gains."}


def parameter_file(raw: dict[Any, Any], name: str) -> shapes.ParameterFile:
    """The typed parameter file.

    raw     as `text.from_yaml` gave it
    name    of the file, for messages
    raises  BadParameters: another schema, an unknown key, a wrong type
    """
    _check_schema(raw, name)
    _check_keys(raw, shapes.ParameterFile, name, "")
    for key, shape in _SECTION_SHAPES.items():
        if raw.get(key) is not None:
            check_section(raw[key], shape, name, key)
    for key, shape in _LIST_ITEM_SHAPES.items():
        for index, item in enumerate(checked_kind(raw.get(key, []), list, name, key)):
            check_section(item, shape, name, f"{key}[{index}]")
    for key, item in checked_kind(raw.get("parameters", {}), dict, name, "parameters").items():
        where = f"parameters.{key}"
        if isinstance(item, dict):
            check_section(item, shapes.ParameterSection, name, where)
        elif isinstance(item, bool) or not isinstance(item, int | float):
            raise BadParameters(
                f"a number, or a mapping with value and unit, at {where}", f"{_value_words(item)} in {name}",
                "Write for example '{value: 0.4, unit: kg m^2}', with a dot as decimal sign.")
    return _convert(raw, shapes.ParameterFile, name, "")


def result_file(raw: dict[Any, Any], shape: type[Shape], name: str) -> Shape:
    """The typed file of a step that writes no parameters, its schema known; BadParameters as above."""
    _check_keys(raw, shape, name, "")
    return _convert(raw, shape, name, "", raw["schema"].split("/")[1])


def gains_file(raw: dict[Any, Any], name: str) -> gains_shapes.GainsFile:
    """The typed gains file; BadParameters as above."""
    if raw.get("schema") != gains_shapes.GAINS_SCHEMA:
        raise BadParameters(f"schema {gains_shapes.GAINS_SCHEMA}", f"{raw.get('schema') or 'no schema'} in {name}",
                            "Give the file that tune wrote.")
    return result_file(raw, gains_shapes.GainsFile, name)


def _check_schema(raw: dict[Any, Any], name: str) -> None:
    """Refuse a file whose first key states another kind or version."""
    wanted, found = shapes.PARAMETERS_SCHEMA, raw.get("schema")
    if found != wanted:
        raise BadParameters(f"schema {wanted}", f"{found or 'no schema'} in {name}", (
            f"Begin the file with 'schema: {wanted}'." if found is None else
            _OTHER_FILE_ADVICE.get(str(found), OTHER_SCHEMA_ADVICE)))


def _check_keys(raw: dict[Any, Any], shape: type[Shape], name: str, where: str) -> None:
    """Refuse a key that is no field; suggest the nearest one."""
    fields = shape.__struct_fields__
    for key in raw:
        if key not in fields:
            raise BadParameters(
                f"known keys{f' at {where}' if where else ''}", f"'{key}' in {name}",
                nearest(str(key), fields))


def check_section(raw: Any, shape: type[Shape], name: str, where: str, form: str = "parameters") -> None:
    """Check one section on its own, so that the message can say which; form: the schema's name."""
    _check_keys(checked_kind(raw, dict, name, where, form), shape, name, where)
    _convert(raw, shape, name, where, form)


def _convert(raw: Any, shape: type[Shape], name: str, where: str, form: str = "parameters") -> Shape:
    """Convert by msgspec, whose message becomes a sentence of ours; form: the schema's name."""
    try:
        return msgspec.convert(raw, shape)
    except msgspec.ValidationError as error:
        text = str(error)
        place_match = _PLACE_PATTERN.search(text)
        path = place_match["path"] if place_match else ""
        place = f"{where}.{path}" if where and path and not path.startswith("[") else where + path
        value, choices = _value_at(raw, path), _choices(shape, path)
        kinds = _EXPECTED_PATTERN.search(text)
        least = _AT_LEAST_PATTERN.search(text)
        if least:
            wanted, found = f"a number of at least {float(least['least']):g}", _value_words(value)
        elif "matching regex" in text:
            wanted, found = "a word of letters, digits, dots, - and _", _value_words(value)
        elif choices:
            wanted, found = f"one of {', '.join(choices)}", _value_words(value)
        elif kinds:
            length = f" of {kinds['length']}" if kinds["length"] else ""
            wanted = f"a {_kind_words(kinds['wanted'])}{length}"
            found = _value_words(value) if value is not None else f"a {_kind_words(kinds['found'])}"
        else:
            wanted, found = "the file to follow its schema", _PLACE_PATTERN.sub("", text)
        raise BadParameters(f"{wanted}{f' at {place}' if place else ''}", f"{found} in {name}",
                            f"Correct the file; schemas/{form}.json has its full form.") from None


def _choices(shape: type[Shape], path: str) -> tuple[str, ...]:
    """The words a field may be, if it is such a field."""
    kind = get_type_hints(shape).get(path)
    literals = [kind, *get_args(kind)]
    return next((get_args(each) for each in literals if get_origin(each) is Literal), ())


def _value_at(raw: Any, path: str) -> Any:
    """The value a simple path points to, or None."""
    for key in filter(None, path.split(".")):
        raw = raw.get(key) if isinstance(raw, dict) else None
    return raw


def checked_kind(value: Any, kind: type, name: str, where: str, form: str = "parameters") -> Any:
    """The value if it is a mapping or a list, as required."""
    if not isinstance(value, kind):
        raise BadParameters(f"a {'mapping' if kind is dict else 'list'} at {where}",
                            f"{_value_words(value)} in {name}",
                            f"Correct the file; schemas/{form}.json has its full form.")
    return value


def _kind_words(kinds: str) -> str:
    """'float | null' as 'number or null'."""
    return " or ".join(_TYPE_WORDS.get(kind, kind) for kind in kinds.split(" | "))


def _value_words(value: Any) -> str:
    """A value in words."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return f"{'text ' if isinstance(value, str) else ''}'{value}'"
