"""--stages HIGH:LOW,...: windows of the speed that a coast-down fits in sequence."""

from __future__ import annotations

import re
from itertools import pairwise

from drivetool.cli.options.inputs import errors_as_usage
from drivetool.errors import BadOption
from drivetool.files.yaml import units

STAGES_OPTION = "--stages"
WINDOW_COUNTS = (2, 3)  # Two windows fit viscous and Coulomb friction, a third one the breakaway speeds.
_WINDOWS = re.compile(r"\s*([\d.:,\s]+?)\s*([A-Za-z%/^ ]*)\s*")


def windows_of(words: str, motion_unit: str) -> tuple[tuple[float, float], ...]:
    """'1600:750,750:300 rpm' as windows (high, low) [motion unit/s]; none of no words.

    raises  BadOption: no windows, an empty range, ranges that do not descend, a unit that is no speed
    """
    if not words:
        return ()

    wanted = f"{motion_unit}/s"
    usual = "rpm" if motion_unit == "rad" else wanted
    do = (f"Write for example '{STAGES_OPTION} 1600:750,750:300' in rpm, "
          f"or '{STAGES_OPTION} \"2:1,1:0.3 {wanted}\"'.")
    found = _WINDOWS.fullmatch(words)
    try:
        parts = [[float(number) for number in part.split(":")] for part in found[1].split(",")] if found else []
    except ValueError:
        parts = []
    if len(parts) not in WINDOW_COUNTS or any(len(part) != 2 for part in parts):
        raise BadOption(f"two or three windows HIGH:LOW after {STAGES_OPTION}", f"'{words}'", do)
    ends = [end for part in parts for end in part]
    if any(a < b for a, b in pairwise(ends)) or any(a == b for a, b in parts):
        raise BadOption(f"windows from fast to slow after {STAGES_OPTION}", f"'{words}'", do)
    with errors_as_usage():
        factor = units.conversion_factor(found[2].strip() or usual, wanted, STAGES_OPTION) if found else 1.0
    return tuple((factor * a, factor * b) for a, b in parts)
