"""Torque constant: what a motor's torque is over its logged input, a current in A, a voltage in V or a share in %.

Recordings are multiplied by its value when they are read, so that everything downstream works with torques. It acts
here only while it differs from that value: while it is fitted. The assembly multiplies the input of a motor by it.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity, name_of, quantity_of

NAME = "torque_constant"


def is_constant(name):
    """Whether a parameter is the torque constant of a body, in all recordings or in one."""
    return quantity_of(name) == NAME


def prepare(assembly, body):
    """The torque constant over the value at which the recording was read, if it has changed."""
    name = name_of(assembly.drive.bodies[body], NAME)
    if name in assembly.drive.values and name in assembly.drive.constants:
        assembly.input_gain[body] = assembly.parameter(name) / assembly.drive.constants[name]


EFFECT = Effect(
    code="torque-constant",
    of="body",
    quantities={NAME: Quantity("{T}/{u}", "torque of the motor over its input", (1e-12, 1e12), 1.0)},
    prepare=prepare,
    required=False,
    law="T = k u",
    needs="a torque of known size: a torque sensor, a known load torque, or an inertia that is held or added",
    source="Leonhard 2001, Control of Electrical Drives",
)
