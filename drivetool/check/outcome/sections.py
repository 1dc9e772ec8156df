"""What a diagnosis states of its verdict and its gain; light, for files load it."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from drivetool.results import Number, Shape

Verdict = Literal["nothing-found", "named", "undetermined", "unexplained"]
State = Literal["named", "possible", "worse", "no-gain", "not-shown", "in-the-model", "failed"]


class GainSection(Shape):
    """How much better free runs over data held out became, or the torque that a motion asks for."""

    unit: Annotated[str, Meta(description="of rmse, its std and the noise floor")]
    of: Annotated[Literal["motion", "torque"], Meta(
        description="motion: errors of free runs; torque: of what the motion asks for")] = "motion"
    segment: Annotated[Number, Meta(description="length of the free runs in s")] = None
    held_out_rmse_before: Annotated[Number, Meta(description="of the base, fitted to all that is no judge")] = None
    held_out_rmse_after: Annotated[
        Number, Meta(description="of the extended drive, fitted without what it is run over")] = None
    rmse_std: Annotated[Number, Meta(description="standard error of rmse before - after")] = None
    rmse_gain_ci95: Annotated[tuple[Number, Number] | None, Meta(
        description="95 % interval of rmse before - after on a further record of the same length")] = None
    held_out_fit_before: Annotated[Number, Meta(description="percent")] = None
    held_out_fit_after: Annotated[Number, Meta(description="percent")] = None
    noise_floor: Annotated[Number, Meta(description="std of the sensor alone")] = None
    unexplained_percent: Annotated[
        Number, Meta(description="share of what the base left unexplained that is still there")] = None
