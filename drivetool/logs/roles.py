"""The one table of roles: what a channel of a recording can be, and what that means for every step."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

Quantity = Literal["torque", "speed", "angle", "voltage", "frequency"]
MOTION_QUANTITIES = ("speed", "angle")
Kind = Literal["input", "sensor", "reference"]


@dataclass(frozen=True)
class Role:
    """What is measured or commanded there.

    quantity  "torque" is Nm or N, of MOTOR_TORQUES also A, V or %; "speed" rad/s or m/s; "angle" rad or m;
              "voltage" V; "frequency" Hz. Positive is forward
    kind      an input drives the model and stays until its next value; a sensor is compared with the model; a
              reference is the setpoint of the loop
    meaning   in words
    """

    quantity: Quantity
    kind: Kind
    meaning: str


ROLES: Mapping[str, Role] = MappingProxyType({
    "motor_torque": Role("torque", "input", "torque of the motor: the command, or a measurement of it (see "
                                            "`torque_is` in the channel map)"),
    "motor_speed": Role("speed", "sensor", "speed of the motor"),
    "motor_angle": Role("angle", "sensor", "angle of the motor"),
    "shaft_torque": Role("torque", "sensor",
                         "torque in the shaft behind the motor, positive where the motor drives the load"),
    "load_speed": Role("speed", "sensor", "speed of the load, the last body of the drive"),
    "load_angle": Role("angle", "sensor", "angle of the load"),
    "load_torque": Role("torque", "input", "external torque on the load, positive where it brakes forward motion"),
    "motor2_torque": Role("torque", "input", "torque of a second motor, for a drive with a body `motor2`"),
    "motor2_speed": Role("speed", "sensor", "speed of the second motor"),
    "motor2_angle": Role("angle", "sensor", "angle of the second motor"),
    "supply_voltage": Role("voltage", "input", "root mean square of the voltage between two phases of an induction "
                                               "motor's supply, zero where it is off"),
    "supply_frequency": Role("frequency", "input", "frequency of an induction motor's supply"),
    "motor_voltage_a": Role("voltage", "input", "voltage of the first phase of an induction motor, from its star "
                                                "point"),
    "motor_voltage_b": Role("voltage", "input", "voltage of the second phase of an induction motor, from its star "
                                                "point"),
    "stator_voltage_d": Role("voltage", "input", "voltage of an induction motor along the first axis of a frame "
                                                 "that turns at `motor.supply_frequency`, peak value of a phase"),
    "stator_voltage_q": Role("voltage", "input", "the same along the second axis, a quarter turn ahead"),
    "table_speed": Role("speed", "sensor", "speed of a table, for a drive with a body `table`; in m/s it may be "
                                           "behind a motor in rad/s"),
    "table_angle": Role("angle", "sensor", "angle or position of the table"),
    "reference_torque": Role("torque", "reference", "torque setpoint of the control loop, or an excitation that is "
                                                    "added to the torque"),
    "reference_speed": Role("speed", "reference", "speed setpoint of the control loop"),
    "reference_angle": Role("angle", "reference", "angle setpoint of the control loop"),
})
INPUTS = tuple(name for name, role in ROLES.items() if role.kind == "input")
# Torques that may be logged as what a motor is fed with: a current, a voltage, or a share in %. Value: its body.
MOTOR_TORQUES = MappingProxyType({"motor_torque": "motor", "motor2_torque": "motor2", "reference_torque": "motor"})

# Any further body or shaft of a drive, by its name there.
NAMED_ROLES: Mapping[str, Role] = MappingProxyType({
    "speed": Role("speed", "sensor", "speed of the body of that name"),
    "angle": Role("angle", "sensor", "angle or position of the body of that name"),
    "torque": Role("torque", "sensor",
                   "torque in the shaft of that name, positive where it drives the bodies on its load side"),
})
NAMED_ROLE_PATTERN = rf"^[A-Za-z][A-Za-z0-9_]*_({'|'.join(NAMED_ROLES)})$"
# Every name that a role can have: those of the table that the pattern does not fit are listed.
ROLE_NAME_PATTERN = "|".join((NAMED_ROLE_PATTERN,
                              *(f"^{name}$" for name in ROLES if not re.match(NAMED_ROLE_PATTERN, name))))


def role_of(name: str) -> Role | None:
    """The role of a name, that of a further body or shaft included; None: a name that no role can have."""
    if name in ROLES:
        return ROLES[name]
    return NAMED_ROLES[name.rpartition("_")[2]] if re.match(NAMED_ROLE_PATTERN, name) else None


def quantity(name: str) -> Quantity:
    """What a role is, by its name."""
    found = role_of(name)
    assert found is not None
    return found.quantity


def is_motion(name: str) -> bool:
    """Whether a role is a speed or an angle."""
    return quantity(name) in MOTION_QUANTITIES


def ordered_roles(names: Iterable[str]) -> list[str]:
    """Roles in the order of the table, further ones behind by name."""
    order = {name: i for i, name in enumerate(ROLES)}
    return sorted(names, key=lambda name: (order.get(name, len(order)), name))
