"""How a difference is printed."""

from __future__ import annotations

import difflib
import math

MAX_DIFFERENCES = 8  # differences of one file that are printed


def short(value: object) -> str:
    """A value as text, cut where it is long."""
    text = str(value)
    return text if len(text) <= 160 else f"{text[:157]}..."


def relative(old: object, new: object) -> str:
    """By how much two numbers differ."""
    try:
        before, after = float(old), float(new)
    except (TypeError, ValueError):
        return ""
    known = before and math.isfinite(after - before)
    return f" (by {abs(after - before) / abs(before):.2g} of it)" if known else ""


def lines(old: str, new: str) -> list[str]:
    """A small difference of two texts."""
    found = [line for line in difflib.unified_diff(old.splitlines(), new.splitlines(), "before", "now", n=0)
             if not line.startswith(("---", "+++", "@@"))]
    if not found:
        return ["ends of lines differ"]
    return first(list(map(short, found)), 2 * MAX_DIFFERENCES)


def first(lines: list[str], count: int) -> list[str]:
    """The first of them, and how many more there are."""
    return [*lines[:count], f"and {len(lines) - count} more"] if len(lines) > count else lines
