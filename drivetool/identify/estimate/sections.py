"""What an estimate states beside its parameters; light, for files load it."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from drivetool.results import Shape


class StartsSection(Shape):
    """How the starts of the fit agreed."""

    tried: Annotated[int, Meta(description="descents from different starts")]
    agreed: Annotated[int, Meta(description="those that ended as good as the best")]
    spread: Annotated[dict[str, float], Meta(
        description="largest difference between the values that these ended at")] = {}
