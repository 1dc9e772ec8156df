"""Inputs in A, V or % as torques, by the torque constants of the motors; and what a fit of one of these needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.drive import AT, Drive, is_constant, shared
from drivetool.drive.effects import NAME
from drivetool.errors import BadOption, BadParameters, BadRecording
from drivetool.identify.setup.setup import Roles
from drivetool.identify.setup.supply import as_stator_voltages
from drivetool.logs import MOTORS, Experiment, quantity
from drivetool.quantity import ELECTRIC

# Of what is held, these say how large a torque is without having been named: what a fit frees by itself was
# asked to be held, or added, in a size that is known. Frictions may be of a step that took the constant as given.
MASSES = ("inertia", "added_inertia", "carried_mass")


def electric(experiment: Experiment) -> dict[str, str]:
    """The roles whose torque is logged in A, V or % -> that unit."""
    units = {role: experiment.unit(role) for role in experiment.signals if quantity(role) == "torque"}
    return {role: unit for role, unit in units.items() if unit in ELECTRIC}


def as_torques(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str] = (),
               ) -> tuple[tuple[Experiment, ...], Drive]:
    """Recordings in the drive's unit of torque, and the drive that knows what their inputs were multiplied by.

    experiments  inputs of motors in A, V or %, or torques already
    drive        with torque constants among its values; in A, V or % itself, it has none, and nothing changes
    free         names of what is to be fitted: such a constant stays among the values, and may be another one later
    returns      experiments in the drive's unit; the drive, its constants apart from its values
    raises       BadParameters: a constant has no value, or is of a body that is no motor;
                 BadRecording: another torque is in A, V or %;
                 BadOption: a constant is free, and no input is in A, V or %
    """
    loose = {shared(n) for n in free if is_constant(n)}
    named = {n: v for n, v in drive.values.items() if is_constant(n)}
    found, used = [], set()
    if strange := [n for n in named if shared(n) not in {_named(role, drive) for role in MOTORS}]:
        raise BadParameters(f"a torque constant of {_named('motor_torque', drive).partition('.')[0]} or motor2",
                            strange[0], "Leave it out: other torques are logged in Nm or N.")
    for e in experiments:
        roles = {} if drive.torque_unit in ELECTRIC else electric(e)
        signals = dict(e.signals)
        for role in roles:
            name, value = _constant(role, e, drive, loose)
            signals[role] = value * e.signals[role]
            signals[role].setflags(write=False)
            used.add(name)
        if roles:
            others = as_torques(e.others, drive, free)[0] if e.others else ()
            e = replace(e, signals=signals, torque_unit=drive.torque_unit, input_units={}, others=others)
        found.append(e)
    if loose - used:
        raise BadOption(f"an input in A, V or % for a free {min(loose - used)}",
                        f"torques in {experiments[0].torque_unit}", "Leave it out of --free.")
    kept = {n: v for n, v in drive.values.items() if n not in named or shared(n) in loose}
    return tuple(found), replace(drive, values=kept, constants=named)


def for_models(experiments: Sequence[Experiment], drives: Sequence[Drive], off_too: bool = False,
               ) -> tuple[tuple[Experiment, ...], list[Drive]]:
    """The same for several drives: the recordings by the constants of the first, which the others know."""
    found, first = as_stator_voltages(*as_torques(experiments, drives[0]), off_too)
    known = [first]
    for drive in drives[1:]:
        other = as_stator_voltages(*as_torques(experiments, drive))[1]
        if other.torque_unit != first.torque_unit:
            raise BadParameters(f"models with torques in {first.torque_unit}, as the first has them",
                                f"one in {other.torque_unit}", "Check them apart.")
        if other.constants != first.constants and any(map(electric, experiments)):
            other = replace(other, values={**other.values, **other.constants}, constants=first.constants)
        known.append(other)
    return found, known


def only_in_greybox(free: Sequence[str]) -> None:
    """Raise BadOption where an estimator is asked for a torque constant that it takes as given."""
    if constants := [n for n in free if is_constant(n)]:
        raise BadOption(f"{constants[0]} held in this step", "it is free", "Free it in greybox.")


def _named(role: str, drive: Drive) -> str:
    """The torque constant of a motor's role."""
    return f"{drive.bodies[0] if MOTORS[role] == 'motor' else MOTORS[role]}.{NAME}"


def _constant(role: str, experiment: Experiment, drive: Drive, loose: set[str]) -> tuple[str, float]:
    """(name, value) of what makes a torque of a role."""
    unit = experiment.unit(role)
    if role not in MOTORS:
        raise BadRecording(f"{role} of {experiment.name} in {drive.torque_unit}", f"'{unit}'",
                           "Torque constants are of motors: write `scale` and `unit` for it in the channel map.")
    name = _named(role, drive)
    labels = [label for label, sha in drive.records.items() if sha == experiment.sha256]
    names = [n for n in (*(f"{name}{AT}{label}" for label in labels), name) if n in drive.values]
    if not names:
        start = "a start value" if name in loose else "a value"
        wanted = f"{start} of {name} in {drive.torque_unit}/{unit} for {role} of {experiment.name}"
        raise BadParameters(wanted, "none", f"Give it in a parameter file, or with --set {name}=VALUE.")
    return name, drive.values[names[0]]


def check_scale(drive: Drive, free: Sequence[str], roles: Roles, hold: Sequence[str]) -> None:
    """Raise BadOption where a torque constant is free and no torque of known size acts or is measured.

    All torques could then be multiplied by one number, and nothing would change.
    """
    loose = {shared(n) for n in free if is_constant(n)}
    torques = [r for r in roles.outputs if r.endswith("torque")]
    torques += [r for r in roles.inputs if r not in MOTORS or _named(r, drive) not in loose]
    held = [n for n, v in drive.values.items() if v and n not in free and drive.quantity(n).unit.startswith("{T}")
            and (n in hold or is_constant(n) or shared(n).rpartition(".")[2] in MASSES)]
    if loose and not (torques or held):
        raise BadOption(
            f"a torque of known size beside a free {min(loose)}",
            f"only {', '.join((*roles.inputs, *roles.outputs))}",
            "Hold a known inertia with --hold, add one with --record, or log the torque of the shaft.")
