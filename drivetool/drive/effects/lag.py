"""A lag of first or second order in the signal path: its states are part of the chain, hence it is exact."""

from drivetool.errors import BadParameters
from drivetool.quantity import name_of


def order_of(assembly, owner):
    """Order of the owner's lag, 1 or 2, which cannot be a free parameter; raises BadParameters."""
    name = name_of(owner, "order")
    value = assembly.drive.value(name)
    if value not in assembly.drive.quantity(name).choice or name in assembly.layout.free:
        raise BadParameters(f"{name} of 1 or 2, held", "a free parameter" if name in assembly.layout.free
                            else f"{value:g}", "Correct it.")
    return int(value)


def follow(assembly, state, source, owner):
    """Let a state follow a column as the owner's lag; of order 2 its rate is the next state."""
    bandwidth, damping = (assembly.parameter(name_of(owner, s)) for s in ("bandwidth", "damping"))
    if order_of(assembly, owner) == 1:
        assembly.torque(state, source, bandwidth)
        assembly.torque(state, state, -bandwidth)
        return
    square = bandwidth * bandwidth
    assembly.torque(state, state + 1, assembly.number(1.0))
    assembly.torque(state + 1, state, -square)
    assembly.torque(state + 1, state + 1, -2.0 * damping * bandwidth)
    assembly.torque(state + 1, source, square)
