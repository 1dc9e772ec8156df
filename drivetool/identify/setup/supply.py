"""Recordings of an induction motor's supply, with its voltages as inputs of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import Drive, by_converter, by_phases, vector_frequency, vector_of_converter, vector_of_phases
from drivetool.drive.effects import VOLTAGES
from drivetool.errors import BadRecording
from drivetool.finding import Finding
from drivetool.logs import Experiment, true_runs
from drivetool.logs.conditioning import read_only
from drivetool.quantity import name_of

FRAME_FREQUENCY = "motor.supply_frequency"
PHASES = ("motor_voltage_a", "motor_voltage_b")
VOLTAGE, FREQUENCY = "supply_voltage", "supply_frequency"
SUPPLY_ROLES = (*PHASES, VOLTAGE, FREQUENCY)


def fed_by_voltages(drive: Drive) -> bool:
    """Whether the motor's torque follows from voltages: its magnetizing inductance is known."""
    return bool(drive.value(name_of(drive.bodies[0], "magnetizing_inductance")))


def as_stator_voltages(experiments: Sequence[Experiment], drive: Drive, off_too: bool = False,
                       ) -> tuple[tuple[Experiment, ...], Drive]:
    """Recordings of a supply with the space vector of its voltage, and the drive with its reference frame.

    Two phases give the vector, or the voltage and frequency of a converter. Of the latter, stretches without supply
    are left out: the stator is open there, and no voltage is known.

    experiments  those without a supply stay as they are
    drive        with the electrical values of an induction motor; any other one changes nothing
    off_too      whether stretches without supply are kept
    returns      experiments with the roles of VOLTAGES [V], peak values, each the mean until the next sample
    raises       BadRecording: one phase alone, no frequency, or a torque beside the voltages
    """
    if not fed_by_voltages(drive):
        return tuple(experiments), drive
    found = [_stationary_vector(e, drive) for e in experiments]
    known = [(u[1:], u[:-1], e.step) for e, u in zip(experiments, found, strict=True) if u is not None]
    if not known:
        return tuple(map(_in_frame_already, experiments)), drive
    frame = drive.values.get(FRAME_FREQUENCY)
    if frame is None:
        frame_speed = np.median(np.concatenate([vector_frequency(*each) for each in known]))
        frame = float(f"{abs(frame_speed):.10g}")  # as a file has it
        drive = drive.with_values({FRAME_FREQUENCY: frame})
    return tuple(_in_frame_already(e) if u is None else _in_frame(e, u, frame, off_too)
                 for e, u in zip(experiments, found, strict=True)), drive


def _stationary_vector(e: Experiment, drive: Drive) -> np.ndarray | None:
    """(n,) complex voltage at the samples, stationary, peak values [V]; None: none was logged."""
    there = [role for role in SUPPLY_ROLES if role in e.signals]
    if not there or there == [FREQUENCY]:
        return None
    if "motor_torque" in e.signals:
        raise BadRecording(f"either a torque or voltages of the motor in {e.name}",
                           f"motor_torque and {', '.join(there)}",
                           "Leave one out of the channel map: the torque follows from the voltages.")
    if set(PHASES) <= set(there):
        return vector_of_phases(*(e.signals[role] for role in PHASES))
    if VOLTAGE not in there:
        raise BadRecording(f"{' and '.join(PHASES)}, or {VOLTAGE}, in {e.name}", ", ".join(there),
                           "Log two phases, or the voltage and frequency of the converter.")
    frequency = e.signals.get(FREQUENCY, np.full(e.size, drive.value(FRAME_FREQUENCY)))
    if not np.nanmax(np.abs(frequency)) > 0.0:
        raise BadRecording(f"the frequency of the supply in {e.name}", "none",
                           f"Log {FREQUENCY}, or give it with --set '{FRAME_FREQUENCY}=50 Hz'.")
    return vector_of_converter(e.signals[VOLTAGE], frequency, e.step)


def _in_frame(e: Experiment, vector: np.ndarray, frame: float, off_too: bool) -> Experiment:
    """The experiment with means over its samples of the vector as it is in the frame."""
    held = by_converter(vector, frame, e.step, e.signals.get(FREQUENCY, np.full(e.size, frame))) \
        if VOLTAGE in e.signals else by_phases(vector, frame, e.step)
    signals = {role: values for role, values in e.signals.items() if role not in SUPPLY_ROLES}
    signals |= {"motor_torque": np.zeros(e.size)} | dict(zip(VOLTAGES, (held.real, held.imag), strict=True))
    found = replace(e, signals={role: read_only(values) for role, values in signals.items()})
    return found if off_too or VOLTAGE not in e.signals else _with_supply_on(found, np.abs(held) > 0.0)


def _in_frame_already(e: Experiment) -> Experiment:
    """The experiment, with a torque of zero beside voltages along the axes of a frame."""
    if not set(VOLTAGES) <= set(e.signals) or "motor_torque" in e.signals:
        return e
    return replace(e, signals=dict(e.signals) | {"motor_torque": read_only(np.zeros(e.size))})


def _with_supply_on(e: Experiment, on: np.ndarray) -> Experiment:
    """Without the stretches in which the supply is off."""
    kept = []
    for first, last in e.segments:
        kept += [(first + int(a), first + int(b)) for a, b in true_runs(on[first:last])]
    lost = sum(b - a for a, b in e.segments) - sum(b - a for a, b in kept)
    if not lost:
        return e
    return replace(e, segments=tuple(kept), findings=(*e.findings, Finding(
        "note", "stretches-left-out",
        f"{lost * e.step:.4g} s of {e.name} without supply are left out: the stator "
        "voltage is unknown there.", {"seconds": lost * e.step},
        "To evaluate a coast-down, use steady --method coast-down.")))


def supply_of(e: Experiment) -> np.ndarray | None:
    """(n,) size of the voltage vector [V]; None: the experiment has none."""
    return np.hypot(*(e.signals[role] for role in VOLTAGES)) if VOLTAGES[0] in e.signals else None
