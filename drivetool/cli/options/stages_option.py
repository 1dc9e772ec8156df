"""--stages HIGH:LOW,...: windows of the speed that a coast-down fits one after the other."""

from __future__ import annotations

import re
from itertools import pairwise

from drivetool.cli.options.inputs import as_usage
from drivetool.errors import BadOption
from drivetool.files.yaml import units

OPTION = "--stages"
COUNTS = (2, 3)  # of windows: viscous friction, Coulomb friction, and speeds of what rises before standstill
_WINDOWS = re.compile(r"\s*([\d.:,\s]+?)\s*([A-Za-z%/^ ]*)\s*")


def windows_of(words: str, motion_unit: str) -> tuple[tuple[float, float], ...]:
    """'1600:750,750:300 rpm' as windows (high, low) [motion unit/s]; none of no words.

    raises  BadOption: no windows, one that is no range, ranges that do not descend, a unit that is no speed
    """
    if not words:
        return ()

    wanted = f"{motion_unit}/s"
    usual = "rpm" if motion_unit == "rad" else wanted
    do = f"Write for example '{OPTION} 1600:750,750:300' in rpm, or '{OPTION} \"2:1,1:0.3 {wanted}\"'."
    found = _WINDOWS.fullmatch(words)
    try:
        parts = [[float(number) for number in part.split(":")] for part in found[1].split(",")] if found else []
    except ValueError:
        parts = []
    if len(parts) not in COUNTS or any(len(part) != 2 for part in parts):
        raise BadOption(f"two or three windows HIGH:LOW after {OPTION}", f"'{words}'", do)
    ends = [end for part in parts for end in part]
    if any(a < b for a, b in pairwise(ends)) or any(a == b for a, b in parts):
        raise BadOption(f"windows from fast to slow after {OPTION}", f"'{words}'", do)
    with as_usage():
        factor = units.factor(found[2].strip() or usual, wanted, OPTION) if found else 1.0
    return tuple((factor * a, factor * b) for a, b in parts)
