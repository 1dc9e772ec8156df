"""Codes about steady speeds and constant torques: friction lines, masses, slopes."""

from drivetool.finding_codes.code import NOTE, NOTE_OR_WARNING, WARNING, Code

CODES = {
    "coast-down-assumed": Code(
        NOTE,
        "No torque is logged, or zeros only, and the drive slows down. The recording is taken as a coast-down "
        "from the time at which the speed begins to fall from its maximum.",
        "State it with `--method coast-down`; exclude the switching transient with `--flux-decay`, or "
        "`--condition 'keep from=..'`."),
    "constant-load": Code(
        NOTE_OR_WARNING,
        "A constant torque or force acts in addition to friction. Its estimates from recordings at constant "
        "torque differ by more than noise explains, or the drive turns both ways and has an idle torque. If a "
        "vehicle drives up and down a road, the ratio of this force to the weight is the slope.",
        "Look for what changed between the recordings: a load, a slope, wind, the temperature."),
    "idle-torque-not-separable": Code(
        NOTE,
        "The drive turns one way only. Idle torque and Coulomb friction are not identifiable separately: a step at "
        "steady speeds gives their sum as idle torque, a grey-box fit as a figure of its own.",
        "Record the other direction too, if the machine may turn that way; or hold one of them.",
        says="sum"),
    "location-not-identifiable": Code(
        NOTE,
        "The record does not determine on which body friction or another effect acts. Constant speeds give the "
        "sum over all bodies. An identified effect explains the record equally well on another body: the log "
        "likelihoods differ by less than 4.",
        "Log the shaft torque, or inspect both ends of the drive; for Coulomb friction record many slow "
        "reversals."),
    "negative-estimate": Code(
        NOTE_OR_WARNING,
        "An estimated friction or shaft damping is negative, which is not physical, and is set to zero. It is a "
        "warning where the estimate lies more than two standard deviations below zero. The estimate of viscous "
        "friction is negative where friction falls with speed (Stribeck effect).",
        "Check for a load that changes, for the Stribeck effect, and for a wrong sign of torque or speed. For the "
        "damping of a shaft leave more time between torque steps."),
    "nonlinear-friction": Code(
        WARNING,
        "Friction is not a linear function of speed. At constant speeds or torques a quadratic term is "
        "significant by more than four standard deviations; or a coast-down leaves a residual beyond the "
        "quantisation of the sensor. Air drag, Stribeck friction, breakaway friction and pairs of them are then "
        "fitted. The text states the "
        "likeliest, others within a log likelihood of 10, and the error reduction on another coast-down from the "
        "same speed.",
        "Fit the stated law: with `steady --free motor.drag` at constant speeds, with `steady --method coast-down "
        "--free`, or with `greybox --free motor.drag`; where none is stated, look at the picture."),
    "ratios-only": Code(
        NOTE,
        "Without a torque, inertia and friction scaled by a common factor give the same coast-down. Only their "
        "ratios have intervals. `validate` simulates such a file with an inertia of one, and its figures do not "
        "assess the inertia.",
        "Record a stretch under a logged torque, or repeat with a known inertia added, or hold a known inertia or "
        "friction."),
    "rotating-parts-unknown": Code(
        WARNING,
        "Intervals of constant torque determine the total inertia that the motor accelerates. The inertia of a "
        "part of it is not known, so the stated mass or inertia contains that part, and has no interval.",
        "Give the inertia with `--set`, or fit this recording together with one in which the load is clamped."),
    "scatter-beyond-noise": Code(
        NOTE_OR_WARNING,
        "Steady points scatter about the friction line more than their noise explains (chi-square test at 1 %), "
        "or several coast-downs of one drive have different ratios of friction to inertia. The intervals are "
        "widened, or are intervals of the mean over such recordings. It is a note where a frequency response "
        "varies over the runs by more than four times the noise variance.",
        "Look at the picture: a bend is nonlinear friction, scatter at one speed is a load that changes. Record "
        "when the temperature has settled; check the added or the held inertia."),
    "single-speed": Code(
        WARNING,
        "All steady intervals have one speed. The slope and the offset of the friction line are not identifiable "
        "separately. With a free drag two speeds are too few.",
        "Record steady intervals at two or more very different speeds, at three or more for a drag."),
    "speed-drops-to-zero": Code(
        NOTE,
        "The speed of a coast-down falls to zero more than five times faster than it decelerates before. Friction "
        "stops a drive continuously: a sensor below its lowest speed, or a brake, does not. The coast-down ends "
        "before the drop.",
        "Log the counts of the encoder, or use a sensor with a lower lowest speed."),
    "staged-fit": Code(
        NOTE_OR_WARNING,
        "The coast-down was fitted window by window (`--stages`). Each window holds the parameters of later "
        "windows at their start values (zero if unknown), which biases its estimates. The text compares the "
        "staged fit with the joint fit; a difference of more than two of its standard deviations is a warning.",
        "Leave out `--stages`: the joint fit uses the same recording."),
    "stretches-left-out": Code(
        NOTE,
        "Stretches of the recording are left out: steady intervals at standstill, where static friction balances "
        "any torque, or those in which the supply of an induction motor is off.",
        "Nothing; read a coast-down with the supply off with `steady --method coast-down`."),
    "torque-contradicts-motion": Code(
        WARNING,
        "Coast-downs follow the fitted friction, but under a torque, or a supply, the measured motion contradicts "
        "this torque. The inertia has the same relative error as the torque.",
        "Check the scale of the torque, or the electrical values of the motor and its voltage."),
}
