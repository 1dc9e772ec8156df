"""The base of every result: a frozen struct, whose fields carry unit and meaning for files, schemas and pages."""

from __future__ import annotations

from typing import Any, Self

import msgspec

Number = float | None


class Shape(msgspec.Struct, forbid_unknown_fields=True, kw_only=True, frozen=True):
    """Base of every section: a key nobody knows is a typo, hence an error."""

    def replace(self, **changes: Any) -> Self:
        """The same with other values of some fields."""
        return msgspec.structs.replace(self, **changes)
