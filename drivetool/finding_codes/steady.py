"""Codes about steady speeds and constant torques: friction lines, masses, slopes."""

from drivetool.finding_codes.code import NOTE, NOTE_OR_WARNING, WARNING, Code

CODES = {
    "coast-down-found": Code(
        NOTE,
        "No torque is logged but zeros, and the drive runs down. `steady` takes the recording as a coast-down.",
        "Say so with `--method coast-down`, or record constant speeds under torque."),
    "constant-torque-along": Code(
        NOTE_OR_WARNING,
        "Recordings at constant torque differ in their constant friction by more than noise explains, or the drive "
        "turns both ways and has an idle torque.",
        "Look for what changed between the recordings: a load, a slope, the temperature."),
    "coulomb-body-unknown": Code(
        NOTE,
        "The Coulomb friction of the steady line is the sum over all bodies. Constant speeds do not tell on which "
        "body it acts.",
        "Record many slow reversals, or log the shaft torque."),
    "friction-is-bent": Code(
        WARNING,
        "Over intervals of constant torque the friction is fitted as a line over the speed. The recordings tell a "
        "square besides, by more than four standard deviations: drag of the air, or another law that bends.",
        "Fit it with `greybox --free motor.drag` on the same recordings."),
    "friction-law-incomplete": Code(
        WARNING,
        "A run-down without torque leaves more than the steps of the sensor explain. The friction follows another "
        "law over the speed than viscous and Coulomb friction. Drag of the air, Stribeck friction, breakaway "
        "friction and two of them together are tried. The likeliest is named, with others that a log likelihood of "
        "10 does not part from it, and with what it gains on another run-down from the same speed.",
        "Fit the law that is named with `steady --method coast-down --free`; where none is, look at the picture."),
    "idle-and-coulomb-together": Code(
        NOTE,
        "All steady intervals have one direction. Idle torque and Coulomb friction are not identifiable "
        "separately; the idle torque holds their sum.",
        "Add steady intervals in the other direction.", says="sum"),
    "negative-coulomb": Code(
        NOTE_OR_WARNING,
        "The Coulomb friction of the steady line is negative, which is not physical, and is set to zero. More "
        "than two standard deviations below zero is a warning.",
        "Check for a load that changes, or for a wrong sign of torque or speed."),
    "negative-viscous": Code(
        NOTE_OR_WARNING,
        "The viscous friction of the steady line is negative and is set to zero. More than two standard "
        "deviations below zero is a warning: friction may fall with speed (Stribeck effect).",
        "Check for the Stribeck effect, for a load that changes, or for a wrong sign."),
    "one-level": Code(
        WARNING,
        "All steady intervals have one speed. The slope and the offset of the friction line are not identifiable "
        "separately.",
        "Record steady intervals at two or more speeds, far apart."),
    "ratios-only": Code(
        NOTE,
        "Without a torque, inertia and friction multiplied by one number run down alike. Their ratios have "
        "intervals, they themselves have none.",
        "Record a stretch under a logged torque, or repeat with a known inertia added, or hold what is known."),
    "rotating-parts-unknown": Code(
        WARNING,
        "Intervals of constant torque tell what the motor accelerates in all. The inertia of a part of it is not "
        "known, so that the stated mass or inertia has that part in it, and no interval.",
        "Give the inertia with `--set`, or fit a recording with the load clamped beside this one."),
    "run-downs-differ": Code(
        WARNING,
        "Several run-downs of one drive do not have one friction: fitted singly, their ratios of friction to "
        "inertia scatter more than their intervals allow. The intervals are of the mean over such runs.",
        "Record when the temperature has settled, or note it with each recording. Where the friction changes by "
        "more than a factor of two, check the inertia that was added or is held."),
    "scatter-beyond-noise": Code(
        WARNING,
        "The steady points scatter about the friction line more than their noise explains, by a chi-square test "
        "at 1 %. The intervals are widened accordingly.",
        "Look at the picture: a bend is nonlinear friction, scatter at one speed is a load that changes."),
    "slope-of-the-road": Code(
        NOTE,
        "A constant force acts along the way. The recordings drive one road up and down and their constant torques "
        "differ, or the drive turns both ways and has an idle torque. Over the weight that is the slope.",
        "Where the road is level, look for wind, a load or the temperature."),
    "staged-fit": Code(
        NOTE_OR_WARNING,
        "The coast-down was fitted window by window (`--stages`). A window holds what a later one fits at its "
        "start value, zero if nobody knows one, and takes the error of that into its own values. They are compared "
        "with the fit of all at once; more than two of its standard deviations are a warning.",
        "Leave out `--stages`: the joint fit needs no more than the same recording."),
    "standstill-left-out": Code(
        NOTE,
        "Steady intervals at standstill are left out, since static friction takes any torque there.",
        "Nothing."),
    "supply-off": Code(
        NOTE,
        "An induction motor's recording has stretches in which its supply is off. No voltage of the open stator is "
        "known there, and they are left out.",
        "Read the run-down with `steady --method coast-down`."),
    "torque-not-explained": Code(
        WARNING,
        "Run-downs follow the friction that was fitted, but under a torque, or a supply, the motion is another one "
        "than that torque gives. The inertia is wrong by as much as the torque.",
        "Check the scale of the torque, or the electrical values of the motor and its voltage."),
    "switched-off-assumed": Code(
        NOTE,
        "No torque was logged. The drive is taken to run down without one from where its speed has left the "
        "highest value.",
        "Leave out what belongs to the switching with `--flux-decay`, or `--condition 'keep from=..'`."),
}
