"""Codes about tuned controllers."""

from drivetool.finding_codes.code import NOTE, NOTE_OR_WARNING, WARNING, Code

CODES = {
    "covariance-incomplete": Code(
        NOTE,
        "The parameter file does not state the whole uncertainty: no standard deviation at all, none for some "
        "parameters of the loop, or no covariance between them. The spread of the loop's figures is unknown, too "
        "small, or computed from draws that ignore the correlations.",
        "Use the file of an estimator, which states the covariance; look at the variations, which change one "
        "parameter at a time."),
    "friction-linearised": Code(
        NOTE_OR_WARNING,
        "Friction whose slope depends on the speed is linearised at slow motion, where the slope of quadratic "
        "drag and Stribeck friction is zero. At higher speed Stribeck friction falls with speed, which "
        "destabilises the loop (warning).",
        "Give the working speed with `--speed`."),
    "limit-cycle": Code(
        NOTE_OR_WARNING,
        "A backlash gap or friction may keep the loop oscillating. In a simulation of the nonlinear drive a "
        "disturbance starts a limit cycle that does not decay, and the text states its amplitude and frequency "
        "(warning). Or the describing function of the gap predicts a possible limit cycle, but no simulated "
        "disturbance starts it.",
        "Lower the gain to the stated value, or take the backlash out of the drive."),
    "limit-uncertain": Code(
        WARNING,
        "The nominal design meets the limit of the sensitivity Ms. Over the drives that the parameter covariance "
        "allows, the 95 % quantile of Ms exceeds this limit by more than 3 %. Or a design with `--confidence` "
        "meets it in clearly fewer fresh draws than requested.",
        "Tune with `--confidence 0.95` or more `--draws`, or identify the drive more accurately."),
    "not-in-loop": Code(
        NOTE,
        "Some parameters of the file are not in the speed loop. They are disturbances such as ripple and load "
        "steps, friction that fades while the drive warms up, and values of single recordings. The text names "
        "each with its reason.",
        "Where one matters to the controller, give its equivalent value with `--set`."),
    "shaft-feedback-not-evaluated": Code(
        NOTE,
        "The configuration with shaft-torque feedback is not designed, since no shaft torque is measured, or was "
        "not simulated across the gap. Whether it has a limit cycle is then not known.",
        "Name the channel of the shaft torque as `shaft_torque` in a channel map and give it with `--map`; test "
        "the loop on the machine."),
    "two-speed-filters": Code(
        NOTE,
        "The parameter file has a filter of the speed sensor (`sensor.bandwidth`), and the controller has a speed "
        "filter of its own. The loop has both in series.",
        "If both are one and the same, leave one of them out."),
    "unphysical-draws": Code(
        NOTE_OR_WARNING,
        "Draws from the parameter covariance lie beyond a physical bound and are left out, for example with a "
        "negative inertia. More than 5 % of such draws is a warning: a parameter is hardly identified.",
        "Identify the parameter with a better record, or hold it at a known value."),
    "unstable-draws": Code(
        WARNING,
        "The loop is unstable for some of the drives that the parameter covariance allows.",
        "Identify the drive more accurately, or tune with a higher `--confidence`."),
}
