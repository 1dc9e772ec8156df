"""Backlash: the shaft carries no torque until its ends are in contact.

Three published forms. "inside" (Tallfors 2005, 5.17): the dead zone acts on twist plus damping, so
the torque is continuous and never pulls. "always" (chapter 6): the dead zone acts on the twist
alone and the damping acts in the gap too. "contact" (Nordin, Galic and Gutman 1997): in the gap the elastic twist
of the shaft relaxes, a state of its own, and its flanks touch at the half gap, with a step of the damping's torque.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

# Rate of the relaxation times the sample interval, above which a faster one leaves no trace in the record. Without
# damping the law is then "inside".
MAX_RELAXATION_RATE = 50.0


def states(assembly, shaft):
    """The elastic twist by the law "contact", with a closed gap too: fits close it and keep the start states."""
    return (f"{assembly.drive.shafts[shaft]}.elastic",) if assembly.drive.damping_law == "contact" else ()


def start(drive, _shaft, speeds, inputs):
    """Relaxed; in contact it is the twist beyond the gap."""
    return (0.0,)


def stamp(assembly, shaft):
    """Ts = ks (z - a) above a, 0 between, ks (z + a) below -a; the rate of an elastic twist in the gap."""
    assembly.gaps[shaft] = assembly.of_shaft(shaft, "half_gap")
    for state in states(assembly, shaft):
        stiffness, damping, _ = assembly.shafts[shaft]
        fastest = MAX_RELAXATION_RATE / assembly.layout.step
        rate = stiffness / damping if damping.v * fastest > stiffness.v else assembly.number(fastest)
        assembly.relaxing[shaft] = column = assembly.states.index(state)
        assembly.torque(column, column, -rate)


EFFECT = Effect(
    code="backlash",
    of="shaft",
    quantities={"half_gap": Quantity("{q}", "backlash half gap", (0.0, 1e3), 1e-4, 0.0)},
    stamp=stamp,
    states=states,
    start=start,
    law="Ts = ks dead(z, a), z = twist + (cs/ks) d(twist)/dt; by the law `contact` the elastic twist e "
        "relaxes in the gap, e' = -(ks/cs) e, and the gap closes where |twist - e| = a",
    needs="shaft torque of both signs",
    source="Tallfors 2005, (5.17) and ch. 6; Nordin, Galic, Gutman 1997",
    present=("half_gap",),
)
