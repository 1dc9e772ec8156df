"""Numbers of tables as text, in as many digits as are known."""

from __future__ import annotations

import math


def rounded(value: float | None, std: float | None) -> tuple[str, str]:
    """Value and +- to the same digit: two significant ones of the std.

    value, std  None where there is none
    returns     ('0.5871', '0.0012'); '-' where there is none
    """
    if value is None:
        return "-", "-" if std is None else f"{std:.1e}"
    if not std:
        return short(value, 5), "-" if std is None else "0"
    last = int(f"{std:.1e}".partition("e")[2]) - 1  # power of ten of the last digit shown
    if -6 <= last <= 3 and abs(value) < 1e7:
        return f"{round(value, -last):.{max(0, -last)}f}", f"{round(std, -last):.{max(0, -last)}f}"
    first = math.floor(math.log10(abs(value))) if value else last + 1
    return f"{value:.{max(0, first - last)}e}", f"{std:.1e}"


def percent(value: float | None, std: float | None) -> str:
    """The std in % of the value."""
    if not value or std is None:
        return "-"
    share = 100 * std / abs(value)
    return f"{share:.0f}" if 10 <= share < 1e4 else f"{share:#.2g}"


def short(value: float | int | None, digits: int = 4) -> str:
    """A number in a few digits; '-' where there is none."""
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.{digits}g}"


def narrow(value: float | None, digits: int = 4) -> str:
    """A number in a few digits, its exponent without what only costs width."""
    text = "-" if value is None else f"{value:.{digits}g}"
    return text.replace("e+0", "e").replace("e+", "e").replace("e-0", "e-")
