"""What a validation states of a model on a record; light, for files load it."""

from __future__ import annotations

from typing import Annotated

from msgspec import UNSET, Meta, UnsetType

from drivetool.results import Number, Shape


class CheckSection(Shape):
    """One model on one record it has not seen."""

    model: str
    file: str
    output: str
    unit: str
    simulation_fit_percent: Annotated[
        Number, Meta(description="of a free run, its start state fitted; null for a constant signal")]
    one_step_fit_percent: Annotated[
        Number, Meta(description="of one-step predictions; not a simulation")]
    rmse: Annotated[Number, Meta(description="of that free run, in unit")]
    nrmse: Annotated[Number, Meta(description="rmse over the range of the output")]
    r2: Number
    n: int
    max_correlation: Annotated[
        Number, Meta(description="largest cross-correlation of residual and input")]
    band: Annotated[Number, Meta(description="97 % band for one lag, Bartlett-corrected")]
    lags_outside_percent: Number
    correlation_p: Annotated[Number, Meta(description="family-wise, over all the lags")]
    whiteness_p: Annotated[Number, Meta(description="of the one-step errors, information only")]
    passed: bool
    measured_start_fit_percent: Annotated[
        Number, Meta(description="of a free run from the state of the first samples; null for segments")] = None
    measured_start_rmse: Annotated[Number, Meta(description="of that free run, in unit")] = None
    rmse_percent: Annotated[Number, Meta(
        description="by inverse dynamics: rmse over the root mean square of the torque")] = None
    free_run_length: Annotated[float | UnsetType, Meta(
        description="of a drive with backlash: length in s of the free runs that its noise allows")] = UNSET
    rmse_counts: Annotated[float | UnsetType, Meta(
        description="of an angle by counts: rmse over count/sqrt(12); 1 is what counts alone leave")] = UNSET
    nrmse_mean: Annotated[float | UnsetType, Meta(
        description="of a run-down's speed: rmse over its mean; nrmse is over its range")] = UNSET
    sensor_rmse: Annotated[float | UnsetType, Meta(
        description="of a run-down: rmse that the sensor alone leaves, in unit")] = UNSET
    parameters_rmse: Annotated[float | UnsetType, Meta(
        description="of a run-down: rmse that the uncertainty of the parameters makes, in unit")] = UNSET
