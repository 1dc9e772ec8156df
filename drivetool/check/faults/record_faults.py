"""Faults of the record itself, found before any model is blamed: outliers, resolution, channels.

Where a fault can be undone (outliers become missing values, a sign is turned), the rest of the
diagnosis works on the mended records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from drivetool.check.faults.agreement import agreement, pushed, travelled
from drivetool.check.faults.lateness import lag_of
from drivetool.check.faults.spikes import OUTPUTS, without_outliers
from drivetool.check.fit import COARSE, resolution
from drivetool.errors import Finding
from drivetool.identify.setup import white_std
from drivetool.logs import Experiment

FINE, FASTEST = 10.0, 0.98  # steps of an angle in a sample of fast motion, from which they are a sensor's own
SCALE = 0.003  # relative error of a channel below which it is not blamed
SURE = 6.0  # standard errors of a slope
LATE = 0.1  # samples of delay below which a speed is not called late


@dataclass(frozen=True)
class Fault:
    """A fault of the record, which is read off it and has no likelihood ratio.

    code    of the cause; finding: what to say
    record  name of the record; empty: all of them
    factor  of a channel over what it should be; gear: by which the load was held against the motor
    lag     of a filtered speed [s]; shaft: whether it is the shaft torque's
    """

    code: str
    finding: Finding
    record: str = ""
    factor: float = 1.0
    gear: float | None = None
    lag: float | None = None
    shaft: bool = False


def preflight(experiments: Sequence[Experiment], wanted: Sequence[str], turns: float = 1.0,
              ) -> tuple[tuple[Experiment, ...], list[Fault]]:
    """(mended experiments, faults).

    wanted  codes of the causes that may be named
    turns   of the motor for one of the load
    """
    mended, faults = [], []
    for e in experiments:
        if "outliers" in wanted:
            e, found = without_outliers(e)
            faults += [Fault("outliers", f) for f in found]
        if "quantisation" in wanted:
            faults += _quantisation(e)
        faults += _filtered(e, wanted)
        for look in (_channels, partial(_ends, turns=turns)):
            e, found = look(e, wanted)
            faults += found
        mended.append(e)
    return tuple(mended), faults


def _quantisation(e: Experiment) -> list[Fault]:
    return [Fault("quantisation", Finding(
        "note", "quantisation",
        f"{e.name}: the {role.replace('_', ' ')} is logged in steps of {step:.3g} {_unit(e, role)}; that is "
        f"{100.0 * share:.0f} % of the variance of its noise.",
        {"resolution": step, "share_of_noise": share},
        "Log it with more digits, or log the angle." if role.endswith("speed") else
        "Log it with more digits, or from a finer sensor.")) for role, step, share, fine in _rounded(e) if not fine]


def fine_steps(experiments: Sequence[Experiment]) -> list[Finding]:
    """Angles whose noise is much of it their encoder's steps, in motion over so many that these are white."""
    return [Finding(
        "note", "encoder-steps",
        f"{e.name}: the {role.replace('_', ' ')} is counted in steps of {step:.3g} {_unit(e, role)}; that is "
        f"{100.0 * share:.0f} % of the variance of its noise, and nothing that the simulation gets wrong.",
        {"resolution": step, "share_of_noise": share},
        "A finer encoder would show smaller effects.") for e in experiments
        for role, step, share, fine in _rounded(e) if fine]


def _rounded(e: Experiment) -> list[tuple[str, float, float, bool]]:
    """(sensor, its step, the step's share of the variance of its noise, whether it is fine) where that is much.

    The noise of an encoder is often nothing else: that is a fault only where it makes few steps a sample.
    """
    found = []
    for role in OUTPUTS:
        y = e.signals.get(role, np.zeros(0))
        y = y[np.isfinite(y)]
        step = resolution(y)
        if step is None:
            continue
        share = step**2 / 12.0 / max(white_std([y]) ** 2, 1e-300)
        if share > COARSE:
            fine = role.endswith("angle") and np.quantile(np.abs(np.diff(y)), FASTEST) > FINE * step
            found.append((role, float(step), float(min(share, 1.0)), bool(fine)))
    return found


def _unit(e: Experiment, role: str) -> str:
    units = {"speed": f"{e.motion_unit}/s", "angle": e.motion_unit}
    return units.get(role.rpartition("_")[2], e.torque_unit)


def _channels(e: Experiment, wanted: Sequence[str]) -> tuple[Experiment, list[Fault]]:
    """Speeds against the angles of the same body: sign and scale."""
    signals, faults = dict(e.signals), []
    for body in ("motor", "load"):
        speed, angle = f"{body}_speed", f"{body}_angle"
        if speed not in signals or angle not in signals:
            continue
        factor, error = _plain(*agreement(signals, angle, speed, e.step, e.segments))
        code = _code(factor, error, wanted)
        if code is None:
            continue
        # The angle counts on: a scale of speed is the commoner mistake, and an encoder counts right. Which of two
        # signs is wrong the torque tells.
        turned = factor < 0.0 and pushed(signals, speed, e.step, e.segments) > SURE
        known = f" The torque drives it as the speed says: it is the {body} angle that is upside down." * turned
        faults.append(Fault(code, Finding(
            "warning", code,
            f"{e.name}: the logged {body} speed is {factor:.4g} times the rate of the logged {body} angle.{known}",
            {"factor": float(factor), "std": float(error)},
            "Correct sign, unit or scale of one of the two in the channel map.")))
        if turned:
            signals[angle], factor = -signals[angle], -factor
        signals[speed] = signals[speed] / factor
    return replace(e, signals=signals), faults


def _ends(e: Experiment, wanted: Sequence[str], turns: float) -> tuple[Experiment, list[Fault]]:
    """The motion of the load against that of the motor, which differs by what the shafts twist.

    Angles count right, and are looked at where there are any.
    """
    here, there = of_both_ends(e)
    if not here or not there:
        return e, []
    factor, error = _plain(*(turns * each for each in travelled(
        e.signals, here[0], there[0], e.step, e.segments)))
    code = _code(factor, error, wanted)
    if code is None:
        return e, []
    fault = load_fault(e, code, factor, error, turns)
    if factor < 0.0 and pushed(e.signals, here[0], e.step, e.segments) < -SURE:
        fault = replace(fault, finding=replace(
            fault.finding, text=f"{fault.finding.text} It is the motor's that runs against its torque.",
            action="Turn the sign of the motor's channels, or of the torque, in the channel map."))
        e, factor = over(e, here, -1.0), -factor
    return load_over(e, factor), [fault]


def of_both_ends(e: Experiment) -> tuple[list[str], list[str]]:
    """(channels of the motor's motion, of the load's), angles first."""
    here, there = ([f"{body}_{kind}" for kind in ("angle", "speed") if f"{body}_{kind}" in e.signals]
                   for body in ("motor", "load"))
    return here, there


def over(e: Experiment, roles: Sequence[str], factor: float) -> Experiment:
    """The record with some channels divided by a factor."""
    return replace(e, signals={**e.signals, **{role: e.signals[role] / factor for role in roles}})


def load_over(e: Experiment, factor: float) -> Experiment:
    """The record with the motion of its load divided by a factor."""
    return over(e, of_both_ends(e)[1], factor)


def load_fault(e: Experiment, code: str, factor: float, error: float, gear: float) -> Fault:
    """The load's channel that is `factor` times what the motor's says by a gear."""
    here, there = of_both_ends(e)
    return Fault(code, Finding(
        "warning", code,
        f"{e.name}: the logged {there[0].replace('_', ' ')} is {factor:.4g} times what the "
        f"{here[0].replace('_', ' ')} says, by a gear of {gear:.4g}.",
        {"factor": float(factor), "std": float(error), "gear": float(gear)},
        "Correct sign, unit or scale of the load's channel in the channel map, or the gear's ratio."),
        e.name, factor, gear)


def _filtered(e: Experiment, wanted: Sequence[str]) -> list[Fault]:
    """A logged motor speed that comes later than the rate of the logged motor angle."""
    late = lag_of(e)
    if "speed-filter" not in wanted or late is None or late.lag < max(SURE * late.std, LATE * e.step):
        return []
    return [Fault("speed-filter", Finding(
        "note", "speed-filter",
        f"{e.name}: the logged motor speed comes {1000.0 * late.lag:.3g} ms after the rate of the logged motor "
        "angle, as behind a low-pass.", {"lag": late.lag, "std": late.std},
        "Log the speed before its filter, or take the angle."), e.name, lag=late.lag)]


def _plain(factor: float, error: float) -> tuple[float, float]:
    """A factor and its standard error, minus one where it is not to be told from that: a sign has no scale."""
    return (-1.0 if abs(factor + 1.0) < max(SCALE, SURE * error) else factor), error


def _code(factor: float, error: float, wanted: Sequence[str]) -> str | None:
    if not np.isfinite(factor) or abs(factor - 1.0) < max(SCALE, SURE * error) or factor == 0.0:
        return None
    code = "wrong-sign" if factor < 0.0 and abs(abs(factor) - 1.0) < 0.3 else "wrong-scale"
    return code if code in wanted else None
