"""Known start states: of a drive that stood still, or was set to a state, before it was recorded.

A known state is not estimated. It holds where a recording begins; after a gap in time all states are free again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drivetool.drive import TOTALS, Assembly, Drive, Layout
from drivetool.drive.simulation import Plant, Trace
from drivetool.errors import BadOption, nearest
from drivetool.finding import Finding
from drivetool.identify.estimate import inverted
from drivetool.identify.noise import Noise, filtered_normal_equations
from drivetool.identify.problem import Point, Problem
from drivetool.identify.setup.by_record import as_recorded
from drivetool.identify.setup.setup import UNNAMED_RECORDINGS, Roles, measured_states
from drivetool.quantity import name_of, owner_of, quantity_of

REST = "rest"
# Measured values that identify a start state: as many as the guess of the start speed takes.
START_STATE_SAMPLES = 20
# Standard deviations, as between two steps of the chain; noise alone exceeds them once in 1e15.
MIN_START_CONTRADICTION = 8.0
# Of the motion, by which a free run must change, a choice: less does not matter to a fit.
MIN_FREE_RUN_CHANGE = 0.01
# Parameters of a body that give no torque while it stands still.
ZERO_TORQUE_AT_REST = ("inertia", "carried_mass", "radius", "viscous", "viscous_asymmetry", "drag", "drift_viscous")


@dataclass(frozen=True)
class KnownStart:
    """Known state in which every recording begins.

    rest     whether the drive stands still, and has stood still until then
    states   state -> value in SI, by the names of `state_names`; they take precedence over rest
    records  number of a recording -> what is known of it alone, in the place of that
    """

    rest: bool = False
    states: Mapping[str, float] = field(default_factory=dict)
    records: Mapping[int, KnownStart] = field(default_factory=dict)


def state_names(drive: Drive) -> tuple[str, ...]:
    """The states that may be known: a speed per body, a twist per shaft, the angle of the motor."""
    speeds, twists = [f"{b}.speed" for b in drive.bodies], [f"{s}.twist" for s in drive.shafts]
    return (*speeds, *twists, f"{drive.bodies[0]}.angle")


def check_state(name: str, value: float, drive: Drive) -> None:
    """Raise BadOption unless the drive has this state and the value is finite."""
    names = state_names(drive)
    if name not in names:
        raise BadOption(f"'{REST}' or a state of the {drive.name} drive as start", f"'{name}'",
                        nearest(name, (REST, *names)))
    if not np.isfinite(value):
        raise BadOption(f"a finite start value of {name}", f"{value:g}", "Correct it.")


def known_states(start: KnownStart, drive: Drive, free: Sequence[str], roles: Roles) -> dict[int, dict[str, float]]:
    """Known states: number of a recording, or EVERY -> state by the names of `Assembly` -> value.

    free     names of the fitted parameters
    returns  empty where nothing is known
    raises   BadOption: an unknown state, a value that is not finite, an angle on which nothing depends
    """
    found = {UNNAMED_RECORDINGS: _known_in_recording(start, drive, free, roles)}
    for number, own in start.records.items():
        found[number] = _known_in_recording(own, *as_recorded(drive, free, number), roles)
    return found if any(found.values()) else {}


def _known_in_recording(start: KnownStart, drive: Drive, free: Sequence[str], roles: Roles) -> dict[str, float]:
    """Known states of one recording.

    returns  of a drive at rest every speed, and the twist of each shaft beyond which no torque can act at
             standstill. Coulomb friction, an idle torque and a gap leave a twist unknown, or make it depend on
             fitted values. The angle is measured, with noise, and is estimated
    """
    for name, value in start.states.items():
        check_state(name, value, drive)
    layout = Layout(tuple(free), roles.inputs, roles.outputs, 1.0, gradient=False)
    states = Assembly(drive, layout).states
    found = {}
    if start.rest:
        found = {name: 0.0 for name in states if name.endswith((".speed", ".filtered", ".filtered.rate"))}
        found |= {f"{shaft}.twist": 0.0 for k, shaft in enumerate(drive.shafts)
                  if _unloaded_at_rest(k, drive, free, roles)}
    angle = f"{drive.bodies[0]}.angle"
    found |= {"angle" if name == angle else name: float(value) for name, value in start.states.items()}
    if angle in start.states and "angle" not in states:
        raise BadOption(f"a measured angle, or a torque that depends on it, for a start value of {angle}",
                        "neither", "Leave out this start value: the model does not depend on the angle.",
                        state_names(drive)[:-1])
    return found


def _unloaded_at_rest(shaft: int, drive: Drive, free: Sequence[str], roles: Roles) -> bool:
    """Whether a shaft carries no torque at standstill, whatever is fitted."""
    beyond = drive.bodies[shaft + 1:]
    pulls = [n for n in drive.quantities if owner_of(n) in beyond and quantity_of(n) not in ZERO_TORQUE_AT_REST]
    pulls += [total for total, suffix in TOTALS.items() if suffix not in ZERO_TORQUE_AT_REST]
    acting = [n for n in (*pulls, name_of(drive.shafts[shaft], "half_gap"))
              if n in free or drive.value(n) != drive.quantity(n).neutral]
    return not acting and roles.inputs == ("motor_torque",)


def contradicted_start_findings(drive: Drive, roles: Roles, problem: Problem, point: Point, noise: Noise | None,
                       variance: float) -> list[Finding]:
    """Known start states that the first samples of a record contradict.

    drive     at the values of the point
    noise     under which the one-step errors are tested; None: the errors of the simulation
    variance  of the first sensor, with a noise; without one the errors of the fit contain the effect of a wrong
              start, and those of the first samples count instead
    returns   a warning per recording whose first samples give other start states at the same parameters, by many
              standard deviations and with a visible change of the free run
    """
    found = []
    for i, (trace, plant) in enumerate(zip(problem.traces, problem.plants(point.values, False), strict=True)):
        if not trace.start:
            continue
        start, (estimated, std) = (point.starts[i],
                                   _estimated_start(drive, roles, problem, i, point, noise, variance))
        contradicted = {name: j for j, name in enumerate(problem.states) if name in trace.start
                        and np.isfinite(std[j])
                        and abs(estimated[j] - start[j]) > MIN_START_CONTRADICTION * std[j]}
        if contradicted and _changes_free_run(plant, trace, start, estimated, list(contradicted.values())):
            descriptions = [f"{n} is {estimated[j]:.3g} +- {std[j]:.1g} instead of {start[j]:.3g}"
                            for n, j in contradicted.items()]
            found.append(Finding(
                "warning", "held-value-rejected",
                f"The first samples of {trace.name} reject the stated start state: {'; '.join(descriptions)}. "
                "The fitted values compensate for it and are biased.",
                {f"{n} over std": float((estimated[j] - start[j]) / std[j]) for n, j in contradicted.items()},
                "Leave --start out, state the state in which the recording begins, or begin where the drive rests: "
                "--condition 'keep from=SECONDS'."))
    return found


def _changes_free_run(plant: Plant, trace: Trace, start: np.ndarray, estimated: np.ndarray,
                      which: list[int]) -> bool:
    """Whether a free run from the estimated start state differs by more than 1 % of the motion."""
    other = start.copy()
    other[which] = estimated[which]
    change = plant.outputs(trace, other)[:, 0] - plant.outputs(trace, start)[:, 0]
    return bool(np.sqrt(np.mean(change**2)) > MIN_FREE_RUN_CHANGE * np.nanstd(trace.outputs[:, 0]))


def _estimated_start(drive: Drive, roles: Roles, problem: Problem, i: int, point: Point, noise: Noise | None,
                     variance: float) -> tuple[np.ndarray, np.ndarray]:
    """((m,) start state estimated from the first samples of a trace, its std); NaN: not identifiable.

    One step from the measured state: at a stated standstill a body sticks, and has no derivative over its speed.
    """
    trace = problem.traces[i]
    measured = np.flatnonzero(np.isfinite(trace.outputs[:, 0]))[:START_STATE_SAMPLES]
    size = int(measured[-1]) + 1 if len(measured) else 1
    head = replace(trace, inputs=trace.inputs[:size], outputs=trace.outputs[:size], start={})
    (guess,), one_trace = (measured_states(drive, roles, (replace(trace, start={}),)),
                           replace(problem, traces=(head,)))
    here = Point(point.values, (guess,))
    normal = one_trace.normal(here) if noise is None else filtered_normal_equations(one_trace, here, noise)
    own, slope = normal.own[0], normal.own_slope[0]
    scale = np.sqrt(np.diag(own))
    j = np.flatnonzero(scale > 0.0)
    inverse, lost = inverted(own[np.ix_(j, j)] / np.outer(scale[j], scale[j]), 1e-10)
    estimated, std = guess.copy(), np.full(len(scale), np.nan)
    step = inverse @ (slope[j] / scale[j])
    estimated[j] -= step / scale[j]
    if noise is None:
        residual_cost = normal.cost - float(slope[j] / scale[j] @ step)
        variance = residual_cost / max(np.isfinite(head.outputs).sum() - len(j), 1)
    std[j] = np.where(lost, np.nan, np.sqrt(variance * np.diag(inverse)) / scale[j])
    return estimated, std
