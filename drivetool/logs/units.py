"""Units as people write them, and the factor that takes them to SI."""

from __future__ import annotations

import difflib
import math
import unicodedata
from dataclasses import dataclass

from drivetool.errors import BadRecording, DriveToolError

RELATIVE = "relative"
COUNTS = "counts"
PERCENT = "%"

# unit -> (dimension, SI unit, factor, other spellings). A torque may be logged as a torque, a force
# or a current and an angle as a length: the chain of inertias is the same. The input of a motor may
# also be a voltage or a share in %. "N.m" is common, "p.u." too; a full stop elsewhere is a typing error that is
# reported.
UNIT_TABLE: dict[str, tuple[str, str, float, tuple[str, ...]]] = {
    "Nm": ("torque", "Nm", 1.0, ("N-m", "N.m", "newtonmetre", "newtonmeter")),
    "mNm": ("torque", "Nm", 1e-3, ("mN-m", "mN.m")),
    "kNm": ("torque", "Nm", 1e3, ("kN-m", "kN.m")),
    "N": ("torque", "N", 1.0, ("newton",)),
    "kN": ("torque", "N", 1e3, ()),
    "A": ("torque", "A", 1.0, ("amp", "amps", "ampere")),
    "mA": ("torque", "A", 1e-3, ()),
    "kA": ("torque", "A", 1e3, ()),
    "V": ("torque", "V", 1.0, ("volt", "volts")),
    "mV": ("torque", "V", 1e-3, ()),
    "kV": ("torque", "V", 1e3, ()),
    "Hz": ("frequency", "Hz", 1.0, ("hertz",)),
    "rad": ("angle", "rad", 1.0, ("radian", "radians")),
    "mrad": ("angle", "rad", 1e-3, ()),
    "deg": ("angle", "rad", math.pi / 180, ("°", "degree", "degrees")),
    "rev": ("angle", "rad", 2 * math.pi, ("r", "turn", "turns", "revolution", "revolutions")),
    "m": ("angle", "m", 1.0, ("metre", "meter")),
    "mm": ("angle", "m", 1e-3, ()),
    "um": ("angle", "m", 1e-6, ("µm",)),
    "rad/s": ("speed", "rad/s", 1.0, ("rads^-1", "rad/sec")),
    "deg/s": ("speed", "rad/s", math.pi / 180, ("°/s", "degs^-1", "deg/sec", "dps")),
    "rpm": ("speed", "rad/s", 2 * math.pi / 60,
            ("RPM", "1/min", "r/min", "rev/min", "min^-1", "min-1", "U/min")),
    "rev/s": ("speed", "rad/s", 2 * math.pi, ("r/s", "rps", "turn/s", "turns/s")),
    "m/s": ("speed", "m/s", 1.0, ("ms^-1", "m/sec")),
    "mm/s": ("speed", "m/s", 1e-3, ("mm/sec",)),
    "km/h": ("speed", "m/s", 1.0 / 3.6, ("kmh", "kph")),
    "s": ("time", "s", 1.0, ("sec", "second", "seconds")),
    "ms": ("time", "s", 1e-3, ("msec",)),
    "us": ("time", "s", 1e-6, ("µs", "usec")),
    "ns": ("time", "s", 1e-9, ("nsec",)),
    # An angle once it is known how many make a revolution.
    "counts": (COUNTS, "rad", 1.0, ("count", "cnt", "cts", "inc", "increments", "ticks")),
    "%": (RELATIVE, "1", 1e-2, ("percent", "pct")),
    "1": (RELATIVE, "1", 1.0, ("pu", "p.u.")),
}


@dataclass(frozen=True)
class Unit:
    """A unit of measurement.

    text       as this project writes it
    dimension  torque, angle, speed, time, frequency, relative (a share of a rated value) or counts (of an encoder)
    si         the SI unit it converts to; factor: SI value of one unit
    """

    text: str
    dimension: str
    si: str
    factor: float

    def to_si(self, value):
        """A number or (n,) array in this unit, in SI; the very same bits if it is SI already."""
        return value if self.factor == 1.0 else value * self.factor


def _normalised(text: str) -> str:
    """The text without what people write differently: blanks, dots, stars, kinds of micro."""
    text = unicodedata.normalize("NFKC", text).strip()
    return "".join(c for c in text if c not in " *·⋅[]()").replace("−", "-")


_UNIT_BY_SPELLING = {_normalised(name): Unit(unit, dimension, si, factor)
                     for unit, (dimension, si, factor, others) in UNIT_TABLE.items()
                     for name in (unit, *others)}


def units_for(dimension: str) -> tuple[str, ...]:
    """The units a role of this dimension takes; a signal may also be a share of its rated value.

    A volt is listed under torque, since it may be the input of a motor; as a voltage it is a volt.
    """
    if dimension == "voltage":
        return tuple(name for name, (kind, si, *_) in UNIT_TABLE.items() if si == "V" or kind == RELATIVE)
    more = {"time": (), "angle": (RELATIVE, COUNTS)}.get(dimension, (RELATIVE,))
    return tuple(name for name, (kind, *_) in UNIT_TABLE.items() if kind in (dimension, *more))


def parse_unit(text: str | None, dimension: str, where: str,
               error: type[DriveToolError] = BadRecording) -> Unit:
    """The unit behind a text.

    text       as written in the log or the channel map; None if there is none
    dimension  what it must measure: torque, angle, speed, voltage, frequency or time
    where      whose unit it is, for the message; error: the kind to raise
    returns    Unit of that dimension, or of dimension relative (not for time) or counts (of an angle)
    raises     `error`: missing, unknown or measuring something else; lists what is taken
    """
    takes = units_for(dimension)
    wanted = f"a unit of {dimension} for {where}"
    if text is None or not text.strip():
        raise error(wanted, "none", "Write `unit:` for it in the channel map.", takes)
    unit = _UNIT_BY_SPELLING.get(_normalised(text))
    if unit is None:
        lower = {name.lower(): name for name in takes}
        close = difflib.get_close_matches(_normalised(text).lower(), lower, n=1, cutoff=0.5)
        hint = f"Did you mean '{lower[close[0]]}'?" if close else "Use one of the units listed."
        raise error(wanted, f"the unknown unit '{text}'", hint, takes)
    if unit.text not in takes:
        raise error(wanted, f"'{text}', a unit of {unit.dimension}",
                    "Correct the role or the unit in the channel map.", takes)
    return unit
