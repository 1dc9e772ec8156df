"""The causes that diagnose looks for, in the words of the plant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from drivetool.drive.chain import Drive
from drivetool.drive.effects.load_step import TIMES, TORQUES
from drivetool.errors import BadOption, nearest
from drivetool.identify.estimate import Parameter


@dataclass(frozen=True)
class Cause:
    """A cause that a model may lack.

    name     in a table; text: what the machine does, one sentence; look: what to do about it
    effect   code of the effect that is its law, None for one of the recording or of the chain itself
    sizes    suffixes of the parameters that say how large it is, the most telling one first
    bodies   fewest bodies of a drive that can have it
    needs    what a record must contain to show it, where no effect says it
    further  codes of effects that are the same cause in another form
    """

    name: str
    text: str
    look: str
    effect: str | None = None
    sizes: tuple[str, ...] = ()
    bodies: int = 1
    needs: str = ""
    further: tuple[str, ...] = ()


CAUSES = {
    "backlash": Cause(
        "backlash", "There is play in the drive train: whenever the shaft torque changes its sign, the shaft "
        "turns through a gap without carrying torque and then hits the other side.",
        "Look for worn couplings, gear teeth, splines and keys.", "backlash", ("half_gap",), 2),
    "coulomb-motor": Cause(
        "dry friction at the motor", "A constant friction torque at the motor opposes every motion and changes "
        "its sign at each reversal.", "Look at the motor's bearings, seals and brake.", "coulomb", ("coulomb",)),
    "coulomb-load": Cause(
        "dry friction at the load", "A constant friction torque at the load opposes every motion and changes "
        "its sign at each reversal.", "Look at the load's bearings, guides and seals.", "coulomb",
        ("coulomb",), 2),
    "stribeck-motor": Cause(
        "breakaway friction at the motor", "At the motor it takes more torque to start moving than to keep "
        "moving slowly.", "Look at lubrication and seals; avoid dwelling at creep speed.", "stribeck",
        ("stribeck", "stribeck_speed")),
    "stribeck-load": Cause(
        "breakaway friction at the load", "At the load it takes more torque to start moving than to keep "
        "moving slowly.", "Look at lubrication, guides and seals; avoid dwelling at creep speed.", "stribeck",
        ("stribeck", "stribeck_speed"), 2),
    "asymmetric-friction": Cause(
        "friction that depends on the direction", "Friction is higher in one direction than in the other.",
        "Look for a preload, a screw or a belt that works in one direction.", "asymmetric-friction",
        ("viscous_asymmetry",)),
    "quadratic-drag": Cause(
        "drag that grows with the square of speed", "Something throws a fluid about: the torque it takes grows "
        "with the square of the speed.", "Look at fans and at the oil level of the gearbox.", "quadratic-drag",
        ("drag",)),
    "hardening-stiffness": Cause(
        "a shaft whose stiffness changes with load", "The shaft or coupling gets stiffer the more "
        "torque it carries, or softer where its hardening is below zero, so the resonance moves with the load.",
        "Tune for the whole range of the resonance.",
        "hardening-stiffness", ("hardening", "hardening_twist", "hardening_power"), 2),
    "load-dependent-damping": Cause(
        "damping that grows with load", "Vibrations of the shaft die out faster the more torque it carries.",
        "Tune for the unloaded shaft, where the vibration lasts longest.", "load-dependent-damping",
        ("load_damping",), 2),
    "third-mass": Cause(
        "a further elastic mass", "Part of the load swings on a shaft or coupling of its own: there is one "
        "resonance more than the model had.", "Look for the next coupling or a soft mounting; a sensor at the "
        "load shows it best.", None, ("inertia", "stiffness", "damping"), 2,
        "excitation around its resonance; a sensor at the load shows it best"),
    "torque-ripple": Cause(
        "torque ripple of the motor", "The motor's torque pulsates with its angle, the same way on every turn.",
        "Look at the number of poles and slots, and at the current sensors' offsets.", "torque-ripple",
        ("ripple_sine", "ripple_cosine", "ripple_order")),
    "imbalance": Cause(
        "imbalance", "A weight off the axis of the load is lifted and falls once per turn.",
        "Balance the load, or take the weight into the feed-forward.", "imbalance",
        ("imbalance_sine", "imbalance_cosine")),
    "dead-time": Cause(
        "dead time of the torque", "The torque comes later than the logged command by a fixed time.",
        "Look at bus cycles, and whether command and speed are logged with the same clock.", "dead-time",
        ("dead_time",)),
    "torque-hold": Cause(
        "torque logged as it passes", "The logged torque is no step that is held until the next sample: between "
        "its samples it goes on towards the next one, so it acts up to half a sample earlier than a held one.",
        "Keep converter.interpolation in the parameters, and say torque_is: measurement in the channel map.",
        "torque-hold", ("interpolation",)),
    "converter-lag": Cause(
        "lag of the torque", "The torque follows the logged command with a lag: the current loop is slower than "
        "the model took it to be.", "Look at the tuning of the current loop; log the actual torque too.",
        "converter-lag", ("bandwidth", "damping", "order")),
    "speed-filter": Cause(
        "a filter on the logged speed", "The logged speed went through a low-pass: the drive itself is faster "
        "than its log.", "Log the speed before the filter, or the angle.", "speed-filter",
        ("bandwidth", "damping", "order")),
    "quantisation": Cause(
        "coarse steps in a sensor", "A sensor is logged in steps coarser than its noise.",
        "Log it with more digits, or log the angle instead of the speed.", None, ("resolution",),
        needs="slow motion or standstill"),
    "torque-offset": Cause(
        "an offset of the torque channel", "The logged torque is shifted by a constant amount.",
        "Calibrate the zero of the torque or current sensor.", None,
        ("offset", "idle_torque"),
        needs="a stretch with the torque switched off; without one an idle torque is the same"),
    "load-step": Cause(
        "a load that set in or ended during the record", "At one instant of the record, or at several, a load "
        "torque set in or ended.", "Ask what happened at that time, or leave that part out.", "load-step",
        tuple(name[1:] for pair in zip(TORQUES, TIMES, strict=True) for name in pair)),
    "outliers": Cause(
        "single wrong values", "A few samples are far from everything around them.",
        "Look for loose plugs and for disturbances on the sensor's line.", None, ("count",),
        needs="nothing more than the samples around them"),
    "friction-drift": Cause(
        "friction that falls while warming up", "Friction was higher at the start of the record and fell as "
        "the drive warmed up.", "Warm up first, or record until nothing changes.", "friction-drift",
        ("drift_coulomb", "drift_viscous", "drift_time"), further=("warm-up",)),
    "wrong-sign": Cause(
        "a channel with the wrong sign", "Two channels that should agree have opposite signs.",
        "Set 'sign: -1' for that role in the channel map.", None, ("scale",),
        needs="two channels of one motion: speed and angle, motor and load, or shaft and motor torque"),
    "wrong-scale": Cause(
        "a channel with the wrong scale", "Two channels that should agree differ by a constant factor.",
        "Correct unit, rating or gear ratio of that channel in the channel map.", None, ("scale",),
        needs="two channels of one motion: speed and angle, motor and load, or shaft and motor torque"),
}


def chosen_causes(codes: Iterable[str], drive: Drive) -> tuple[str, ...]:
    """The codes as they were asked for, each once; empty stays empty: all of them.

    drive   that may lack the shaft some of them need
    raises  BadOption: a code nobody knows, or none that this drive can have
    """
    found = tuple(dict.fromkeys(codes))
    for code in found:
        if code not in CAUSES:
            raise BadOption("causes of the catalogue after --candidates", f"'{code}'",
                            f"{nearest(code, CAUSES)} See drivetool effects.")
    left = tuple(code for code in found if CAUSES[code].bodies <= len(drive.bodies))
    if found and not left:
        raise BadOption(
            "at least one cause to look for", f"{', '.join(found)}, which the {drive.name} drive cannot have",
            "Name others after --candidates, or leave it out to look for all of them.",
            [code for code, cause in CAUSES.items() if cause.bodies <= len(drive.bodies)])
    return left


def told_sizes(code: str, parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Those of the fitted parameters that say how large a cause is; all where it is not known which."""
    sizes = CAUSES[code].sizes if code in CAUSES else ()
    told = [p for size in sizes for p in parameters if p.name.rpartition(".")[2] == size and of_cause(code, p.name)]
    return tuple(told or parameters)


def of_cause(code: str, name: str) -> bool:
    """Whether a parameter says how large a cause is: of friction at one end of the drive, that end's own."""
    owner, _, suffix = name.rpartition(".")
    ends = {"motor": owner == "motor", "load": owner != "motor"}  # the other body may have its own
    return suffix in CAUSES[code].sizes and ends.get(code.rpartition("-")[2], True)
