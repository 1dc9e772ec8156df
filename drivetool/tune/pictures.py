"""The data of the pictures of tune; files/figures/tune_figures.py draws them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivetool.quantity import name_of
from drivetool.tune.gains import Design, Gains
from drivetool.tune.optimisation import Draws, FigureSpread, criterion_values, impact_drops, signals
from drivetool.tune.remarks import gain_unit
from drivetool.tune.simulation import DisturbanceResponse
from drivetool.tune.speed_loop import Loop, Plant, build, plant, with_fine_peaks

# Of a plane, over a factor of 64. A choice: finer contours cost time with the square of it.
POINTS_PER_AXIS = 72


@dataclass(frozen=True)
class GainTimeMap:
    """Figures over integral time and gain on logarithmic axes; infinite where the loop is unstable.

    kind      criterion-plane or impact-drop-plane
    panels    title -> (gains, times) values, one panel each
    ms        (gains, times) sensitivity
    optimum   (Ti, Kp); limit: of Ms
    """

    kind: str
    title: str
    times: np.ndarray
    gains: np.ndarray
    gain_unit: str
    panels: Mapping[str, np.ndarray]
    ms: np.ndarray
    optimum: tuple[float, float]
    limit: float


@dataclass(frozen=True)
class LoadStep:
    """Responses to a step of load torque, all designs on one time axis.

    speeds, torques  label -> (time, value); bands: label -> (time, lowest, highest) over the draws
    """

    kind: str
    title: str
    speed_label: str
    torque_label: str
    speeds: Mapping[str, tuple[np.ndarray, np.ndarray]]
    torques: Mapping[str, tuple[np.ndarray, np.ndarray]]
    bands: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Frequencies:
    """Loop gains over frequency, nominal first, for the Nichols and the sensitivity picture.

    curves  label -> (frequency [Hz], L)
    """

    kind: str
    title: str
    curves: Mapping[str, tuple[np.ndarray, np.ndarray]]
    limit: float


@dataclass(frozen=True)
class SpreadPicture:
    """Histograms of the spread."""

    kind: str
    title: str
    spread: FigureSpread
    nominal: Mapping[str, float]
    units: Mapping[str, str]
    limit: float


@dataclass(frozen=True)
class LimitCyclePlotData:
    """The nonlinear drive after kicks; half_gap of the last shaft, zero if it has none."""

    kind: str
    title: str
    watches: tuple[DisturbanceResponse, ...]
    speed_unit: str
    torque_unit: str
    half_gap: float


def pictures(gains: Gains, draws: Draws | None) -> tuple[object, ...]:
    """The data of all pictures of all designs."""
    found: list[object] = []
    several = len(gains.designs) > 1
    for design in gains.designs:
        name = design.wiring.configuration if several else ""
        prefix = f"{name}-" if several else ""
        heading = f"{name}: " if several else ""
        loop = build(gains.drive, design.wiring)
        own_plant = plant(gains.drive, design.wiring)
        found += planes(gains, design, loop, own_plant, prefix, heading)
        found.append(frequencies(
            "nichols", prefix, f"{heading}Nichols chart: nominal loop and varied parameters", gains, design))
        found.append(frequencies(
            "sensitivity", prefix, f"{heading}Sensitivity function", gains, design))
        if design.spread:
            found.append(_spread_picture(gains, design, prefix, heading))
        if design.watches:
            found.append(LimitCyclePlotData(
                f"{prefix}hunting", f"{heading}Response of the nonlinear loop to an impact", design.watches,
                f"{gains.drive.motion_unit}/s", gains.drive.torque_unit,
                gains.drive.value(name_of(gains.drive.shafts[-1], "half_gap")) or 0.0))
    found.insert(0, load_step(gains, draws))
    return tuple(found)


def planes(gains: Gains, design: Design, loop: Loop, own_plant: Plant, prefix: str,
           heading: str) -> list[GainTimeMap]:
    """The criterion, and both impact drops, over Ti and Kp around the optimum."""
    options, best = gains.options, design.settings
    times = best.integral_time * np.geomspace(1.0 / 8.0, 8.0, POINTS_PER_AXIS)
    kps = best.gain * np.geomspace(1.0 / 8.0, 8.0, POINTS_PER_AXIS)
    ti, kp = (grid.ravel() for grid in np.meshgrid(times, kps))
    second = np.full_like(ti, best.second)
    shape = (POINTS_PER_AXIS, POINTS_PER_AXIS)
    ms = sensitivities(own_plant, times, kps, best.second)
    cost = criterion_values(loop, options.criterion, kp, ti, second).reshape(shape)
    ms = np.where(np.isfinite(cost), ms, np.inf)
    drops = impact_drops(loop, ["motor_speed", "load_speed"], kp, ti, second).reshape(*shape, 2)
    unit = gain_unit(gains.drive)
    at, limit = (best.integral_time, best.gain), options.limits.sensitivity
    drop_unit = f"[{gains.drive.motion_unit}/{gains.drive.torque_unit}]"
    return [
        GainTimeMap(f"{prefix}criterion-plane",
                    f"{heading}{options.criterion.name} of the load speed for a unit load step",
                    times, kps, unit, {options.criterion.name: cost}, ms, at, limit),
        GainTimeMap(f"{prefix}impact-drop-plane", f"{heading}Impact drop {drop_unit}", times, kps, unit,
                    {"motor speed": drops[..., 0], "load speed": drops[..., 1]}, ms, at, limit)]


def sensitivities(own: Plant, times: np.ndarray, kps: np.ndarray, second: float) -> np.ndarray:
    """(gains, times) Ms on the frequencies of the plant."""
    return np.column_stack([1.0 / np.abs(1.0 + np.outer(kps, own.shape(ti, second))).min(axis=1) for ti in times])


def load_step(gains: Gains, draws: Draws | None) -> LoadStep:
    """Speeds and torques; per unit with ratings, else for a unit step."""
    drive, ratings = gains.drive, gains.options.ratings
    torque, speed = (ratings.torque, ratings.speed / 100.0) if ratings else (1.0, 1.0)
    end = 1.3 * max(max(d.factors.load.settling_time, d.factors.motor.settling_time) for d in gains.designs)
    time = np.linspace(0.0, end, 1500)
    speeds, torques, bands = {}, {}, {}
    for design in gains.designs:
        name = f"{design.wiring.configuration} " if len(gains.designs) > 1 else ""
        names = ["motor_speed", "load_speed", *(f"{m}_torque" for m in design.wiring.motors)]
        found = signals(build(drive, design.wiring), design.settings, names)
        if len(gains.designs) == 1:
            speeds["motor speed"] = (time, found["motor_speed"].at(time) * torque / speed)
        speeds[f"{name}load speed"] = (time, found["load_speed"].at(time) * torque / speed)
        kinds = design.wiring.motors if design.wiring.configuration != "siso" else design.wiring.motors[:1]
        for motor in kinds:
            label = f"{name}{motor} torque" + (" (each)" if len(design.wiring.motors) > len(kinds) else "")
            torques[label] = (time, found[f"{motor}_torque"].at(time) * (100.0 if ratings else 1.0))
        if draws and len(gains.designs) == 1:
            bands["load speed"] = _load_speed_band(draws, design, time, torque / speed)
    step = "the rated torque" if ratings else f"1 {drive.torque_unit}"
    return LoadStep(
        "load-step", f"A load-torque step of {step}",
        "speed error [%]" if ratings else f"speed error [({drive.motion_unit}/s)/{drive.torque_unit}]",
        "motor torque [%]" if ratings else f"motor torque [{drive.torque_unit}/{drive.torque_unit}]",
        speeds, torques, bands)


def _load_speed_band(draws: Draws, design: Design, time: np.ndarray, scale: float) -> tuple[np.ndarray, ...]:
    """Bounds of the load speed in 90 % of the draws."""
    found = []
    for drive in draws.drives:
        speed = signals(build(drive, design.wiring), design.settings, ["load_speed"])["load_speed"]
        found.append(speed.at(time) * scale if speed.stable else np.full_like(time, np.nan))
    low, high = np.nanquantile(np.array(found), [0.05, 0.95], axis=0)
    return time, low, high


def frequencies(kind: str, tag: str, title: str, gains: Gains, design: Design) -> Frequencies:
    """The loop gain, nominal and varied."""
    return Frequencies(f"{tag}{kind}", title, {
        each.change: loop_curve(plant(each.drive, design.wiring), design) for each in design.variations},
        gains.options.limits.sensitivity)


def loop_curve(own: Plant, design: Design) -> tuple[np.ndarray, np.ndarray]:
    """(frequency [Hz], L)."""
    fine = with_fine_peaks(own, design.settings)
    return fine.w / (2.0 * np.pi), fine.loop_gain(design.settings)


def _spread_picture(gains: Gains, design: Design, prefix: str, heading: str) -> SpreadPicture:
    nominal = {"max_sensitivity": design.margins.max_sensitivity, "impact_drop": design.factors.load.impact_drop,
               "overshoot": design.factors.load.overshoot}
    units = {"max_sensitivity": "Ms", "overshoot": "overshoot of the load speed [%]",
             "impact_drop": f"impact drop of the load speed [{gains.drive.motion_unit}/{gains.drive.torque_unit}]"}
    return SpreadPicture(f"{prefix}spread", f"{heading}Performance over draws of the parameter covariance",
                         design.spread, nominal, units, gains.options.limits.sensitivity)


