"""Report of the steady step on its friction lines: parameters, findings and plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import Parameter, PlotData, line_of
from drivetool.identify.plateaus.intervals import speed_of
from drivetool.identify.plateaus.line import FrictionLine, fit_line
from drivetool.identify.plateaus.points import SteadyPoints
from drivetool.identify.setup import supply_of
from drivetool.logs import Experiment
from drivetool.quantity import name_of, owner_of

MAX_PLOTTED_SAMPLES = 500  # samples of a recording that a plot resolves, a choice by its width in pixels
CURVE_POINTS = 50  # of a line with drag in a plot, a choice: it looks smooth
# Half-widths of the 95 % interval of a significant drag: four standard deviations of normal noise, as at constant
# torque.
MIN_DRAG_HALF_WIDTHS = 2.0


@dataclass(frozen=True)
class LineTask:
    """One friction line and the parameters it gives.

    torque, speed  roles that are plotted over each other; "difference" is motor less shaft torque
    body           whose friction it is; None: of all bodies together
    names          key of the line -> parameter that takes it; None if it is held
    held           key -> value of what is held entirely
    start          key -> value to assume where the points do not identify it
    carried        key -> part of it that parameters held by the user carry
    """

    torque: str
    speed: str
    body: str | None
    names: Mapping[str, str | None]
    held: Mapping[str, float]
    start: Mapping[str, float]
    carried: Mapping[str, float]

    @property
    def what(self) -> str:
        """The line in words."""
        torque = "motor less shaft torque" if self.torque == "difference" else self.torque.replace("_", " ")
        return f"{torque} over {self.speed.replace('_', ' ')}"


def line_parameter(name: str, key: str, task: LineTask, points: SteadyPoints, line: FrictionLine,
                   drive: Drive) -> Parameter:
    """One part of the line as a parameter."""
    found = line_of(drive, name, line.values[key])
    if found.start is None and owner_of(name) == "total":
        found = found.replace(start=task.start.get(key))
    if key in line.at_bound and "drag" not in line.conditional:  # which may have made it negative
        free, std = line.at_bound[key]
        return found.replace(value=free).beyond_bound(
            0.0, line.quantile * std,
            f"estimated as {free:.4g} +- {std:.2g} {found.unit}; friction cannot be negative")
    if key in line.conditional:
        return found.without_interval(_why_not_identifiable(key, points, line), "not-identifiable")
    if key not in line.free:
        return found.without_interval("one direction only: included in the idle torque; steady running in both "
                                      "directions separates them", "not-identifiable")
    at = line.free.index(key)
    std = float(np.sqrt(line.covariance[at, at]))
    return found.with_interval(std, half_width=line.quantile * std)


def _why_not_identifiable(key: str, points: SteadyPoints, line: FrictionLine) -> str:
    """Why a part of the line is not identifiable."""
    speeds, more = _few_speeds(points, line)
    if key in ("viscous", "drag") and key not in line.free:
        return f"all intervals are at {speeds}: assumed; run at {more}"
    names = {"viscous": "viscous friction", "drag": "drag"}
    assumed, what = next(pair for pair in names.items() if pair[0] in line.conditional and pair[0] not in line.free)
    return (f"identifiable only jointly with the {what} (assumed {line.values[assumed]:.4g}), because "
            f"all intervals are at {speeds}; run at {more}")


def _few_speeds(points: SteadyPoints, line: FrictionLine) -> tuple[str, str]:
    """(the speeds that there are, those that it takes) in words, where they do not determine a line."""
    levels = sorted(set(points.levels))
    speeds = f"one speed ({float(np.mean(points.levels)):.4g})" if len(levels) == 1 else \
        f"{len(levels)} speeds ({', '.join(f'{level:.4g}' for level in levels)})"
    return speeds, f"{'three' if 'drag' in line.conditional else 'two'} or more speeds"


def line_findings(task: LineTask, points: SteadyPoints, line: FrictionLine, drive: Drive,
                  intervals: int) -> list[Finding]:
    """The findings on one line."""
    found = []
    unit = drive.torque_unit
    forward, backward = int(np.sum(points.speed > 0)), int(np.sum(points.speed < 0))
    if 0 in (forward, backward) and None not in (task.names["idle_torque"], task.names["coulomb"]):
        found.append(one_direction_finding(str(task.names["idle_torque"]), forward, backward))
    if line.conditional:
        speeds, more = _few_speeds(points, line)
        conditional_names = " and ".join(task.names[key] for key in line.conditional)
        found.append(Finding(
            "warning", "single-speed",
            f"All steady intervals are at {speeds}, so {conditional_names} "
            "cannot be separated.",
            {"speed": float(np.mean(points.levels)), "torque": float(np.mean(points.torque))},
            f"Record steady intervals at {more}, as different as possible."))
    for key, (value, std) in line.at_bound.items():
        name = task.names[key]
        found.append(Finding(
            "warning" if value < -2 * std else "note", "negative-estimate",
            f"The estimate of {name} is negative ({value:.4g} +- {std:.2g}) and was set to zero.",
            {"value": value, "std": std},
            "Check for friction that falls with speed (Stribeck), a load that changes, or a wrong sign.", name))
    if line.unexplained:
        found.append(Finding(
            "warning", "scatter-beyond-noise", f"The steady points ({task.what}) scatter {line.rmse:.3g} "
            f"{unit} about the line, {line.inflation:.2g} times what the noise explains; the intervals are "
            "widened by that.", {"chi2": line.chi2, "dof": line.dof, "probability": line.probability,
                                 "inflation": line.inflation},
            "Look at the picture: a bend is friction that is not linear, scatter at equal speed a load that "
            "changes."))
    found += _drag_findings(task, points, drive)
    still = intervals - len(points.speed)
    if still:
        found.append(Finding(
            "note", "stretches-left-out", f"{still} steady intervals at standstill are left out: static "
            "friction there balances any torque.", {"intervals": still}))
    return found


def _drag_findings(task: LineTask, points: SteadyPoints, drive: Drive) -> list[Finding]:
    """A finding where the torque has a significant quadratic term that is not fitted."""
    if task.names["drag"] is not None:
        return []
    held = {key: value for key, value in task.held.items() if key != "drag"}
    bent, name = fit_line(points, held, task.start, task.carried), name_of(task.body or drive.bodies[0], "drag")
    if bent.conditional or "drag" not in bent.free:
        return []
    drag, std = bent.values["drag"] - task.held["drag"], float(np.sqrt(bent.covariance[-1, -1]))
    if drag < MIN_DRAG_HALF_WIDTHS * bent.quantile * std:
        return []
    return [Finding(
        "warning", "nonlinear-friction", f"The torque ({task.what}) grows with the square of the speed: {drag:.3g} "
        f"+- {std:.2g} {drive.unit(name)}. The fitted law does not include it.", {"drag": drag, "std": std},
        f"Fit it, the law of a fan or a pump, with --free {name}. Friction that falls at low speed (Stribeck) "
        "bends the line likewise: look at the picture.")]


def coulomb_body_findings(task: LineTask, drive: Drive) -> list[Finding]:
    """That steady running does not identify on which body the Coulomb friction acts."""
    if len(drive.bodies) == 1:
        return []
    return [Finding(
        "note", "location-not-identifiable", f"{task.names['coulomb']} is the sum of the Coulomb friction of "
        "all bodies; steady running does not identify where it acts.", {},
        "Record many slow reversals, or log the shaft torque.")]


def point_list(task: LineTask, points: SteadyPoints) -> list[dict[str, object]]:
    """The points as plain numbers."""
    return [{"line": task.what, "file": i.file, "start": i.start, "end": i.end,
             "speed": float(w), "speed_std": float(sw), "torque": float(t), "torque_std": float(st)}
            for i, w, sw, t, st in zip(points.intervals, points.speed, points.speed_std, points.torque,
                                       points.torque_std, strict=True)]


def steady_plots(experiments: Sequence[Experiment], results: Sequence[tuple[LineTask, SteadyPoints, FrictionLine]],
             drive: Drive) -> tuple[PlotData, ...]:
    """The points with their line, and every record with the steady intervals marked."""
    motion, unit = drive.motion_unit, drive.torque_unit
    plots = []
    for task, points, line in results:
        curves = {"points": (points.speed, points.torque), "std": (points.speed, np.sqrt(points.variance))}
        for sign, label in ((1, "fit forward"), (-1, "fit backward")):
            side = points.speed[np.sign(points.speed) == sign]
            if len(side):
                count = 2 if line.values["drag"] + line.carried.get("drag", 0.0) == 0.0 else CURVE_POINTS
                speeds = sign * np.linspace(1e-6, 1.05, count) * np.abs(side).max()
                curves[label] = (speeds, line.torque(speeds))
        plots.append(PlotData("steady", f"Steady points: {task.what}", f"speed [{motion}/s]",
                             f"torque [{unit}]", curves))
    spans = results[0][1].intervals  # two lines are drawn through the same ones
    for e in experiments:
        inside = [tuple(max(round((t - e.offset) / e.step), 0) for t in (span.start, span.end))
                  for span in spans if span.file == e.name]
        plots.append(record_plot("steady intervals", e, inside, drive))
    return tuple(plots)


def record_plot(what: str, experiment: Experiment, spans: Sequence[tuple[int, ...]], drive: Drive) -> PlotData:
    """A recording with some of its samples, (first, last+1) each, marked as what they are."""
    # Over one sample an encoder's quantisation would hide the speed.
    spacing = max(1, experiment.size // MAX_PLOTTED_SAMPLES)
    time, speed = experiment.time, speed_of(experiment, "motor", "the picture", spacing)
    marked = np.full(len(speed), np.nan)
    for first, last in spans:
        marked[first:last] = speed[first:last]
    supply = supply_of(experiment)
    acts = {f"torque [{drive.torque_unit}]": experiment.signals[role]
            for role in ("motor_torque",) if role in experiment.signals} if supply is None else {
                "voltage, peak [V]": supply}
    return PlotData(
        "record", f"{what[0].upper()}{what[1:]} in {experiment.name}", "time [s]",
        f"motor speed [{drive.motion_unit}/s]",
        {"measured speed": (time, speed), what: (time, marked)} | {n: (time, v) for n, v in acts.items()})


def one_direction_finding(idle: str, forward: int, backward: int) -> Finding:
    """That an idle torque has the Coulomb friction in it; idle: its name; the intervals of either direction."""
    return Finding(
        "note", "idle-torque-not-separable", "All steady intervals have one direction of motion, so idle "
        f"torque and Coulomb friction cannot be separated; {idle} holds the idle torque "
        f"{'plus' if forward else 'less'} the Coulomb friction.", {"forward": forward, "backward": backward},
        "Add steady intervals in the other direction, if the machine may turn that way.")
