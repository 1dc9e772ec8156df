"""What a gains file has of a loop's margins; light, for files load it."""

from __future__ import annotations

from drivetool.results import Number, Shape


class MarginsSection(Shape):
    """null: nothing crosses, so the margin is infinite."""

    max_sensitivity: float
    sensitivity_frequency_hz: float
    gain_margin: Number
    gain_reduction_margin: Number
    phase_margin_deg: Number
    crossover_hz: Number
    delay_margin_s: Number
