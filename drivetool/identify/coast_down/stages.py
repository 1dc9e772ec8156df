"""A coast-down fitted window by window, as published procedures do, and its difference from the joint fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import BadOption, NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.coast_down.coast_down_fit import NO_PRIOR, CoastDownFit, Prior, Run, fit, run_of
from drivetool.identify.coast_down.readings import COUNTS_AROUND
from drivetool.identify.coast_down.report import coast_down_plots, fit_figures, ratio_lines
from drivetool.identify.coast_down.stretches import Stretch
from drivetool.identify.estimate import Z95, Estimate, Parameter
from drivetool.logs import Experiment
from drivetool.quantity import quantity_of

VISCOUS, COULOMB = "motor.viscous", "motor.coulomb"
SECOND_WINDOW = ("coulomb", "idle_torque", "breakaway", "stribeck")  # fitted by the second window
# Fitted by the last window: the speed at which a surplus of friction begins.
LAST_WINDOW = ("breakaway_speed", "stribeck_speed")
MIN_WINDOW_READINGS = 4 * COUNTS_AROUND  # counts are placed by COUNTS_AROUND readings on either side
STAGED_FIT_REASON = "a staged fit holds the parameters of later windows: its error is systematic, not noise"


@dataclass(frozen=True)
class JointFit:
    """The joint fit of all parameters, with which a staged one is compared.

    starts  start values, one set per start of the fit; ended: where it ended
    known   values that a person or a file gave, in the units of the drive; none where no scale is known
    """

    experiments: Sequence[Experiment]
    stretches: Sequence[Stretch]
    runs: Sequence[Run]
    starts: tuple[Drive, ...]
    ended: Drive
    fitted: CoastDownFit
    prior: Prior
    known: Mapping[str, float]


@dataclass(frozen=True)
class Stage:
    """One window: (high, low) of the speed, the parameters it fits, and the runs cut to it."""

    window: tuple[float, float]
    free: tuple[str, ...]
    runs: tuple[Run, ...]


@dataclass(frozen=True)
class StagedDifference:
    """A value by stages, and that of the joint fit with its standard deviation."""

    staged: float
    joint: float
    std: float

    @property
    def in_std(self) -> float:
        """The difference in standard deviations of the joint fit."""
        return (self.staged - self.joint) / self.std


def fit_in_stages(estimate: Estimate, joint: JointFit, windows: Sequence[tuple[float, float]]) -> Estimate:
    """The estimate with values of a staged fit in the place of the joint ones.

    Each window fits its parameters; those of earlier windows stay, those of later ones are at their start value,
    zero where none is known. The values have no intervals; how far they are from the joint fit is a finding.

    windows  (high, low) of the speed [motion unit/s], from fast to slow; the speeds are those of the joint fit
    raises   BadOption: a window has nothing to fit; NotEnoughData: one without a coast-down
    """
    stages = _stages(joint, windows)
    held = {n: joint.known.get(n, 0.0) for stage in stages[1:] for n in stage.free
            if quantity_of(n) not in LAST_WINDOW}
    ended = min((_fit_stages(d.with_values(held), stages, joint.prior) for d in joint.starts),
                key=lambda e: e[1])[0]
    whole = fit(ended, (), joint.runs, NO_PRIOR)
    lines = tuple(_staged_parameter(p, ended) if p.std is not None else p for p in estimate.parameters)
    ratios = tuple(p.without_interval(STAGED_FIT_REASON)
                   for p in ratio_lines(ended, joint.fitted.names, joint.fitted))
    differences = {old.name: StagedDifference(new.value, old.value, old.std)
             for old, new in zip((*estimate.parameters, *estimate.ratios), (*lines, *ratios), strict=True)
             if old.std}
    unit = f"{ended.motion_unit}/s"
    details = {"stages": [{"from": s.window[0], "to": s.window[1], "unit": unit, "fitted": list(s.free),
                           "readings": sum(len(r.reading.known) for r in s.runs)} for s in stages],
               "joint_fit": {name: {"value": a.joint, "std": a.std, "difference_in_std": a.in_std}
                             for name, a in differences.items()}}
    return replace(
        estimate, drive=estimate.drive.with_values({p.name: p.value for p in lines if np.isfinite(p.value)}),
        parameters=lines, ratios=ratios, covariance=None,
        # The chi-square of a wrong model is meaningless: its errors were attributed to the encoder.
        fit={k: v for k, v in fit_figures(whole, joint.stretches).items() if not k.startswith("chi2")},
        outcome=f"{estimate.outcome.rstrip('.')}; fitted in {len(stages)} stages.",
        details={k: v for k, v in estimate.details.items() if k != "ratio_covariance"} | details,
        findings=(*estimate.findings, _bias_finding(differences, stages[0], held, joint.ended, unit)),
        exhibits=coast_down_plots(joint.experiments, joint.stretches, whole, ended))


def _staged_parameter(line: Parameter, ended: Drive) -> Parameter:
    """A parameter with its value by stages."""
    value = ended.values[line.name]
    return line.replace(value=value).without_interval(
        STAGED_FIT_REASON, "at-bound" if value in ended.quantity(line.name).bounds else "fitted")


def _stages(joint: JointFit, windows: Sequence[tuple[float, float]]) -> list[Stage]:
    """The parameters of each window, and its samples in the recordings."""
    names = joint.fitted.names
    last = [n for n in names if quantity_of(n) in LAST_WINDOW] if len(windows) > 2 else []
    second = [n for n in names if quantity_of(n) in (*SECOND_WINDOW, *LAST_WINDOW) and n not in last]
    groups = [[n for n in names if n not in second and n not in last], second, last][:len(windows)]
    found = []
    for k, (window, free) in enumerate(zip(windows, groups, strict=True)):
        if not free:
            raise BadOption(f"a parameter to fit in window {k + 1} of --stages", "none that is free",
                            "Leave this window out; a third one is for --free motor.breakaway --free "
                            "motor.breakaway_speed.")
        found.append(Stage(window, tuple(free), _runs_in_window(joint, window, first=k == 0)))
    return found


def _runs_in_window(joint: JointFit, window: tuple[float, float], first: bool) -> tuple[Run, ...]:
    """The coast-downs inside a window; the stretches under torque, which give the scale, belong to the first."""
    high, low = window
    found: list[Run] = []
    for run, s, reading, speed in zip(joint.runs, joint.stretches, joint.fitted.readings, joint.fitted.speeds,
                                      strict=True):
        if not s.off:
            found += [run] if first else []
            continue
        inside = reading.known[(np.abs(speed) <= high) & (np.abs(speed) >= low)]
        if len(inside) >= MIN_WINDOW_READINGS:
            found.append(run_of(joint.experiments[s.recording], replace(
                s, first=s.first + int(inside[0]), last=s.first + int(inside[-1]) + 1)))
    if all(r.inputs.any() for r in found):
        fast = np.concatenate([np.abs(w) for w, s in zip(joint.fitted.speeds, joint.stretches, strict=True)
                               if s.off])
        unit = f"{joint.ended.motion_unit}/s"
        raise NotEnoughData(f"{MIN_WINDOW_READINGS} readings of a coast-down from {high:.4g} to {low:.4g} {unit}",
                            f"coast-downs from {fast.max():.4g} to {fast.min():.4g} {unit}",
                            "Give windows after --stages in which the drive coasts down.")
    return tuple(found)


def _fit_stages(drive: Drive, stages: Sequence[Stage], prior: Prior) -> tuple[Drive, float]:
    """(where the stages end, minus twice the log likelihood of all of them)."""
    loss = 0.0
    for stage in stages:
        found = fit(drive, stage.free, stage.runs, prior.of(stage.free))
        drive = drive.with_values(found.found)
        loss += found.deviance
    return drive, loss


def _bias_finding(differences: Mapping[str, StagedDifference], first: Stage, held: Mapping[str, float],
                  ended: Drive, unit: str) -> Finding:
    """How far the values are from the joint fit, and why."""
    listed = ", ".join(f"{name} by {100.0 * (a.staged / a.joint - 1.0):+.3g} % ({_stds_text(a.in_std)} standard "
                       "deviations of the joint fit)" for name, a in differences.items() if a.joint)
    reason = ""
    if COULOMB in held and ended.value(VISCOUS) and ended.value(COULOMB):
        share = [ended.values[COULOMB] / (ended.values[VISCOUS] * w) for w in first.window if w]
        at = f"at {held[COULOMB]:.4g} {ended.unit(COULOMB)}" if held[COULOMB] else "left out"
        reason = (f" Coulomb friction is {at} in the window from {first.window[0]:.4g} to {first.window[1]:.4g} "
               f"{unit}. In the joint fit it is {' to '.join(f'{s:.2f}' for s in share)} times the viscous "
               "friction there.")
    return Finding(
        "warning" if any(abs(a.in_std) > Z95 for a in differences.values()) else "note", "staged-fit",
        (f"The staged fit differs from the joint fit: {listed}." if listed else
         "The staged fit is not compared with the joint fit, as no parameter is identified.") + reason,
        {name: a.in_std for name, a in differences.items()}, "Leave out --stages for the joint fit.")


def _stds_text(stds: float) -> str:
    """A number of standard deviations in three digits."""
    return f"{float(f'{stds:.3g}'):+.0f}" if abs(stds) >= 100.0 else f"{stds:+.3g}"
