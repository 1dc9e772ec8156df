"""What a gains file has of a criterion, and of settings on other drives; light, for files load it."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from drivetool.results import Number, Shape


class CriterionSection(Shape):
    """What was minimised, for a step of load torque."""

    name: str
    weights: dict[str, float]


class VariationSection(Shape):
    """The same settings on a changed drive; null: unstable."""

    change: str
    max_sensitivity: Number
    impact_drop: Number
    overshoot_percent: Number


class SpreadSection(Shape):
    """The same settings over draws of the parameter covariance."""

    draws: int
    unphysical: int
    unstable: int
    parameters: list[str]
    above_limit: Annotated[float, Meta(description="share of the physical draws with Ms above the limit")]
    quantiles: Annotated[dict[str, dict[str, Number]], Meta(description="figure -> level; null: unstable")]
