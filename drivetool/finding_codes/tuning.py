"""Codes about tuned controllers."""

from drivetool.finding_codes.code import NOTE, NOTE_OR_WARNING, WARNING, Code

CODES = {
    "confidence-missed": Code(
        WARNING,
        "A design with `--confidence` keeps its sensitivity limit in a clearly smaller share of fresh draws from "
        "the parameter covariance than was asked for. The design is fitted to the draws it has seen.",
        "Ask for more `--draws`."),
    "drawn-without-correlation": Code(
        NOTE,
        "The parameter file states standard deviations without a covariance for some parameters. These are drawn "
        "independently, which overstates or understates the spread of the figures.",
        "Use the file of an estimator, which states the covariance."),
    "friction-at-standstill": Code(
        NOTE_OR_WARNING,
        "Friction whose slope depends on the speed is linearised at slow motion, where quadratic drag and Stribeck "
        "friction have none. Stribeck friction falls with speed further up, which destabilises: a warning.",
        "Give the working speed with `--speed`."),
    "gap-may-cycle": Code(
        NOTE,
        "By its describing function a gap acts like a softer shaft, and the loop is unstable for one of these "
        "stiffnesses: a limit cycle is possible. The simulated disturbances started none.",
        "Lower the gain to the stated value, or take the backlash out of the drive."),
    "gap-not-simulated": Code(
        NOTE,
        "The configuration with shaft-torque feedback was not simulated across the gap. Whether it has a limit "
        "cycle is not known.",
        "Judge it by the softened shaft, and on the machine."),
    "limit-uncertain": Code(
        WARNING,
        "The nominal design keeps the limit of the sensitivity Ms, but many of the drives that the parameter "
        "covariance allows exceed it. The 95 % quantile of Ms is more than 3 % above the limit.",
        "Tune with `--confidence 0.95`, or identify the drive more accurately."),
    "loop-hunts": Code(
        WARNING,
        "In a simulation of the nonlinear drive a disturbance starts a limit cycle that does not decay. The text "
        "states its amplitude and frequency.",
        "Lower the gain to the stated value, or take the backlash out of the drive."),
    "mimo-left-out": Code(
        NOTE,
        "The configuration with shaft-torque feedback is not designed, since no shaft torque is measured.",
        "Name the channel of the shaft torque as `shaft_torque` in a channel map and give it with `--map`."),
    "no-spread": Code(
        NOTE,
        "The parameter file states no uncertainty. How the figures of the loop spread is not known.",
        "Use the parameter file of an estimator."),
    "not-in-loop": Code(
        NOTE,
        "Some parameters of the file are not in the speed loop: disturbances such as ripple and load steps, "
        "friction that fades while the drive warms up, and values of single recordings. The text names each with "
        "its reason.",
        "Where one matters to the controller, give what it comes to with `--set`."),
    "spread-is-partial": Code(
        NOTE,
        "Some parameters that shape the loop have no stated uncertainty. The spread of the figures leaves them "
        "out and is too small.",
        "Look at the variations, which change one parameter at a time."),
    "two-speed-filters": Code(
        NOTE,
        "The parameter file has a filter of the speed sensor (`sensor.bandwidth`), and the controller has a speed "
        "filter of its own. The loop has both in series.",
        "If both are one and the same, leave one of them out."),
    "unphysical-draws": Code(
        NOTE_OR_WARNING,
        "Draws from the parameter covariance lie beyond a physical bound and are left out, as where an inertia is "
        "negative. More than 5 % of such draws is a warning: a parameter is hardly identified.",
        "Identify the parameter with a better record, or hold it at a known value."),
    "unstable-draws": Code(
        WARNING,
        "The loop is unstable for some of the drives that the parameter covariance allows.",
        "Identify the drive more accurately, or tune with a higher `--confidence`."),
}
