"""Inputs in A, V or % as torques, by the torque constants of the motors; and the conditions of fitting one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.drive import Drive, is_constant
from drivetool.drive.effects import NAME
from drivetool.errors import BadOption, BadParameters, BadRecording
from drivetool.identify.setup.setup import Roles
from drivetool.identify.setup.supply import as_stator_voltages
from drivetool.logs import MOTOR_TORQUES, Experiment, quantity
from drivetool.quantity import ELECTRIC_UNITS, name_of, owner_of, quantity_of, shared, with_parts

# Held parameters that give torques a known size: a fit frees them by default, so one that is held, or added, is
# known. Friction may come from a step that took the torque constant as given.
SCALE_PARAMETERS = ("inertia", "added_inertia", "carried_mass")


def electric_inputs(experiment: Experiment) -> dict[str, str]:
    """The roles whose torque is logged in A, V or % -> that unit."""
    units = {role: experiment.unit(role) for role in experiment.signals if quantity(role) == "torque"}
    return {role: unit for role, unit in units.items() if unit in ELECTRIC_UNITS}


def as_torques(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str] = (),
               ) -> tuple[tuple[Experiment, ...], Drive]:
    """Recordings in the drive's unit of torque, and the drive with the constants of their inputs.

    experiments  inputs of motors in A, V or %, or torques already
    drive        with torque constants among its values; in A, V or % itself, it has none, and nothing changes
    free         names of parameters to be fitted: a fitted constant stays among the values and may change later
    returns      experiments in the drive's unit; the drive, its constants separate from its values
    raises       BadParameters: a constant has no value, or is of a body that is no motor;
                 BadRecording: another torque is in A, V or %;
                 BadOption: a constant is free, and no input is in A, V or %
    """
    free_constants = {shared(n) for n in free if is_constant(n)}
    named = {n: v for n, v in drive.values.items() if is_constant(n)}
    found, used = [], set()
    if strange := [n for n in named if shared(n) not in {_torque_constant_name(role, drive)
                                                         for role in MOTOR_TORQUES}]:
        raise BadParameters(
            f"a torque constant of {owner_of(_torque_constant_name('motor_torque', drive))} or motor2",
                            strange[0], "Leave it out: other torques are logged in Nm or N.")
    for e in experiments:
        roles = {} if drive.torque_unit in ELECTRIC_UNITS else electric_inputs(e)
        signals = dict(e.signals)
        for role in roles:
            name, value = _torque_constant_of(role, e, drive, free_constants)
            signals[role] = value * e.signals[role]
            signals[role].setflags(write=False)
            used.add(name)
        if roles:
            others = as_torques(e.others, drive, free)[0] if e.others else ()
            e = replace(e, signals=signals, torque_unit=drive.torque_unit, input_units={}, others=others)
        found.append(e)
    if free_constants - used:
        raise BadOption(f"an input in A, V or % for a free {min(free_constants - used)}",
                        f"torques in {experiments[0].torque_unit}", "Leave it out of --free.")
    kept = {n: v for n, v in drive.values.items() if n not in named or shared(n) in free_constants}
    return tuple(found), replace(drive, values=kept, constants=named)


def as_torques_for_models(experiments: Sequence[Experiment], drives: Sequence[Drive], off_too: bool = False,
               ) -> tuple[tuple[Experiment, ...], list[Drive]]:
    """The same for several drives: the recordings by the constants of the first, which the others know."""
    found, first = as_stator_voltages(*as_torques(experiments, drives[0]), off_too)
    known = [first]
    for drive in drives[1:]:
        other = as_stator_voltages(*as_torques(experiments, drive))[1]
        if other.torque_unit != first.torque_unit:
            raise BadParameters(f"models with torques in {first.torque_unit}, as the first has them",
                                f"one in {other.torque_unit}", "Check them separately.")
        if other.constants != first.constants and any(map(electric_inputs, experiments)):
            other = replace(other, values={**other.values, **other.constants}, constants=first.constants)
        known.append(other)
    return found, known


def refuse_free_torque_constants(free: Sequence[str]) -> None:
    """Raise BadOption where a torque constant is free in an estimator that takes it as given."""
    if constants := [n for n in free if is_constant(n)]:
        raise BadOption(f"{constants[0]} held in this step", "it is free", "Free it in greybox.")


def _torque_constant_name(role: str, drive: Drive) -> str:
    """The torque constant of a motor's role."""
    return name_of(drive.bodies[0] if MOTOR_TORQUES[role] == 'motor' else MOTOR_TORQUES[role], NAME)


def _torque_constant_of(role: str, experiment: Experiment, drive: Drive,
                        free_constants: set[str]) -> tuple[str, float]:
    """(name, value) of the torque constant of a role."""
    unit = experiment.unit(role)
    if role not in MOTOR_TORQUES:
        raise BadRecording(f"{role} of {experiment.name} in {drive.torque_unit}", f"'{unit}'",
                           "Torque constants are of motors: write `scale` and `unit` for it in the channel map.")
    name = _torque_constant_name(role, drive)
    labels = [label for label, sha in drive.records.items() if sha == experiment.sha256]
    names = [n for n in (*(with_parts(name, record=label) for label in labels), name) if n in drive.values]
    if not names:
        start = "a start value" if name in free_constants else "a value"
        wanted = f"{start} of {name} in {drive.torque_unit}/{unit} for {role} of {experiment.name}"
        raise BadParameters(wanted, "none", f"Give it in a parameter file, or with --set {name}=VALUE.")
    return name, drive.values[names[0]]


def check_torque_scale(drive: Drive, free: Sequence[str], roles: Roles, hold: Sequence[str]) -> None:
    """Raise BadOption where a torque constant is free and no torque of known size acts or is measured.

    Without one, all torques could be multiplied by one number, and the fit would not change.
    """
    free_constants = {shared(n) for n in free if is_constant(n)}
    torques = [r for r in roles.outputs if r.endswith("torque")]
    torques += [r for r in roles.inputs if r not in MOTOR_TORQUES
                or _torque_constant_name(r, drive) not in free_constants]
    held = [n for n, v in drive.values.items() if v and n not in free and drive.quantity(n).unit.startswith("{T}")
            and (n in hold or is_constant(n) or quantity_of(n) in SCALE_PARAMETERS)]
    if free_constants and not (torques or held):
        raise BadOption(
            f"a torque of known size beside a free {min(free_constants)}",
            f"only {', '.join((*roles.inputs, *roles.outputs))}",
            "Hold a known inertia with --hold, add one with --record, or log the torque of the shaft.")
