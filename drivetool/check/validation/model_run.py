"""A model simulated over the torque of a record: every speed, angle and shaft torque of the drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drivetool.check.validation.replay import MIN_SEGMENT_SAMPLES, start_states
from drivetool.drive import Assembly, Drive, Layout
from drivetool.drive.simulation import Trace
from drivetool.errors import BadOption, BadParameters
from drivetool.identify.setup import (
    KnownStart,
    Roles,
    Task,
    first_states,
    known_states,
    problem_of,
    roles_of,
    traces_of,
)
from drivetool.logs import Experiment


@dataclass(frozen=True)
class ModelRun:
    """Free runs over a record; arrays of all pieces in a row.

    time       (n,) [s] from the start of the recording
    inputs     role -> (n,) torque that drove the model
    measured   role -> (n,) of the sensors the drive knows, NaN where there was no value
    simulated  role -> (n,) of every speed, angle and shaft torque, the measured ones first
    pieces     (first, last+1) of the free runs, each with start states of its own
    torque_unit, motion_unit  of the record
    """

    time: np.ndarray
    inputs: Mapping[str, np.ndarray]
    measured: Mapping[str, np.ndarray]
    simulated: Mapping[str, np.ndarray]
    pieces: tuple[tuple[int, int], ...]
    torque_unit: str
    motion_unit: str

    def unit(self, role: str) -> str:
        """Unit of a role, in SI."""
        if role.endswith("torque"):
            return self.torque_unit
        return self.motion_unit + ("/s" if role.endswith("speed") else "")


def run_model(experiment: Experiment, drive: Drive, segment: float = 0.0,
              start: KnownStart | None = None) -> ModelRun:
    """Simulate a drive over the torque of a record.

    experiment  motor torque and any sensors; start states are fitted to the first one, the
                motor's speed or else angle
    drive       all inertias and stiffnesses must have a value
    segment     length of the free runs [s]; 0: whole stretches
    start       what is known of the state in which the record begins. At rest all of it is: the twists are those at
                standstill, the angle is that of the first sample, and nothing is fitted
    raises      BadParameters: a value is missing; BadOption: segments too short, an invalid start state;
                BadRecording: no torque or no sensor of the motor
    """
    drive.require(drive.missing(), "a simulation")
    if 0.0 < segment < MIN_SEGMENT_SAMPLES * experiment.step:
        raise BadOption(
            f"segments of at least {MIN_SEGMENT_SAMPLES * experiment.step:g} s, {MIN_SEGMENT_SAMPLES} samples",
            f"{segment:g} s", "Give --segment more, or 0 for one free run.")
    seen = roles_of([experiment], drive)
    first, every = Roles(seen.inputs, seen.outputs[:1]), Roles(seen.inputs, _all_roles(drive, seen))
    start = start or KnownStart()
    known = known_states(start, drive, (), every)
    task = Task(drive, (), first, (experiment,), known)
    problem = task.problem(segment)
    traces = _with_all_columns(traces_of([experiment], seen, segment, known), seen, every)
    steady = first_states(drive, first, problem.traces)
    resting = start.records.get(experiment.number, start).rest
    starts = [guess if resting and t.start else fitted for t, guess, fitted in zip(
        traces, steady, start_states(task, problem), strict=True)]
    plant = problem_of(drive, (), every, traces).plants(np.empty(0), False)[0]
    runs = [plant.outputs(trace, start) for trace, start in zip(
        traces, _full_states(drive, first, every, traces, starts), strict=True)]
    _join_angles(runs, traces, every)
    ends = np.cumsum([0, *(t.size for t in traces)])
    simulated = np.concatenate(runs)
    if not np.isfinite(simulated).all():
        raise BadParameters("a simulation that stays finite", "numbers that are not",
                            "Correct the parameters: is one far beyond what a machine of this kind has?")
    measured = np.concatenate([t.outputs for t in traces])
    inputs = np.concatenate([t.inputs for t in traces])
    time = np.concatenate([t.origin + np.arange(t.size) * t.step for t in traces])
    return ModelRun(
        np.round(time, 9), {role: inputs[:, m] for m, role in enumerate(every.inputs)},
        {role: measured[:, m] for m, role in enumerate(every.outputs) if role in seen.outputs},
        {role: simulated[:, m] for m, role in enumerate(every.outputs)},
        tuple((int(a), int(b)) for a, b in pairwise(ends)), experiment.torque_unit, experiment.motion_unit)


def _all_roles(drive: Drive, seen: Roles) -> tuple[str, ...]:
    """What was measured, then everything else that moves or carries torque."""
    speeds = [f"{_role_of(drive, body)}_speed" for body in drive.bodies]
    angles = [f"{_role_of(drive, body)}_angle" for body in drive.bodies]
    shafts = ["shaft_torque" if k == 0 else f"{shaft}_torque" for k, shaft in enumerate(drive.shafts)]
    return tuple(dict.fromkeys([*seen.outputs, *speeds, *angles, *shafts]))


def _role_of(drive: Drive, body: str) -> str:
    """The first body and the load's are motor and load in a recording, whatever their names in the drive."""
    if body == drive.bodies[0]:
        return "motor"
    if body == drive.load and "load" not in drive.bodies:
        return "load"
    return body


def _with_all_columns(traces: tuple[Trace, ...], seen: Roles, every: Roles) -> tuple[Trace, ...]:
    """The traces with a column for every role, empty where nothing was measured."""
    more = len(every.outputs) - len(seen.outputs)
    return tuple(replace(t, outputs=np.hstack([t.outputs, np.full((t.size, more), np.nan)])) for t in traces)


def _full_states(drive: Drive, first: Roles, every: Roles, traces: tuple[Trace, ...],
                 starts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The fitted start states, with those that the further angles need."""
    step = traces[0].step
    few = Assembly(drive, Layout((), first.inputs, first.outputs, step, gradient=False)).states
    many = Assembly(drive, Layout((), every.inputs, every.outputs, step, gradient=False)).states
    found = []
    for guess, start in zip(first_states(drive, every, traces), starts, strict=True):
        known = dict(zip(few, start, strict=True))
        full = np.array([known.get(name, value) for name, value in zip(many, guess, strict=True)])
        if "motor_speed.filtered" in many and "motor_speed.filtered" not in known:
            full[many.index("motor_speed.filtered")] = full[0]
        found.append(full)
    return found


def _join_angles(runs: list[np.ndarray], traces: tuple[Trace, ...], every: Roles) -> None:
    """Angles with an arbitrary zero: shifted to the measured ones, or continued from the piece before. In place.

    The first output stays as it is: its start was fitted.
    """
    for m, role in enumerate(every.outputs):
        if not role.endswith("angle") or m == 0:
            continue
        speed = every.outputs.index(role.replace("angle", "speed"))
        for k, (run, trace) in enumerate(zip(runs, traces, strict=True)):
            known = np.isfinite(trace.outputs[:, m])
            if role == "motor_angle" and "angle" in trace.start:
                continue
            if known.any():
                run[:, m] += np.mean(trace.outputs[known, m] - run[known, m])
            elif k > 0:
                last, before = runs[k - 1], traces[k - 1]
                pause = trace.origin - before.origin - (before.size - 1) * before.step
                turned = 0.5 * pause * (last[-1, speed] + run[0, speed])
                run[:, m] += last[-1, m] + turned - run[0, m]
            else:
                run[:, m] -= run[0, m]
