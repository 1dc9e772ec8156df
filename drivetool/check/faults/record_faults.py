"""Faults of the record itself, tested before any model: outliers, resolution, channels.

Where a fault can be corrected (outliers become missing values, a sign is inverted), the rest of the
diagnosis works on the corrected records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from drivetool.check.faults.channel_ratio import (
    channel_ratio_by_rates,
    channel_ratio_by_travel,
    torque_sign_t_value,
)
from drivetool.check.faults.sensor_delay import speed_delay
from drivetool.check.faults.spikes import OUTPUTS, without_outliers
from drivetool.check.fit import MIN_ROUNDING_VARIANCE_SHARE, resolution
from drivetool.finding import Finding
from drivetool.identify.setup import white_std
from drivetool.logs import Experiment

# Steps of an angle per sample of fast motion (98 % quantile), from which its quantisation is white and belongs
# to the encoder (a choice).
MIN_STEPS_PER_SAMPLE, FAST_MOTION_QUANTILE = 10.0, 0.98
MIN_CHANNEL_SCALE_ERROR = 0.003  # relative. A choice: encoder ratios are exact, speed scales rarely this accurate
# Standard errors. A choice: several channels per record, and a false alarm changes the record.
SLOPE_SIGNIFICANCE = 6.0
MIN_DELAY_SAMPLES = 0.1  # samples of delay. A choice: a shorter one is below what later steps resolve


@dataclass(frozen=True)
class Fault:
    """A fault of the record, found without a model and without a likelihood ratio.

    code    of the cause; finding: its report
    record  name of the record; empty: all of them
    factor  of a channel over its right value; gear: ratio for the comparison of load and motor
    lag     of a filtered speed [s]; shaft: whether it is the shaft torque's
    """

    code: str
    finding: Finding
    record: str = ""
    factor: float = 1.0
    gear: float | None = None
    lag: float | None = None
    shaft: bool = False


def record_faults_of(experiments: Sequence[Experiment], wanted: Sequence[str], gear_ratio: float = 1.0,
              ) -> tuple[tuple[Experiment, ...], list[Fault]]:
    """(corrected experiments, faults).

    wanted      codes of the causes that may be named
    gear_ratio  turns of the motor for one of the load
    """
    mended, faults = [], []
    for e in experiments:
        if "outliers" in wanted:
            e, found = without_outliers(e)
            faults += [Fault("outliers", f) for f in found]
        if "quantisation" in wanted:
            faults += _quantisation_faults(e)
        faults += _delayed_speed(e, wanted)
        for test in (_speed_against_angle, partial(_load_against_motor, gear_ratio=gear_ratio)):
            e, found = test(e, wanted)
            faults += found
        mended.append(e)
    return tuple(mended), faults


def _quantisation_faults(e: Experiment) -> list[Fault]:
    return [Fault("quantisation", Finding(
        "note", "quantisation",
        f"{e.name}: the {role.replace('_', ' ')} is quantised in steps of {step:.3g} {e.unit(role)}; "
        f"quantisation is {100.0 * share:.0f} % of the variance of its noise.",
        {"resolution": step, "share_of_noise": share},
        "Log it with more digits, or log the angle." if role.endswith("speed") else
        "Log it with more digits, or from a finer sensor."))
            for role, step, share, fine in _quantised_channels(e) if not fine]


def encoder_step_findings(experiments: Sequence[Experiment]) -> list[Finding]:
    """Angles whose noise is largely encoder quantisation, with so many steps per sample that it is white."""
    return [Finding(
        "note", "encoder-quantisation",
        f"{e.name}: the {role.replace('_', ' ')} has encoder steps of {step:.3g} {e.unit(role)}; "
        f"quantisation is {100.0 * share:.0f} % of the variance of its noise; it is not a model error.",
        {"resolution": step, "share_of_noise": share},
        "A finer encoder makes smaller effects detectable.") for e in experiments
        for role, step, share, fine in _quantised_channels(e) if fine]


def _quantised_channels(e: Experiment) -> list[tuple[str, float, float, bool]]:
    """(sensor, its step, the share of quantisation in its noise variance, whether it is fine) where that is large.

    The noise of an encoder is often quantisation alone: that is a fault only with few steps per sample.
    """
    found = []
    for role in OUTPUTS:
        y = e.signals.get(role, np.zeros(0))
        y = y[np.isfinite(y)]
        step = resolution(y)
        if step is None:
            continue
        share = step**2 / 12.0 / max(white_std([y]) ** 2, 1e-300)
        if share > MIN_ROUNDING_VARIANCE_SHARE:
            fine = role.endswith("angle") and np.quantile(
                np.abs(np.diff(y)), FAST_MOTION_QUANTILE) > MIN_STEPS_PER_SAMPLE * step
            found.append((role, float(step), float(min(share, 1.0)), bool(fine)))
    return found


def _speed_against_angle(e: Experiment, wanted: Sequence[str]) -> tuple[Experiment, list[Fault]]:
    """Speeds against the angles of the same body: sign and scale."""
    signals, faults = dict(e.signals), []
    for body in ("motor", "load"):
        speed, angle = f"{body}_speed", f"{body}_angle"
        if speed not in signals or angle not in signals:
            continue
        factor, error = _snapped_to_minus_one(*channel_ratio_by_rates(signals, angle, speed, e.step, e.segments))
        code = _channel_fault_code(factor, error, wanted)
        if code is None:
            continue
        # The angle is taken as right: a wrong scale of speed is more frequent, and an encoder counts correctly.
        # The torque identifies which of two signs is wrong.
        inverted = factor < 0.0 and torque_sign_t_value(signals, speed, e.step, e.segments) > SLOPE_SIGNIFICANCE
        evidence = f" The torque agrees with the sign of the speed: the {body} angle has the wrong sign." * inverted
        faults.append(Fault(code, Finding(
            "warning", code,
            f"{e.name}: the logged {body} speed is {factor:.4g} times the derivative of the logged {body} angle."
            f"{evidence}",
            {"factor": float(factor), "std": float(error)},
            "Correct sign, unit or scale of one of the two in the channel map.")))
        if inverted:
            signals[angle], factor = -signals[angle], -factor
        signals[speed] = signals[speed] / factor
    return replace(e, signals=signals), faults


def _load_against_motor(e: Experiment, wanted: Sequence[str], gear_ratio: float) -> tuple[Experiment, list[Fault]]:
    """The motion of the load against that of the motor; the two differ by the twist of the shafts.

    Angles count correctly, and are used where there are any.
    """
    motor_roles, load_roles = motion_channels(e)
    if not motor_roles or not load_roles:
        return e, []
    factor, error = _snapped_to_minus_one(*(gear_ratio * each for each in channel_ratio_by_travel(
        e.signals, motor_roles[0], load_roles[0], e.step, e.segments)))
    code = _channel_fault_code(factor, error, wanted)
    if code is None:
        return e, []
    fault = load_fault(e, code, factor, error, gear_ratio)
    if factor < 0.0 and torque_sign_t_value(e.signals, motor_roles[0], e.step, e.segments) < -SLOPE_SIGNIFICANCE:
        fault = replace(fault, finding=fault.finding.replace(
            text=f"{fault.finding.text} The motor motion has the opposite sign to its torque.",
            action="Invert the sign of the motor's channels, or of the torque, in the channel map."))
        e, factor = channels_divided(e, motor_roles, -1.0), -factor
    return load_divided(e, factor), [fault]


def motion_channels(e: Experiment) -> tuple[list[str], list[str]]:
    """(channels of the motor's motion, of the load's), angles first."""
    here, there = ([f"{body}_{kind}" for kind in ("angle", "speed") if f"{body}_{kind}" in e.signals]
                   for body in ("motor", "load"))
    return here, there


def channels_divided(e: Experiment, roles: Sequence[str], factor: float) -> Experiment:
    """The record with some channels divided by a factor."""
    return replace(e, signals={**e.signals, **{role: e.signals[role] / factor for role in roles}})


def load_divided(e: Experiment, factor: float) -> Experiment:
    """The record with the motion of its load divided by a factor."""
    return channels_divided(e, motion_channels(e)[1], factor)


def load_fault(e: Experiment, code: str, factor: float, error: float, gear: float) -> Fault:
    """The fault of a load channel that is `factor` times the motor's channel over the gear ratio."""
    here, there = motion_channels(e)
    return Fault(code, Finding(
        "warning", code,
        f"{e.name}: the logged {there[0].replace('_', ' ')} is {factor:.4g} times the value computed from the "
        f"{here[0].replace('_', ' ')} and a gear ratio of {gear:.4g}.",
        {"factor": float(factor), "std": float(error), "gear": float(gear)},
        "Correct sign, unit or scale of the load's channel in the channel map, or the gear's ratio."),
        e.name, factor, gear)


def _delayed_speed(e: Experiment, wanted: Sequence[str]) -> list[Fault]:
    """A logged motor speed that is delayed against the rate of the logged motor angle."""
    delay = speed_delay(e)
    if "speed-filter" not in wanted or delay is None or delay.lag < max(
            SLOPE_SIGNIFICANCE * delay.std, MIN_DELAY_SAMPLES * e.step):
        return []
    return [Fault("speed-filter", Finding(
        "note", "speed-filter",
        f"{e.name}: the logged motor speed is {1000.0 * delay.lag:.3g} ms later than the derivative of the logged "
        "motor angle, as if low-pass filtered.", {"lag": delay.lag, "std": delay.std},
        "Log the speed before its filter, or take the angle."), e.name, lag=delay.lag)]


def _snapped_to_minus_one(factor: float, error: float) -> tuple[float, float]:
    """A factor and its standard error, minus one where it does not differ significantly: a sign has no scale."""
    return (-1.0 if abs(factor + 1.0) < max(MIN_CHANNEL_SCALE_ERROR, SLOPE_SIGNIFICANCE * error) else factor), error


def _channel_fault_code(factor: float, error: float, wanted: Sequence[str]) -> str | None:
    if not np.isfinite(factor) or factor == 0.0 or abs(factor - 1.0) < max(
            MIN_CHANNEL_SCALE_ERROR, SLOPE_SIGNIFICANCE * error):
        return None
    code = "wrong-sign" if factor < 0.0 and abs(abs(factor) - 1.0) < 0.3 else "wrong-scale"
    return code if code in wanted else None
