"""Units of parameters that a person may write: 'kg cm^2', 'Nm/deg', 'mrad' ..."""

from __future__ import annotations

import math
import re

from drivetool.errors import BadParameters
from drivetool.quantity import ELECTRIC_UNITS

# symbol -> (factor to SI, exponents of kg, m, s, A, rad, %). The radian counts as a dimension of its own, so that
# a stiffness in Nm is not taken for one in Nm/rad. So does the per cent: 1 Nm is not 1 Nm/%. Alone it is 0.01.
_FORCE, _TORQUE, _VOLTAGE = (1, 1, -2, 0, 0, 0), (1, 2, -2, 0, 0, 0), (1, 2, -3, -1, 0, 0)
_DIMENSIONLESS, _PERCENT = (0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 1)
UNIT_SYMBOLS: dict[str, tuple[float, tuple[int, ...]]] = {
    "": (1.0, (0, 0, 0, 0, 0, 0)),
    "1": (1.0, (0, 0, 0, 0, 0, 0)),
    "-": (1.0, (0, 0, 0, 0, 0, 0)),
    "%": (1.0, (0, 0, 0, 0, 0, 1)),
    "g": (1e-3, (1, 0, 0, 0, 0, 0)),
    "kg": (1.0, (1, 0, 0, 0, 0, 0)),
    "t": (1e3, (1, 0, 0, 0, 0, 0)),
    "um": (1e-6, (0, 1, 0, 0, 0, 0)),
    "mm": (1e-3, (0, 1, 0, 0, 0, 0)),
    "cm": (1e-2, (0, 1, 0, 0, 0, 0)),
    "m": (1.0, (0, 1, 0, 0, 0, 0)),
    "us": (1e-6, (0, 0, 1, 0, 0, 0)),
    "ms": (1e-3, (0, 0, 1, 0, 0, 0)),
    "s": (1.0, (0, 0, 1, 0, 0, 0)),
    "mA": (1e-3, (0, 0, 0, 1, 0, 0)),
    "A": (1.0, (0, 0, 0, 1, 0, 0)),
    "kA": (1e3, (0, 0, 0, 1, 0, 0)),
    "mV": (1e-3, _VOLTAGE),
    "V": (1.0, _VOLTAGE),
    "urad": (1e-6, (0, 0, 0, 0, 1, 0)),
    "mrad": (1e-3, (0, 0, 0, 0, 1, 0)),
    "rad": (1.0, (0, 0, 0, 0, 1, 0)),
    "deg": (math.pi / 180, (0, 0, 0, 0, 1, 0)),
    "rev": (2 * math.pi, (0, 0, 0, 0, 1, 0)),
    "Hz": (2 * math.pi, (0, 0, -1, 0, 1, 0)),
    "rpm": (math.pi / 30, (0, 0, -1, 0, 1, 0)),
    "mN": (1e-3, _FORCE),
    "N": (1.0, _FORCE),
    "kN": (1e3, _FORCE),
    "MN": (1e6, _FORCE),
    "mNm": (1e-3, _TORQUE),
    "Ncm": (1e-2, _TORQUE),
    "Nm": (1.0, _TORQUE),
    "Nms": (1.0, (1, 2, -1, 0, 0, 0)),
    "kNm": (1e3, _TORQUE),
    "MNm": (1e6, _TORQUE),
}
_TOKEN = re.compile(r"\s*(?:(?P<atom>[A-Za-z%]+|1|-(?=\s*$))(?:\^|\*\*)?(?P<power>-?\d)?|(?P<op>[/()*]))")
_SPELLINGS = {"kgm": "kg m", "kgcm": "kg cm", "kgmm": "kg mm",
             "²": "^2", "³": "^3", "·": "*", "µ": "u", "μ": "u", "°": "deg"}


def is_known(unit: str) -> bool:
    """Whether a unit can be read."""
    return _factor_and_exponents(unit) is not None


def conversion_factor(unit: str, wanted: str, what: str) -> float:
    """What a number in `unit` is multiplied with to be in `wanted`.

    unit    as a person wrote it
    wanted  the drive's own unit, for example 'kg m^2'
    what    the parameter, for the message
    raises  BadParameters: an unknown unit, or one of another dimension
    """
    if unit == wanted:
        return 1.0
    scale, kind = _factor_and_exponents(unit) or (1.0, None)
    base, target = _factor_and_exponents(wanted) or (1.0, ())
    if wanted == "kg m^2" and kind:
        kind = (*kind[:4], 0, kind[5])  # Nm s^2/rad is the same inertia
    if (kind, target) == (_PERCENT, _DIMENSIONLESS):
        kind, scale = target, 0.01 * scale
    if kind != target:
        raise BadParameters(f"{what} in {wanted or 'no unit (a plain number)'}", f"unit '{unit}'",
                            "Convert the value, or write the unit as in 'kg cm^2' or 'Nm/rad'.")
    return scale / base


def torque_over_input(unit: str) -> tuple[str, str] | None:
    """Units (torque, input) of a torque constant as written: ('Nm', 'A') of 'mNm/kA'; None: no torque constant."""
    _, kind = _factor_and_exponents(unit) or (1.0, None)
    return next(((torque, fed) for torque in ("Nm", "N") for fed in ELECTRIC_UNITS
                 if kind == _parse_unit(f"{torque}/{fed}")[1]), None)


def _factor_and_exponents(unit: str) -> tuple[float, tuple[int, ...]] | None:
    """Factor to SI, and exponents; None of a unit that cannot be read."""
    try:
        return _parse_unit(unit)
    except ValueError:
        return None


def _parse_unit(text: str) -> tuple[float, tuple[int, ...]]:
    """(factor to SI, exponents) of a unit; ValueError if it cannot be read."""
    for old, new in _SPELLINGS.items():
        text = text.replace(old, new)
    tokens, at = [], 0
    while at < len(text.rstrip()):
        match = _TOKEN.match(text, at)
        if not match:
            raise ValueError(text)
        tokens.append(match)
        at = match.end()
    result, rest = _parse_product(tokens)
    if rest:
        raise ValueError(text)
    return result


def _parse_product(tokens: list[re.Match]) -> tuple[tuple[float, tuple[int, ...]], list[re.Match]]:
    """Read factors up to the end or a closing bracket; a slash divides by the next factor."""
    scale, exponents, sign = 1.0, _DIMENSIONLESS, 1
    while tokens and tokens[0]["op"] != ")":
        token, tokens = tokens[0], tokens[1:]
        if token["op"] in ("/", "*"):
            sign = -1 if token["op"] == "/" else 1
            continue
        if token["op"] == "(":
            (size, dims), tokens = _parse_product(tokens)
            if not tokens:
                raise ValueError("bracket")
            tokens, power = tokens[1:], sign
        elif token["atom"] in UNIT_SYMBOLS:
            size, dims = UNIT_SYMBOLS[token["atom"]]
            power = sign * int(token["power"] or 1)
        else:
            raise ValueError(token[0])
        scale *= size**power
        exponents = tuple(a + power * b for a, b in zip(exponents, dims, strict=True))
        sign = 1
    if sign < 0:
        raise ValueError("nothing after the slash")
    return (scale, exponents), tokens
